"""Files of a design: design.json for programs, and the chosen muscle as input of `pamjax simulate`."""

from __future__ import annotations

import hashlib
import json
import math
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pamjax.infer.fitting.io import FIT_SCHEMA as FIT
from pamjax.model.mechanism import AbstractMechanism
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.parameter import list_field_meanings
from pamjax.records.case import MUSCLE_FILE
from pamjax.records.files import write_folder_atomically
from pamjax.sizing.candidate import MUSCLE_OUTPUTS, locate_output
from pamjax.sizing.enumerate import ChoiceResult
from pamjax.sizing.inelastic import InelasticError
from pamjax.sizing.problem import OBJECTIVE_UNITS
from pamjax.sizing.result import Design
from pamjax.sizing.scatter import build_scatter_document
from pamjax.sizing.shopping import list_checks, list_parts
from pamjax.sizing.tolerances import TOLERANCE_UNITS
from pamjax.units import compute_si_factor, format_quantity

_DESIGN_SCHEMA = "pamjax.design/2"
#: Start of the text on the errors of manufacture and sensors in a receipt.
_TOLERANCE_LABEL = "manufacture and sensors, one standard deviation: "


def build_design_document(design: Design) -> dict[str, Any]:
    """Return the design as a JSON document, SI unless a unit is given."""
    entries, choice = design.spec.entries, design.choice
    unit = OBJECTIVE_UNITS[entries.minimise]
    return {
        "schema": _DESIGN_SCHEMA,
        "versions": {name: version(name) for name in ("pamjax", "jax", "scipy", "numpy")},
        "spec": {"name": design.spec.name, "file": design.spec.file, "sha256": _hash_text(design.spec.text)},
        "feasible": design.feasible,
        "seed": design.seed,
        "method": design.method,
        "objective": {
            "name": entries.minimise,
            "value": design.objective / compute_si_factor(unit),
            "unit": unit,
        },
        "choice": {
            "thread": choice.thread.name,
            "threads": choice.threads,
            "thread_diameter": choice.diameter,
            "bladder": choice.bladder.name,
            "parallel": choice.parallel,
            "yarn_count": choice.yarn_count,
            "tube": choice.tube.size if choice.tube is not None else None,
        },
        "sold_parts": design.spec.stock and not design.misses_stock,
        "nominal": _describe_nominal(design),
        "muscle": design.numbers,
        "shows": {name: float(design.outputs[locate_output(name)]) for name in MUSCLE_OUTPUTS},
        "points": [_describe_point(design, k) for k in range(design.task.point_count)],
        "requirements": [
            _describe_requirement(design, requirement) for requirement in design.task.requirements
        ],
        "probability": _finite_or_none(design.probability),
        "probability_wanted": entries.probability or None,
        "probability_reached": not design.misses_probability,
        "sensitivity": {
            "requirements": {
                sensitivity.requirement.key: {"share": sensitivity.percent_saved, "slope": sensitivity.slope}
                for sensitivity in design.requirement_sensitivities
            },
            "properties": design.property_sensitivities,
            "at_limits": list(design.active_limits),
        },
        "would_have_to_give": [_describe_relaxation(relaxation) for relaxation in design.relaxations],
        "inelastic_assumption": [_describe_error(error) for error in design.inelastic_errors],
        "front": _describe_front(design),
        "parts": [vars(part) for part in list_parts(design)] if design.feasible else [],
        "checks": list_checks(design) if design.feasible else [],
        "searched": {
            "choices": len(design.results),
            "left_out": design.unsearched_count,
            "agreeing": design.chosen_result.agreeing_count,
            "starts": design.chosen_result.start_count,
            "stationary": _get_stationarity(design),
        },
        "receipt": build_receipt(design),
    }


def _describe_nominal(design: Design) -> dict[str, float | None]:
    """Return the objective at typical properties: of any size, and with sold parts, in its unit."""
    unit = compute_si_factor(OBJECTIVE_UNITS[design.spec.entries.minimise])

    def get_value(result: ChoiceResult | None) -> float | None:
        if result is None or result.optimum is None:
            return None
        return math.exp(result.optimum.log_objective) / unit

    return {"any_size": get_value(design.nominal), "sold_parts": get_value(design.nominal_stock)}


def _hash_text(text: str) -> str | None:
    return hashlib.sha256(text.encode()).hexdigest() if text else None


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _get_stationarity(design: Design) -> float | None:
    optimum = design.chosen_result.optimum
    return None if optimum is None else optimum.stationarity


def _describe_point(design: Design, k: int) -> dict[str, Any]:
    points, working_pressure = design.task.points, design.numbers["pressure"]
    length = design.numbers["rest_length"] * (1 - float(points.contraction[k])) - float(points.shortening[k])
    return {
        "label": design.task.labels[k],
        "pressure": float(points.supply_share[k]) * working_pressure + float(points.pressure[k]),
        "length": length,
        "contraction": 1 - length / design.numbers["rest_length"],
        "required_force": _finite_or_none(float(design.task.loads[k])),
        "force": design.output("force", k),
        "force_sd": float(design.force_sds[k]) if k < design.force_sds.size else None,
        "diameter": design.output("diameter", k),
        "tension": design.output("tension", k),
    }


def _describe_requirement(design: Design, requirement) -> dict[str, Any]:
    return {
        "key": requirement.key,
        "says": requirement.description,
        "stated": requirement.stated,
        "bound": list(requirement.bounds),
        "margin": float(requirement.compute_margins(design.outputs).min()),
        "probability": design.requirement_probabilities.get(requirement.key),
    }


def _describe_relaxation(relaxation) -> dict[str, Any]:
    document = {
        "requirement": relaxation.requirement.key,
        "conflict_share": relaxation.conflict_share,
        "bound": relaxation.relaxed_bound,
    }
    return document | {"contraction": relaxation.contraction, "says": relaxation.description}


def _describe_error(error: InelasticError) -> dict[str, Any]:
    return {
        "thread": error.thread,
        "shortfall": error.missing_force,
        "share": error.missing_force_share,
        "place": error.worst_point,
        "overrun": error.excess_diameter,
        "wider": error.excess_diameter_share,
        "strain": error.max_strain,
        "inelastic": error.inelastic_objective,
        "elastic": error.elastic_objective,
        "choice": None if error.choice is None else str(error.choice),
    }


def _describe_front(design: Design) -> dict[str, Any] | None:
    if design.front is None:
        return None
    front = design.front
    rows = [
        {front.first: float(a), front.second: float(b), "choice": str(choice)}
        for (a, b), choice in zip(front.values, front.choices, strict=True)
    ]
    return {"first": front.first, "second": front.second, "points": rows}


def build_receipt(design: Design) -> dict[str, list[str]]:
    """Return the basis of the design as texts: assumptions, calibration, uncertainties and sensitivities."""
    choice, entries = design.choice, design.spec.entries
    assumptions = [
        requirement.description for requirement in design.task.requirements if not requirement.stated
    ]
    assumptions += [
        f"{choice.thread.name}: {choice.thread.about}, sources {choice.thread.source}",
        f"{choice.bladder.name}: {choice.bladder.about}, sources {choice.bladder.source}",
        "the bladder touches the braid at rest length and has the length of the muscle",
        "outer diameter: diameter of the braid plus two thread diameters",
        "fittings have no mass and no price; air is for one isothermal stroke",
        "no creep, fatigue or temperature effects; the muscle is at rest or contracts slowly",
    ]
    calibration_texts = list(design.transfer.sources) or [
        "nothing: all properties are typical values with their ranges"
    ]
    uncertain = [f"thread strength {_format_range(choice.thread.strength, 'GPa')}"]
    if design.transfer.thread_modulus is None or design.transfer.thread != choice.thread.name:
        uncertain.append(f"thread modulus {_format_range(choice.thread.modulus, 'GPa')}")
    if design.transfer.shear is None or design.transfer.bladder != choice.bladder.name:
        uncertain.append(f"shear modulus of the rubber {_format_range(choice.bladder.modulus, 'MPa')}")
    uncertain.append(_TOLERANCE_LABEL + _format_errors(design))
    sensitive = [
        f"{sensitivity.requirement.description}: 1 % relaxation reduces {entries.minimise}"
        f" by {sensitivity.percent_saved:.3g} %"
        for sensitivity in design.requirement_sensitivities
    ]
    sensitive += [
        f"{name}: 1 % increase changes {entries.minimise} by {share:+.3g} %"
        for name, share in design.property_sensitivities.items()
        if abs(share) > 1e-3
    ]
    sensitive += list(design.active_limits)
    if design.finalists and entries.probability:
        reached = sum(finalist.reaches(entries.probability) for finalist in design.finalists)
        uncertain.append(
            f"{len(design.finalists)} of the best choices were optimised for the probability;"
            f" {reached} of them reach it"
        )
    total = len(design.results) + design.unsearched_count
    search_texts = [
        f"the spec permits {total} choices of threads and rubber; {len(design.results)} of them optimised,"
        " the others only screened"
        if design.unsearched_count
        else f"all {total} choices of threads and rubber optimised"
    ]
    if design.misses_stock:
        search_texts.append("no tube that is sold fits")
    elif design.spec.stock:
        search_texts.append(
            f"{design.choice_count} combinations of these choices with tubes that are sold meet all"
            " requirements at typical properties"
        )
    search_texts.append("local searches from several starts do not prove a global optimum")
    return {
        "assumed": assumptions,
        "calibrated": calibration_texts,
        "not known": uncertain,
        "sensitive to": sensitive,
        "searched": search_texts,
    }


def _format_errors(design: Design) -> str:
    """Return the standard deviations of the errors of manufacture, length and pressure as text."""
    errors = design.errors
    parts = {
        name: f"{name.replace('_', ' ')} ± {format_quantity(getattr(errors, name), unit, 2)}"
        for name, unit in TOLERANCE_UNITS.items()
    }
    parts["pressure"] = f"pressure ± {100 * errors.pressure:.2g} %"
    stated = [text for name, text in parts.items() if name in errors.stated]
    assumed = [text for name, text in parts.items() if name not in errors.stated]
    return "; ".join(
        f"{', '.join(texts)} ({origin})"
        for texts, origin in ((stated, "from the spec"), (assumed, "assumed"))
        if texts
    )


def _format_range(known_range, unit: str) -> str:
    low, high = known_range.low / compute_si_factor(unit), known_range.high / compute_si_factor(unit)
    return f"{low:.3g} to {high:.3g} {unit}" if high > low else f"{low:.3g} {unit}, assumed exact"


def _format_muscle_toml(design: Design) -> str:
    """Return the muscle.toml of the chosen muscle (one of those in parallel)."""
    n, build = design.numbers, design.problem.build
    return f"""\
# Designed by pamjax {version("pamjax")} for "{design.spec.name}", not measured.
# Number of these muscles in parallel: {design.choice.parallel}.
# The rubber is included only in model.json in the parent folder.

[muscle]
name = {json.dumps(design.spec.name)}
rest_length = "{1e3 * n["rest_length"]:.6g} mm"
thread_length = "{1e3 * n["thread_length"]:.8g} mm"
turns = {n["turns"]:.8g}
threads = {design.choice.threads}
thread_area = "{1e6 * n["thread_area"]:.12g} mm^2"

[thread]
modulus = "{build.modulus / 1e9:.6g} GPa"

[bladder]
inner_diameter = "{1e3 * n["bore"]:.6g} mm"
thickness = "{1e3 * n["wall"]:.6g} mm"
modulus = "{3 * build.shear / 1e6:.6g} MPa"

[baseline]
model = "elastic"
"""


def build_model_document(design: Design) -> dict[str, Any]:
    """Return the chosen muscle with rubber and transferred mechanisms, in the schema of fit.json."""
    bench = design.bench
    ids = [
        mechanism.id
        for mechanism in bench.find_mechanisms(AbstractMechanism)
        if not isinstance(mechanism, BraidElasticity)
    ]
    numbers = {
        f"{mechanism.id}.{name}": float(getattr(mechanism, name))
        for mechanism in bench.find_mechanisms(AbstractMechanism)
        if not isinstance(mechanism, BraidElasticity)
        for name in list_field_meanings(type(mechanism))
    }
    (threads,) = bench.find_mechanisms(BraidElasticity)
    numbers |= {
        "muscle.rest_length": design.numbers["rest_length"],
        "muscle.thread_length": float(bench.thread_length),
        "muscle.turns": float(bench.turns),
        "thread.stiffness": 1 / float(threads.compliance),
    }
    return {
        "schema": FIT,
        "versions": {"pamjax": version("pamjax")},
        **build_scatter_document(design, numbers),
        "cases": {
            "designed": {
                "checksum": "designed, not measured",
                # The design is valid up to the supply pressure.
                "calibrated": {"pressure": {"low": 0.0, "high": design.spec.supply}},
                "muscle": {"law": "elastic", "mechanisms": ids, "numbers": numbers},
                "muscle_toml": _format_muscle_toml(design),
            }
        },
    }


def save_design(design: Design, folder: Path) -> list[Path]:
    """Write design.json and, if the spec is feasible, model.json and muscle/muscle.toml, all or none.

    Returns:
        the written files.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = ["design.json"]
    with write_folder_atomically(folder) as new_folder:
        _write_json(new_folder / "design.json", build_design_document(design))
        if design.feasible:
            _write_json(new_folder / "model.json", build_model_document(design))
            (new_folder / "muscle").mkdir()
            (new_folder / "muscle" / MUSCLE_FILE).write_text(_format_muscle_toml(design), encoding="utf-8")
            names += ["model.json", f"muscle/{MUSCLE_FILE}"]
    return [folder / name for name in names]


def _write_json(path: Path, document: dict[str, Any]) -> None:
    path.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")

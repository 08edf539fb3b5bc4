"""A design on disk: design.json for programs, and the chosen muscle as `pamjax simulate` takes it."""

from __future__ import annotations

import hashlib
import json
import math
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pamjax.infer.fitting.io import SCHEMA as FIT
from pamjax.model.mechanism import AbstractMechanism
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.parameter import field_meanings
from pamjax.records.case import MUSCLE
from pamjax.records.files import folder_beside
from pamjax.sizing.candidate import WHOLE, index
from pamjax.sizing.problem import UNITS
from pamjax.sizing.result import Design
from pamjax.units import in_unit

SCHEMA = "pamjax.design/1"


def as_dict(design: Design) -> dict[str, Any]:
    """The design as plain numbers, SI unless a unit stands beside them."""
    words, choice = design.spec.words, design.choice
    unit = UNITS[words.minimise]
    return {
        "schema": SCHEMA,
        "versions": {name: version(name) for name in ("pamjax", "jax", "scipy", "numpy")},
        "spec": {"name": design.spec.name, "file": design.spec.file, "sha256": _sha(design.spec.text)},
        "feasible": design.feasible,
        "seed": design.seed,
        "method": design.method,
        "objective": {"name": words.minimise, "value": design.objective / in_unit(unit), "unit": unit},
        "choice": {
            "thread": choice.thread.name,
            "threads": choice.threads,
            "thread_diameter": choice.diameter,
            "bladder": choice.bladder.name,
            "parallel": choice.parallel,
        },
        "muscle": design.numbers,
        "shows": {name: float(design.outputs[index(name)]) for name in WHOLE},
        "places": [_place(design, k) for k in range(design.asked.used)],
        "requirements": [_requirement(design, one) for one in design.asked.requirements],
        "probability": _finite(design.probability),
        "probability_wanted": words.probability,
        "probability_reached": not design.unsure,
        "sensitivity": {
            "requirements": {p.requirement.key: {"share": p.share, "slope": p.slope} for p in design.prices},
            "properties": design.properties,
            "at_limits": list(design.limits),
        },
        "would_have_to_give": [_gives(give) for give in design.gives],
        "inelastic_assumption": [_cost(cost) for cost in design.costs],
        "front": _front(design),
        "searched": {
            "choices": len(design.tried),
            "left_out": design.left_out,
            "agreeing": design.chosen.agreeing,
            "starts": design.chosen.starts,
            "stationary": _stationary(design),
        },
        "receipt": receipt(design),
    }


def _sha(text: str) -> str | None:
    return hashlib.sha256(text.encode()).hexdigest() if text else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _stationary(design: Design) -> float | None:
    answer = design.chosen.answer
    return None if answer is None else answer.stationary


def _place(design: Design, k: int) -> dict[str, Any]:
    at, working = design.asked.places, design.numbers["pressure"]
    length = design.numbers["rest_length"] * (1 - float(at.contraction[k])) - float(at.shortening[k])
    return {
        "label": design.asked.labels[k],
        "pressure": float(at.share[k]) * working + float(at.pressure[k]),
        "length": length,
        "contraction": 1 - length / design.numbers["rest_length"],
        "wanted": _finite(float(design.asked.loads[k])),
        "force": design.output("force", k),
        "diameter": design.output("diameter", k),
        "tension": design.output("tension", k),
    }


def _requirement(design: Design, one) -> dict[str, Any]:
    return {
        "key": one.key,
        "says": one.says,
        "stated": one.stated,
        "bound": list(one.bounds),
        "room": float(one.margins(design.outputs).min()),
        "probability": design.held.get(one.key),
    }


def _gives(give) -> dict[str, Any]:
    told = {"requirement": give.requirement.key, "part": give.part, "to": give.amount}
    return told | {"contraction": give.contraction, "says": give.says}


def _cost(cost) -> dict[str, Any]:
    told = {k: v for k, v in vars(cost).items() if k != "choice"}
    return told | {"choice": None if cost.choice is None else str(cost.choice)}


def _front(design: Design) -> dict[str, Any] | None:
    if design.front is None:
        return None
    one = design.front
    rows = [
        {one.first: float(a), one.second: float(b), "choice": str(choice)}
        for (a, b), choice in zip(one.values, one.choices, strict=True)
    ]
    return {"first": one.first, "second": one.second, "points": rows}


def receipt(design: Design) -> dict[str, list[str]]:
    """What the decision stands on: assumed, calibrated, not known, sensitive to."""
    choice, words = design.choice, design.spec.words
    assumed = [one.says for one in design.asked.requirements if not one.stated]
    assumed += [
        f"{choice.thread.name}: {choice.thread.about}, sources {choice.thread.source}",
        f"{choice.bladder.name}: {choice.bladder.about}, sources {choice.bladder.source}",
        "the bladder lies on the braid at rest and is as long as the muscle",
        "outside diameter: that of the threads' middle and two thread diameters more",
        "fittings weigh and cost nothing; air is that of one stroke, isothermal",
        "no creep, no fatigue, no temperature; everything at rest or lifting slowly",
    ]
    calibrated = list(design.handed.says) or ["nothing: every property is a typical value with its range"]
    doubt = [f"thread strength {_range(choice.thread.strength, 'GPa')}"]
    if design.handed.thread_modulus is None or design.handed.thread != choice.thread.name:
        doubt.append(f"thread modulus {_range(choice.thread.modulus, 'GPa')}")
    if design.handed.shear is None or design.handed.bladder != choice.bladder.name:
        doubt.append(f"shear modulus of the rubber {_range(choice.bladder.modulus, 'MPa')}")
    built = [
        name for name in ("rest_length", "thread_length", "turns", "wall") if getattr(words.tolerance, name)
    ]
    doubt.append("how exactly it is built: " + (", ".join(built) or "taken as exact"))
    sensitive = [f"{p.requirement.says}: {p.share:.3g} % of {words.minimise} for 1 %" for p in design.prices]
    sensitive += [
        f"{name}: {share:+.3g} % for 1 % more"
        for name, share in design.properties.items()
        if abs(share) > 1e-3
    ]
    sensitive += list(design.limits)
    searched = [f"{len(design.tried)} choices searched, {design.left_out} more only looked at"]
    searched.append("a local search from many starts proves no global optimum")
    return {"assumed": assumed, "calibrated": calibrated, "not known": doubt, "sensitive to": sensitive,
            "searched": searched}  # fmt: skip


def _range(known, unit: str) -> str:
    low, high = known.low / in_unit(unit), known.high / in_unit(unit)
    return f"{low:.3g} to {high:.3g} {unit}" if high > low else f"{low:.3g} {unit}, taken as known"


def muscle_toml(design: Design) -> str:
    """The chosen muscle, one of those in parallel, as a muscle.toml."""
    n, made = design.numbers, design.problem.made
    return f"""\
# Designed, not measured: chosen by pamjax {version("pamjax")} for "{design.spec.name}".
# One of {design.choice.parallel} in parallel. Rubber acts only through model.json beside this folder.

[muscle]
name = {json.dumps(design.spec.name)}
rest_length = "{1e3 * n["rest_length"]:.6g} mm"
thread_length = "{1e3 * n["thread_length"]:.8g} mm"
turns = {n["turns"]:.8g}
threads = {design.choice.threads}
thread_area = "{1e6 * n["thread_area"]:.12g} mm^2"

[thread]
modulus = "{made.modulus / 1e9:.6g} GPa"

[bladder]
inner_diameter = "{1e3 * n["bore"]:.6g} mm"
thickness = "{1e3 * n["wall"]:.6g} mm"
modulus = "{3 * made.shear / 1e6:.6g} MPa"

[baseline]
model = "elastic"
"""


def model(design: Design) -> dict[str, Any]:
    """The chosen muscle with its rubber and all that was handed on, in the schema of fit.json."""
    one = design.bench
    ids = [m.id for m in one.of(AbstractMechanism) if not isinstance(m, BraidElasticity)]
    numbers = {
        f"{m.id}.{name}": float(getattr(m, name))
        for m in one.of(AbstractMechanism)
        if not isinstance(m, BraidElasticity)
        for name in field_meanings(type(m))
    }
    (threads,) = one.of(BraidElasticity)
    numbers |= {
        "muscle.rest_length": design.numbers["rest_length"],
        "muscle.thread_length": float(one.thread_length),
        "muscle.turns": float(one.turns),
        "thread.stiffness": 1 / float(threads.compliance),
    }
    return {
        "schema": FIT,
        "versions": {"pamjax": version("pamjax")},
        "cases": {
            "designed": {
                "checksum": "designed, not measured",
                # For no more than the supply is it sized.
                "calibrated": {"pressure": {"low": 0.0, "high": design.spec.supply}},
                "muscle": {"law": "elastic", "mechanisms": ids, "numbers": numbers},
                "muscle_toml": muscle_toml(design),
            }
        },
    }


def save(design: Design, folder: Path) -> list[Path]:
    """Write design.json, model.json and muscle/muscle.toml, all or none; the last two only of an answer.

    Returns:
        the files written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = ["design.json"]
    with folder_beside(folder) as beside:
        _write(beside / "design.json", as_dict(design))
        if design.feasible:
            _write(beside / "model.json", model(design))
            (beside / "muscle").mkdir()
            (beside / "muscle" / MUSCLE).write_text(muscle_toml(design), encoding="utf-8")
            names += ["model.json", f"muscle/{MUSCLE}"]
    return [folder / name for name in names]


def _write(path: Path, document: dict[str, Any]) -> None:
    path.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")

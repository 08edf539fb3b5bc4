"""Transfer of a calibrated muscle to a design: its material properties, friction and uncertainty.

Not transferred: lengths and turns, which belong to the specimen, and sensor errors, which belong to the rig.
Transferred: thread modulus, rubber, friction, crimp of the threads and taper of the ends. Their parameters do
not depend on the size of the muscle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.control.command_uncertainty import read_unexplained_force
from pamjax.control.posterior_draws import list_form_errors
from pamjax.errors import BadInput, suggest_word
from pamjax.infer.fitting.load import LoadedMuscle, load_muscle
from pamjax.model.bench import Bench
from pamjax.model.mechanism import AbstractMechanism
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.mechanisms.end_taper import EndTaper
from pamjax.model.thread import LinearThread
from pamjax.sizing.specification.materials import BladderKind, ThreadKind, list_bladders, list_threads
from pamjax.sizing.specification.schema import Calibration

#: Transferred mechanisms besides threads and rubber, with the transferred parameters of each.
_TRANSFERABLE_NUMBERS = {
    "thread_crimp": ("crimp", "load"),
    "braid_locking": ("stiffness", "exponent"),
    "end_taper": ("share", "radius"),
    "braid_friction": (
        "coefficient", "constant", "exponent", "reach", "girth", "presliding", "angle", "spread", "give",
        "weakening", "weakening_speed", "asymmetry",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class CalibrationTransfer:
    """The transferred properties of a calibration, SI.

    Attributes:
        ids: transferred mechanisms besides threads and rubber.
        numbers: parameters of these mechanisms, as `candidate.build_bench` accepts them.
        thread, bladder: names of the materials that the calibration represents; "" for none.
        thread_modulus: Pa, None if it was not calibrated.
        shear, mooney: of the rubber, None if it was not calibrated.
        draws: posterior draws by name: "thread" and "shear" relative to their means, parameters as they are.
        discrepancy: sd of the model error of the force, as a fraction of the blocked force.
        sources: source of each transferred property, as text.
    """

    ids: tuple[str, ...] = ()
    numbers: Mapping[str, float] = field(default_factory=dict)
    thread: str = ""
    bladder: str = ""
    thread_modulus: float | None = None
    shear: float | None = None
    mooney: float | None = None
    draws: Mapping[str, np.ndarray] = field(default_factory=dict)
    discrepancy: float = 0.0
    sources: tuple[str, ...] = ()

    def get_thread_modulus(self, thread: ThreadKind) -> float:
        """Return the modulus of a thread, Pa: calibrated if the calibration represents it, else typical."""
        if self.thread_modulus is not None and thread.name == self.thread:
            return self.thread_modulus
        return thread.modulus.value

    def get_rubber_moduli(self, bladder: BladderKind) -> tuple[float, float]:
        """Return the shear modulus, Pa, and the Mooney fraction of a kind of rubber."""
        if self.shear is not None and bladder.name == self.bladder:
            return self.shear, self.mooney or 0.0
        return bladder.modulus.value, bladder.mooney


def transfer_calibration(
    calibration: Calibration | None, folder: Path, spec_file: str, thread_kinds, bladder_kinds
) -> CalibrationTransfer:
    """Return the transferred properties of the calibration in a spec.

    Args:
        calibration: [calibration] of the spec, or None.
        folder: folder of relative paths.
        spec_file: name of the spec, for error messages.
        thread_kinds, bladder_kinds: the catalogue.

    Raises:
        BadInput: if a file cannot be read, or if it is ambiguous which material the calibration represents.
    """
    if calibration is None:
        return CalibrationTransfer()
    where = f"[calibration] of {spec_file}"
    if calibration.muscle is None and calibration.posterior is None and calibration.discrepancy is None:
        remedy = 'Write muscle = "result/case/model.json".'
        raise BadInput.from_rule(
            "a calibration needs a `muscle`, a `posterior` or a `discrepancy`", "none", where, remedy
        )
    thread = _find_calibrated_material(
        calibration.thread, [k.name for k in thread_kinds], list_threads(), "thread", where
    )
    bladder = _find_calibrated_material(
        calibration.bladder, [k.name for k in bladder_kinds], list_bladders(), "bladder", where
    )
    properties: dict[str, Any] = {"thread": thread, "bladder": bladder}
    sources: list[str] = []
    if calibration.muscle is not None:
        path = folder / calibration.muscle
        properties |= _transfer_muscle(load_muscle(path), path.name, where, sources)
        misfit_share = _compute_misfit_share(path)
        if misfit_share is not None:
            properties["discrepancy"] = misfit_share
            sources.append(
                f"model error of the force: {100 * misfit_share:.1f} % of the blocked force, from the misfit"
                f" beyond noise on held-out blocks"
            )
    if calibration.posterior is not None:
        properties |= _transfer_posterior(folder / calibration.posterior, properties, where, sources)
    if calibration.discrepancy is not None:
        properties["discrepancy"] = calibration.discrepancy
        sources.append(
            f"model error of the force: {100 * calibration.discrepancy:g} % of the blocked force,"
            f" from the spec"
        )
    return CalibrationTransfer(**properties, sources=tuple(sources))


def _find_calibrated_material(
    stated_name: str | None, spec_names: list[str], shipped_kinds: Mapping, material: str, where: str
) -> str:
    if stated_name is not None:
        if stated_name not in spec_names and stated_name not in shipped_kinds:
            raise BadInput.from_rule(
                f"`{material}` must name a {material} of the catalogue",
                f"{stated_name!r}",
                where,
                suggest_word(stated_name, dict.fromkeys([*spec_names, *shipped_kinds])),
            )
        return stated_name
    if len(spec_names) == 1:
        return spec_names[0]
    remedy = f'Write {material} = "{spec_names[0]}".'
    raise BadInput.from_rule(
        f"a calibration must state which {material} of the catalogue it represents", "none", where, remedy
    )


def _transfer_muscle(
    loaded_muscle: LoadedMuscle, file: str, where: str, sources: list[str]
) -> dict[str, Any]:
    muscle_toml, muscle = loaded_muscle.muscle_toml, loaded_muscle.muscle
    area = (muscle_toml.threads or 0) * (muscle_toml.thread_area.value if muscle_toml.thread_area else 0.0)
    properties: dict[str, Any] = {}
    stiffness = _compute_thread_stiffness(muscle)
    if stiffness is not None and math.isfinite(stiffness):
        if not area:
            remedy = "Add them to the muscle.toml of the calibrated muscle."
            raise BadInput.from_rule(
                "a calibrated thread needs `threads` and `thread_area`", "neither", where, remedy
            )
        properties["thread_modulus"] = stiffness / area
        sources.append(f"thread modulus {stiffness / area / 1e9:.3g} GPa from {file}")
    if isinstance(muscle, Bench):
        properties |= _transfer_mechanisms(muscle, area, file, sources)
    if loaded_muscle.form_errors is not None:
        sources.append(f"not transferred: form errors of {', '.join(loaded_muscle.form_errors.forms)}")
    return properties


def _compute_thread_stiffness(muscle) -> float | None:
    if isinstance(muscle, Bench):
        (braid_elasticity,) = muscle.find_mechanisms(BraidElasticity) or (None,)
        compliance = float(braid_elasticity.compliance) if braid_elasticity is not None else 0.0
        return 1 / compliance if compliance > 0 else None
    return float(muscle.thread.stiffness) if isinstance(muscle.thread, LinearThread) else None


def _transfer_mechanisms(muscle: Bench, area: float, file: str, sources: list[str]) -> dict[str, Any]:
    properties: dict[str, Any] = {}
    numbers: dict[str, float] = {}
    ids: list[str] = []
    other_names: list[str] = []
    for mechanism in muscle.find_mechanisms(AbstractMechanism):
        if isinstance(mechanism, BladderElasticity):
            properties |= {"shear": float(mechanism.modulus), "mooney": float(mechanism.mooney)}
            sources.append(
                f"shear modulus of the rubber {float(mechanism.modulus) / 1e6:.3g} MPa from {file}"
            )
            if float(mechanism.stiffening) > 0:
                sources.append("not transferred: stiffening of the rubber at large stretch")
        elif mechanism.id in _TRANSFERABLE_NUMBERS:
            ids.append(mechanism.id)
            numbers |= {
                f"{mechanism.id}.{name}": float(getattr(mechanism, name))
                for name in _TRANSFERABLE_NUMBERS[mechanism.id]
            }
            sources.append(f"{mechanism.about.title} ({mechanism.id}) from {file}")
            if isinstance(mechanism, EndTaper) and float(mechanism.cone_height) > 0:
                sources.append("not transferred: cones at the ends")
        elif not isinstance(mechanism, BraidElasticity):
            other_names.append(mechanism.id)
    if "thread_crimp.load" in numbers:
        numbers["thread_crimp.load"] /= max(area, 1e-12)
    if "end_taper.radius" in numbers:
        rest_radius = _estimate_rest_radius(muscle)
        numbers["end_taper.radius"] /= rest_radius
    if other_names:
        sources.append(f"not transferred, specific to the rig or the specimen: {', '.join(other_names)}")
    return properties | {"ids": tuple(ids), "numbers": numbers}


def _estimate_rest_radius(muscle: Bench) -> float:
    """Return the outer radius of the unstretched calibrated bladder, or of a braid at 68 degrees, m."""
    for bladder in muscle.find_mechanisms(BladderElasticity):
        return float(bladder.inner_diameter) / 2 + float(bladder.thickness)
    return float(muscle.thread_length) * math.cos(math.radians(68.0)) / (2 * math.pi * float(muscle.turns))


def _compute_misfit_share(path: Path) -> float | None:
    """Return the force misfit of the improved model beyond noise, as a fraction of the blocked force."""
    misfit = read_unexplained_force(path)
    if misfit is None:
        return None
    loaded_muscle = load_muscle(path)
    max_pressure = loaded_muscle.calibrated_range.get("pressure", (0.0, 0.0))[1]
    rest_length, (thread, turns) = (
        loaded_muscle.muscle_toml.rest_length.value,
        loaded_muscle.muscle_toml.braid,
    )
    blocked_force = max_pressure * (3 * rest_length**2 - thread**2) / (4 * math.pi * turns**2)
    return misfit / blocked_force if blocked_force > 0 else None


def _transfer_posterior(
    path: Path, properties: dict[str, Any], where: str, sources: list[str]
) -> dict[str, Any]:
    import xarray as xr

    if not path.exists():
        raise BadInput.from_rule(
            f"file {path} does not exist", where=where, remedy="`pamjax sample` writes posterior.nc."
        )
    try:
        with xr.open_dataset(path, group="posterior", engine="h5netcdf") as posterior:
            samples = {str(name): np.asarray(posterior[name]).ravel() for name in posterior.data_vars}
        with xr.open_dataset(path, engine="h5netcdf") as root:
            form_errors = list_form_errors(root.attrs)
    except (OSError, ValueError, KeyError) as error:
        remedy = "`pamjax sample` writes this file."
        raise BadInput.from_rule(
            "`posterior` must be a valid posterior.nc", path.name, where, remedy
        ) from error
    draws: dict[str, np.ndarray] = {}
    updates: dict[str, Any] = {}
    for name, values in samples.items():
        owner, _, parameter = name.rpartition(".")
        owner = owner.rpartition(".")[2]
        if owner == "thread" and parameter in ("modulus", "stiffness"):
            draws["thread"] = values / values.mean()
            if parameter == "modulus" and properties.get("thread_modulus") is None:
                updates["thread_modulus"] = float(values.mean())
        elif owner == BladderElasticity.id and parameter == "modulus":
            draws["shear"] = values / values.mean()
            if properties.get("shear") is None:
                updates["shear"] = float(values.mean())
        elif (
            owner in _TRANSFERABLE_NUMBERS
            and f"{owner}.{parameter}" in properties.get("numbers", {})
            and parameter not in ("load", "radius")
        ):
            draws[f"{owner}.{parameter}"] = values
    if not draws:
        rule = "a posterior must contain a parameter that can be transferred to another muscle"
        raise BadInput.from_rule(rule, ", ".join(samples), where, "An example is thread.modulus.")
    sources.append(f"{len(next(iter(draws.values())))} draws of {', '.join(sorted(draws))} from {path.name}")
    if form_errors:
        sources.append(f"not transferred: form errors of {', '.join(form_errors)} in {path.name}")
    return updates | {"draws": draws}

"""What a measured muscle hands on to one that is yet to be built: its materials, its friction, its doubt.

Lengths and turns belong to the specimen and stay with it; so do the bench's sensors. A modulus, the rubber,
friction, the crimp of the threads and the share of the net at the ends go on, in numbers that have no size.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.control.command_uncertainty import left_over
from pamjax.errors import refuse
from pamjax.infer.fitting.load import Loaded, load_muscle
from pamjax.model.bench import Bench
from pamjax.model.mechanism import AbstractMechanism
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.thread import LinearThread
from pamjax.sizing.materials import BladderKind, ThreadKind, bladders, threads
from pamjax.sizing.schema import Calibration

#: Mechanisms that go on to another muscle beside threads and rubber, and their numbers that do.
GO_ON = {
    "thread_crimp": ("crimp", "load"),
    "braid_locking": ("stiffness",),
    "end_taper": ("share", "radius"),
    "braid_friction": (
        "coefficient", "constant", "exponent", "reach", "girth", "presliding", "angle", "spread", "give",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Handed:
    """What a calibration hands on, SI.

    Attributes:
        ids: mechanisms beside threads and rubber.
        numbers: theirs, as `candidate.bench` takes them.
        thread, bladder: names of the materials it speaks for; "" for none.
        thread_modulus: Pa, None where it was not calibrated.
        shear, mooney: of the rubber, None where it was not calibrated.
        draws: posterior draws by name: "thread" and "shear" as ratios to their means, numbers as they are.
        discrepancy: what is left of the force, as a share of the blocked force.
        says: what came from where, a sentence each.
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
    says: tuple[str, ...] = ()

    def modulus(self, thread: ThreadKind) -> float:
        """Of a kind of thread, Pa: the calibrated one where it speaks for it, else the typical one."""
        if self.thread_modulus is not None and thread.name == self.thread:
            return self.thread_modulus
        return thread.modulus.value

    def rubber(self, bladder: BladderKind) -> tuple[float, float]:
        """Shear modulus, Pa, and Mooney share of a kind of rubber."""
        if self.shear is not None and bladder.name == self.bladder:
            return self.shear, self.mooney or 0.0
        return bladder.modulus.value, bladder.mooney


def hand_on(words: Calibration | None, folder: Path, spec_file: str, kinds, rubbers) -> Handed:
    """What the calibration that a spec names hands on.

    Args:
        words: [calibration] of the spec, or None.
        folder: where its paths start.
        spec_file: for error texts.
        kinds, rubbers: the catalogue.

    Raises:
        BadInput: if a file cannot be read, or it is not clear which material it speaks for.
    """
    if words is None:
        return Handed()
    where = f"[calibration] of {spec_file}"
    if words.muscle is None and words.posterior is None and words.discrepancy is None:
        remedy = 'Write muscle = "result/case/model.json".'
        raise refuse(
            "a calibration names a `muscle`, a `posterior` or a `discrepancy`", "none", where, remedy
        )
    thread = _speaks_for(words.thread, [k.name for k in kinds], threads(), "thread", where)
    bladder = _speaks_for(words.bladder, [k.name for k in rubbers], bladders(), "bladder", where)
    found: dict[str, Any] = {"thread": thread, "bladder": bladder}
    says: list[str] = []
    if words.muscle is not None:
        path = folder / words.muscle
        found |= _muscle(load_muscle(path), path.name, where, says)
        left = _left_over(path)
        if left is not None:
            found["discrepancy"] = left
            says.append(
                f"force missed on held-out blocks beyond noise: {100 * left:.1f} % of the blocked force"
            )
    if words.posterior is not None:
        found |= _posterior(folder / words.posterior, found, where, says)
    if words.discrepancy is not None:
        found["discrepancy"] = words.discrepancy
        says.append(f"force misses {100 * words.discrepancy:g} % of the blocked force, as the spec says")
    return Handed(**found, says=tuple(says))


def _speaks_for(said: str | None, named: list[str], shipped: Mapping, what: str, where: str) -> str:
    if said is not None:
        if said not in named and said not in shipped:
            raise refuse(
                f"`{what}` names the calibrated {what}", f"{said!r}", where, "Name one of the catalogue."
            )
        return said
    if len(named) == 1:
        return named[0]
    remedy = f'Write {what} = "{named[0]}".'
    raise refuse(f"a calibration must say which {what} of the catalogue it speaks for", "none", where, remedy)


def _muscle(loaded: Loaded, file: str, where: str, says: list[str]) -> dict[str, Any]:
    entry, muscle = loaded.entry, loaded.muscle
    area = (entry.threads or 0) * (entry.thread_area.value if entry.thread_area else 0.0)
    found: dict[str, Any] = {}
    stiffness = _stiffness(muscle)
    if stiffness is not None and math.isfinite(stiffness):
        if not area:
            remedy = "Add them to the muscle.toml that was fitted."
            raise refuse("a calibrated thread needs `threads` and `thread_area`", "neither", where, remedy)
        found["thread_modulus"] = stiffness / area
        says.append(f"thread modulus {stiffness / area / 1e9:.3g} GPa from {file}")
    if isinstance(muscle, Bench):
        found |= _mechanisms(muscle, area, file, says)
    return found


def _stiffness(muscle) -> float | None:
    if isinstance(muscle, Bench):
        (own,) = muscle.of(BraidElasticity) or (None,)
        compliance = float(own.compliance) if own is not None else 0.0
        return 1 / compliance if compliance > 0 else None
    return float(muscle.thread.stiffness) if isinstance(muscle.thread, LinearThread) else None


def _mechanisms(muscle: Bench, area: float, file: str, says: list[str]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    numbers: dict[str, float] = {}
    ids: list[str] = []
    stay: list[str] = []
    for one in muscle.of(AbstractMechanism):
        if isinstance(one, BladderElasticity):
            found |= {"shear": float(one.modulus), "mooney": float(one.mooney)}
            says.append(f"shear modulus of the rubber {float(one.modulus) / 1e6:.3g} MPa from {file}")
        elif one.id in GO_ON:
            ids.append(one.id)
            numbers |= {f"{one.id}.{name}": float(getattr(one, name)) for name in GO_ON[one.id]}
            says.append(f"{one.about.title} ({one.id}) from {file}")
        elif not isinstance(one, BraidElasticity):
            stay.append(one.id)
    if "thread_crimp.load" in numbers:
        numbers["thread_crimp.load"] /= max(area, 1e-12)
    if "end_taper.radius" in numbers:
        rest = _rest_radius(muscle)
        numbers["end_taper.radius"] /= rest
    if stay:
        says.append(f"left behind, as it belongs to the bench or the specimen: {', '.join(stay)}")
    return found | {"ids": tuple(ids), "numbers": numbers}


def _rest_radius(muscle: Bench) -> float:
    """Radius at which the calibrated bladder lies unstretched, or that of a braid at 68 degrees, m."""
    for one in muscle.of(BladderElasticity):
        return float(one.inner_diameter) / 2 + float(one.thickness)
    return float(muscle.thread_length) * math.cos(math.radians(68.0)) / (2 * math.pi * float(muscle.turns))


def _left_over(path: Path) -> float | None:
    """Force that the improved model misses beyond noise, as a share of the specimen's blocked force."""
    left = left_over(path)
    if left is None:
        return None
    loaded = load_muscle(path)
    top = loaded.calibrated.get("pressure", (0.0, 0.0))[1]
    rest, (thread, turns) = loaded.entry.rest_length.value, loaded.entry.braid
    blocked = top * (3 * rest**2 - thread**2) / (4 * math.pi * turns**2)
    return left / blocked if blocked > 0 else None


def _posterior(path: Path, found: dict[str, Any], where: str, says: list[str]) -> dict[str, Any]:
    import xarray as xr

    if not path.exists():
        raise refuse(f"there is no file {path}", where=where, remedy="`pamjax sample` writes posterior.nc.")
    try:
        with xr.open_dataset(path, group="posterior", engine="h5netcdf") as held:
            drawn = {str(name): np.asarray(held[name]).ravel() for name in held.data_vars}
    except (OSError, ValueError, KeyError) as error:
        remedy = "`pamjax sample` writes one."
        raise refuse("a posterior is a posterior.nc", f"{path.name}, which is none", where, remedy) from error
    draws: dict[str, np.ndarray] = {}
    changed: dict[str, Any] = {}
    for name, values in drawn.items():
        owner, _, own = name.rpartition(".")
        owner = owner.rpartition(".")[2]
        if owner == "thread" and own in ("modulus", "stiffness"):
            draws["thread"] = values / values.mean()
            if own == "modulus" and found.get("thread_modulus") is None:
                changed["thread_modulus"] = float(values.mean())
        elif owner == BladderElasticity.id and own == "modulus":
            draws["shear"] = values / values.mean()
            if found.get("shear") is None:
                changed["shear"] = float(values.mean())
        elif (
            owner in GO_ON and f"{owner}.{own}" in found.get("numbers", {}) and own not in ("load", "radius")
        ):
            draws[f"{owner}.{own}"] = values
    if not draws:
        rule = "a posterior must hold a number that goes on to another muscle"
        raise refuse(rule, ", ".join(drawn), where, "thread.modulus is one.")
    says.append(f"{len(next(iter(draws.values())))} draws of {', '.join(sorted(draws))} from {path.name}")
    return changed | {"draws": draws}

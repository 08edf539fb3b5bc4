"""Priors of a muscle's parameters: stated values from muscle.toml, and starting values of the others."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from pamjax.infer.problem.parameter_space import FreeParameter
from pamjax.model.assembly import list_mechanism_parameters
from pamjax.model.parameters import LENGTH_ERROR_PREFIX, find_meaning, list_law_parameters
from pamjax.parameter import Meaning
from pamjax.records.blocks import assign_length_levels
from pamjax.records.case import Case
from pamjax.records.reading.muscle_toml import Bladder, MuscleToml
from pamjax.records.reading.quantity import MeasuredValue

#: Starting values of a toe law: half the stiffness up to 0.3 % strain.
_TOE_START = {
    "thread.toe_ratio": 0.5,
    "thread.crimp": 0.003,
    "thread.width": 1e-3,
    "thread.curvature": 300.0,
    "thread.spread": 1.5e-3,
}
#: Prior sds of a toe law. The width of its corner is poorly identifiable and correlated with the slope below
#: it. Without this prior, 90 % intervals of that slope contained the true value in 63 of 100 simulated
#: recordings; with it, in 88.
_TOE_SD = {"thread.width": 0.5e-3}

#: Dimensions of the rubber tube in muscle.toml, which are fixed unless stated with an sd.
_TUBE_SIZES = ("inner_diameter", "thickness", "length")

#: Default inner diameter and wall thickness of the rubber tube, relative to the braid's diameter at rest.
_DEFAULT_BORE_SHARE, _DEFAULT_WALL_SHARE = 0.75, 0.08


def is_length_error(name: str) -> bool:
    """Return whether a parameter is the error of one length level, by its name."""
    return name.rpartition("/")[2].startswith(LENGTH_ERROR_PREFIX)


def collect_stated_values(muscle_toml: MuscleToml, law: str) -> dict[str, MeasuredValue]:
    """Return the values that muscle.toml states for the parameters of this law, SI."""
    values = {
        "muscle.rest_length": muscle_toml.rest_length,
        "muscle.thread_length": muscle_toml.thread_length,
        "muscle.turns": muscle_toml.turns,
        "muscle.braid_angle": muscle_toml.braid_angle,
        "muscle.diameter": muscle_toml.diameter,
    }
    if law != "inelastic":
        if muscle_toml.modulus is not None:
            values |= {
                "thread.modulus": muscle_toml.modulus,
                "muscle.threads": MeasuredValue(float(muscle_toml.threads or 0), 0.0),
                "muscle.thread_area": muscle_toml.thread_area,
            }
        else:
            values["thread.stiffness"] = muscle_toml.stiffness or MeasuredValue(
                _guess_stiffness(muscle_toml), math.inf
            )
        values |= {
            name: MeasuredValue(_TOE_START[name], _TOE_SD.get(name, math.inf))
            for name in list_law_parameters(law)
        }
    return {name: measured for name, measured in values.items() if measured is not None}


def _guess_stiffness(muscle_toml: MuscleToml) -> float:
    """Return a starting value for unknown threads: stiff enough that the muscle is far from bursting."""
    return 1e5 * (muscle_toml.rest_length.value / 0.2) ** 2


def list_free_parameters(case: Case, law: str, mechanisms: Sequence[str] = ()) -> list[FreeParameter]:
    """Return the free parameters of a case: those that are stated with an sd, or not stated."""
    parameters = [
        FreeParameter(name, find_meaning(name), m.value, m.sd)
        for name, m in (
            collect_stated_values(case.muscle_toml, law)
            | collect_mechanism_values(case.muscle_toml, mechanisms)
        ).items()
        if m.sd > 0 and not _has_no_effect(name, case.muscle_toml)
    ]
    sensors = case.muscle_toml.sensors
    if sensors.length_per_level and sensors.length:
        count = int(assign_length_levels(case.recording).max()) + 1
        error = replace(find_meaning(LENGTH_ERROR_PREFIX), low=-8 * sensors.length, high=8 * sensors.length)
        parameters += [
            FreeParameter(f"{LENGTH_ERROR_PREFIX}{k + 1}", error, 0.0, sensors.length) for k in range(count)
        ]
    return parameters


def collect_mechanism_values(muscle_toml: MuscleToml, ids: Sequence[str]) -> dict[str, MeasuredValue]:
    """Return prior or starting values of the mechanisms' parameters, SI."""
    stated_values = estimate_tube_sizes(muscle_toml) | _read_bladder_modulus(muscle_toml)
    return {
        name: stated_values[name.rpartition(".")[2]]
        if name.rpartition(".")[2] in _TUBE_SIZES
        else stated_values.get(name) or _choose_start_value(find_meaning(name), kind, field)
        for name, (kind, field) in list_mechanism_parameters(ids).items()
    }


def estimate_tube_sizes(muscle_toml: MuscleToml) -> dict[str, MeasuredValue]:
    """Return dimensions of the rubber tube and the fittings: stated values, or usual ones for the braid."""
    thread, _ = muscle_toml.braid
    rest_length = muscle_toml.rest_length.value
    outer = float(muscle_toml.compute_braid_diameter(rest_length))
    bladder = muscle_toml.bladder or Bladder()
    sizes = {
        "inner_diameter": bladder.inner_diameter or MeasuredValue(_DEFAULT_BORE_SHARE * outer),
        "thickness": bladder.thickness or MeasuredValue(_DEFAULT_WALL_SHARE * outer),
        "length": MeasuredValue(rest_length),
    }
    fitting = muscle_toml.fitting_diameter or MeasuredValue(outer, 0.1 * outer)
    # Thread width at which the threads just touch at rest, sin 2θ B / N: the starting value of a fit.
    touching = 2 * math.pi * rest_length * outer / thread
    sizes["braid_locking.width"] = MeasuredValue(touching, math.inf)
    for ends in ("end_taper", "end_cones"):
        sizes[f"{ends}.radius"] = MeasuredValue(fitting.value / 2, fitting.sd / 2)
    return sizes


def _read_bladder_modulus(muscle_toml: MuscleToml) -> dict[str, MeasuredValue]:
    """Return the shear modulus of the rubber: a third of Young's modulus for incompressible rubber."""
    if muscle_toml.bladder is None or muscle_toml.bladder.modulus is None:
        return {}
    young = muscle_toml.bladder.modulus
    return {"bladder_elasticity.modulus": MeasuredValue(young.value / 3, young.sd / 3)}


def _choose_start_value(meaning: Meaning, kind: type, field: str) -> MeasuredValue:
    """Return the starting value of a parameter without a stated value: its default, inside its bounds.

    A refinement has its default as a fixed value.
    """
    default = float(getattr(kind(), field))
    if meaning.is_refinement:
        return MeasuredValue(default)
    if meaning.scale == "log":
        return MeasuredValue(default, math.inf)
    margin = 0.05 * (meaning.high - meaning.low)
    return MeasuredValue(min(max(default, meaning.low + margin), meaning.high - margin), math.inf)


def _has_no_effect(name: str, muscle_toml: MuscleToml) -> bool:
    """Return whether a parameter has no effect: rest length, if the thread length is stated."""
    return name == "muscle.rest_length" and muscle_toml.thread_length is not None

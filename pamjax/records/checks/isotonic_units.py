"""Detection of a wrong pressure unit in an isotonic test, by Young's modulus of the bladder.

A set force does not depend on the pressure, so that the force cannot show a wrong unit. The contraction can.
The braid pulls with P A, A = (3 L² - B²) / (4 π N²). The set force F and the rubber hold it in balance:

    P A - F = -dW/dL,      W = V E/6 (λz² + λc² + 1 / (λz λc)² - 3)

    P       pressure                    V       volume of the rubber, π t (d + t) L0
    A       force per pressure          E       Young's modulus of the rubber
    λz, λc  stretches along L / L0 and around D / D0

Each contracted row gives E. A pressure in a wrong unit multiplies it by the ratio of the units. Five free
contractions of real muscles have 2.9 to 4.1 MPa.

Neglects: contact pressure, friction, jammed threads and tapered ends. They increase E, so limits are wide.
Source: neo-Hookean thin tube in an inextensible braid, derived here.
"""

from __future__ import annotations

import math

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.errors import BadInput
from pamjax.records.checks.unit_errors import list_unit_errors, suggest_unit_remedy
from pamjax.records.reading.muscle_toml import Bladder, MuscleToml
from pamjax.records.recording import Recording
from pamjax.units import format_quantity

#: Young's modulus of usual rubbers, Pa: outside, a warning; outside the second range, an error. Latex has
#: 1 MPa, soft silicone 0.15 to 0.9 MPa, filled chloroprene and polyurethane up to 20 MPa.
_USUAL_MODULUS_PA, _POSSIBLE_MODULUS_PA = (0.25e6, 20e6), (0.05e6, 150e6)

#: Largest factor between this modulus and a stated one without a warning.
_MAX_MODULUS_FACTOR = 4.0

#: Modulus of a usual rubber, Pa, to name the probable unit.
_TYPICAL_MODULUS_PA = 3e6

#: Wall of a bladder as a share of the braid's diameter, if muscle.toml does not state it.
_ASSUMED_WALL_SHARE = 0.1

#: Rows in the test: smallest contraction, also as a share of the largest one, and smallest force per pressure
#: as a share of that at rest. Near the free contraction of the bare braid, any rubber is in balance.
_MIN_CONTRACTION, _MIN_CONTRACTION_SHARE, _MIN_AREA_SHARE = 0.03, 0.5, 0.15

#: Largest set force in the test, as a share of the pull of the braid.
_MAX_LOAD_SHARE = 0.5

#: Smallest number of rows in the test.
_MIN_ROWS = 3


def check_isotonic_units(
    recording: Recording, muscle_toml: MuscleToml, units: dict[str, str], file: str
) -> list[str]:
    """Return a warning about an unusual rubber in an isotonic test; refuse an impossible one.

    Args:
        recording: the recording, SI; without a warning if its force is measured.
        muscle_toml: contents of muscle.toml.
        units: unit in each column's header.
        file: name of the CSV file.

    Raises:
        BadInput: with the probable unit error.
    """
    if not recording.measures_length:
        return []
    is_stated, moduli = _compute_moduli(recording, muscle_toml)
    if moduli.size < _MIN_ROWS:
        return []
    modulus = float(np.median(moduli))
    stated = muscle_toml.bladder.modulus if muscle_toml.bladder else None
    expected = stated.value if stated else _TYPICAL_MODULUS_PA
    unit_errors = list_unit_errors("pressure", {**DISPLAY_UNIT, **units}["pressure"])
    got = f"{format_quantity(modulus, 'MPa', 2)} from the pressures and lengths"
    remedy = suggest_unit_remedy(modulus / expected, unit_errors)
    low, high = _POSSIBLE_MODULUS_PA
    if not low < modulus < high and is_stated:
        raise BadInput.from_rule(_format_rule("must", low, high), got, file, remedy)
    if stated:
        low, high = stated.value / _MAX_MODULUS_FACTOR, stated.value * _MAX_MODULUS_FACTOR
    elif is_stated:
        low, high = _USUAL_MODULUS_PA
    if low < modulus < high:
        return []
    return [f"{_format_rule('should', low, high)}; got {got} of {file}. {remedy}"]


def _format_rule(verb: str, low: float, high: float) -> str:
    limits = f"{format_quantity(low, 'MPa', 3)} to {format_quantity(high, 'MPa', 3)}"
    return f"Young's modulus of the bladder {verb} be within {limits}"


def _compute_moduli(recording: Recording, muscle_toml: MuscleToml) -> tuple[bool, np.ndarray]:
    """Return whether the wall is stated, and Young's modulus of the bladder at each tested row, Pa."""
    rest_length, (thread, turns) = muscle_toml.rest_length.value, muscle_toml.braid
    pressure, length, load = recording.pressure, recording.length, np.nan_to_num(recording.force)
    contraction = 1 - length / rest_length
    area, rest_area = ((3 * x**2 - thread**2) / (4 * math.pi * turns**2) for x in (length, rest_length))
    is_tested = recording.usable & (pressure > 0) & (area > _MIN_AREA_SHARE * rest_area)
    is_tested &= contraction > max(_MIN_CONTRACTION, _MIN_CONTRACTION_SHARE * np.nanmax(contraction))
    is_tested &= load <= _MAX_LOAD_SHARE * pressure * area
    is_stated, volume = _compute_rubber_volume(muscle_toml.bladder, muscle_toml)
    axial, stretch_rate = length[is_tested] / rest_length, 1 / rest_length
    hoop = muscle_toml.compute_braid_diameter(length[is_tested]) / muscle_toml.compute_braid_diameter(
        rest_length
    )
    # D² = (B² - L²) / (π N)², so dλc/dL = -L λc / (B² - L²).
    hoop_rate = -length[is_tested] * hoop / (thread**2 - length[is_tested] ** 2)
    thickness_squared = 1 / (axial * hoop) ** 2
    energy_rate = (axial - thickness_squared / axial) * stretch_rate + (
        hoop - thickness_squared / hoop
    ) * hoop_rate
    return is_stated, 3 * (pressure * area - load)[is_tested] / (-volume * energy_rate)


def _compute_rubber_volume(bladder: Bladder | None, muscle_toml: MuscleToml) -> tuple[bool, float]:
    """Return whether muscle.toml states the wall of the bladder, and the volume of its rubber, m³."""
    diameter = float(muscle_toml.compute_braid_diameter(muscle_toml.rest_length.value))
    is_stated = bladder is not None and bladder.thickness is not None
    thickness = bladder.thickness.value if bladder and bladder.thickness else _ASSUMED_WALL_SHARE * diameter
    inner = bladder.inner_diameter.value if bladder and bladder.inner_diameter else diameter - thickness
    return is_stated, math.pi * thickness * (inner + thickness) * muscle_toml.rest_length.value

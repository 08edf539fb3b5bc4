"""Detection of unit errors: comparison of a recording with the ideal braid.

The ideal braid of inextensible threads gives F = P (3 L² - B²) / (4 π N²) and D = sqrt(B² - L²) / (π N). Real
muscles pull less: rubber, dead pressure and taper reduce the force by tens of per cent. A contracted thick
hose may reach a sixth of the ideal force, or none. Hence only rows near the rest length are tested, where the
rubber is not stretched, and the limits are wide. There, seven hose recordings and 42 simulated ones reached
0.8 to 1.3 of the ideal force, and 0.97 to 1.08 of the ideal diameter.
"""

from __future__ import annotations

import math

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.errors import refuse
from pamjax.records.reading.muscle_toml import MuscleToml
from pamjax.records.recording import Recording
from pamjax.units import compute_si_factor, format_quantity

#: Ratio of measured to ideal force near rest: a muscle that lost two thirds of it still passes.
FORCE_RATIO_LIMITS = (0.3, 2.5)
#: Ratio of measured to ideal diameter: soft threads give 1.35 at rest, a wall some tenths.
DIAMETER_RATIO_LIMITS = (0.6, 1.75)
#: Ratio of the longest length to the rest length: a muscle shortens by 40 % at most, and hardly lengthens.
LENGTH_RATIO_LIMITS = (0.5, 1.6)
#: What goes down to less than this share of its largest value is no length but a way.
MAX_DISPLACEMENT_RATIO = 0.4

#: Share of the rest length from which on a row counts as near rest.
MIN_LENGTH_NEAR_REST = 0.97
#: A slip is named if the ratio is within e to this power of its factor, which is 1.6 times.
MAX_LOG_RATIO_NAMED = 0.5

#: Units that labs mix up.
CONFUSED_UNITS = {
    "pressure": ("Pa", "kPa", "bar", "MPa", "psi"),
    "force": ("N", "kN", "lbf", "kgf"),
    "length": ("mm", "cm", "m", "in"),
    "diameter": ("mm", "cm", "m", "in"),
}

#: Pa. A vented gauge that reads this close to the atmosphere's pressure, and a force that starts this close.
ATMOSPHERIC_PRESSURE, MAX_VENT_OFFSET, MAX_START_OFFSET = 101.3e3, 4e3, 10e3


def check_units(recording: Recording, entry: MuscleToml, units: dict[str, str], file: str) -> list[str]:
    """Refuse a recording with implausible units, and return warnings about unusual values.

    Args:
        recording: the recording, SI.
        entry: contents of muscle.toml.
        units: unit in each column's header.
        file: name of the CSV file.

    Returns:
        warnings, one sentence each.

    Raises:
        BadInput: with the probable unit error.
    """
    column_units = {**DISPLAY_UNIT, **units}
    warnings = _check_length(recording, entry, column_units, file)
    warnings += _check_force(recording, entry, column_units, file)
    _check_diameter(recording, entry, column_units, file)
    return warnings + _check_gauge(recording, entry, file)


def _check_length(
    recording: Recording, entry: MuscleToml, column_units: dict[str, str], file: str
) -> list[str]:
    rest, longest = entry.rest_length.value, float(np.nanmax(recording.length))
    ratio = longest / rest
    got, at_rest = (
        format_quantity(longest, column_units["length"]),
        format_quantity(rest, column_units["length"]),
    )
    if not LENGTH_RATIO_LIMITS[0] < ratio < LENGTH_RATIO_LIMITS[1]:
        rule = f"the longest `length` must be near the rest length ({at_rest})"
        if np.nanmin(recording.length) < MAX_DISPLACEMENT_RATIO * longest:
            remedy = (
                "If it is the way of the muscle's end, take it from the rest length: `pamjax import` with a "
                "`scale` of -1 and the rest length as [tare]."
            )
            raise refuse(rule, got, file, remedy)
        raise refuse(
            rule, got, file, _suggest_remedy(ratio, _list_unit_errors("length", column_units["length"]))
        )
    if abs(ratio - 1.0) > 0.15:
        return [f"the longest `length` in {file} is {got}, rest length {at_rest}: no row is near rest."]
    return []


def _check_force(
    recording: Recording, entry: MuscleToml, column_units: dict[str, str], file: str
) -> list[str]:
    ideal = recording.pressure * _compute_force_area(recording.length, entry)
    is_tested = np.isfinite(recording.force) & (ideal > 0)
    near = is_tested & (recording.length > MIN_LENGTH_NEAR_REST * entry.rest_length.value)
    unstretched = near.sum() >= 3
    is_tested = near if unstretched else is_tested
    if is_tested.sum() < 3:
        return []
    is_tested &= ideal >= 0.5 * np.max(ideal[is_tested])
    low, ratio = np.quantile(recording.force[is_tested] / ideal[is_tested], [0.1, 0.9])
    if FORCE_RATIO_LIMITS[0] < ratio < FORCE_RATIO_LIMITS[1]:
        return []
    got = f"{ratio:.4g} times the ideal braid's force"
    if low < -FORCE_RATIO_LIMITS[0] and ratio < FORCE_RATIO_LIMITS[0]:
        got = f"{low:.4g} times the ideal braid's force"
        raise refuse("a muscle that pulls must have a positive `force`", got, file, "Turn its sign.")
    if ratio < FORCE_RATIO_LIMITS[0] and not unstretched:
        return [f"`force` in {file} comes to {got}: the muscle is slack or very stiff, or a unit is wrong."]
    # What a pressure's slip does to the ideal force, it does inversely to the ratio.
    unit_errors = [
        (1.0 / factor, name) for factor, name in _list_unit_errors("pressure", column_units["pressure"])
    ]
    unit_errors += _list_unit_errors("force", column_units["force"])
    raise refuse("force and pressure must fit the braid", got, file, _suggest_remedy(ratio, unit_errors))


def _check_diameter(recording: Recording, entry: MuscleToml, column_units: dict[str, str], file: str) -> None:
    thread, turns = entry.braid
    ideal = np.sqrt(np.maximum(thread**2 - recording.length**2, 0.0)) / (math.pi * turns)
    is_tested = np.isfinite(recording.diameter) & (ideal > 0)
    if not is_tested.any():
        return
    ratio = float(np.median(recording.diameter[is_tested] / ideal[is_tested]))
    if DIAMETER_RATIO_LIMITS[0] < ratio < DIAMETER_RATIO_LIMITS[1]:
        return
    unit_errors = [
        (0.5, "a radius"),
        (math.pi, "a circumference"),
        *_list_unit_errors("diameter", column_units["diameter"]),
    ]
    got = f"{ratio:.4g} times the ideal braid's diameter"
    raise refuse("`diameter` must fit the braid", got, file, _suggest_remedy(ratio, unit_errors))


def _check_gauge(recording: Recording, entry: MuscleToml, file: str) -> list[str]:
    """Return a warning if pressure may be absolute: near rest length, force is then zero at one atmosphere.

    Only rows near rest length are used: there the rubber is not stretched and causes no dead pressure.
    """
    area = _compute_force_area(recording.length, entry)
    near = np.isfinite(recording.force * recording.pressure) & (
        recording.length > MIN_LENGTH_NEAR_REST * entry.rest_length.value
    )
    near &= area > 0
    pressure, push = recording.pressure[near], recording.force[near] / area[near]
    if near.sum() < 8 or np.ptp(pressure) < 0.5 * ATMOSPHERIC_PRESSURE:
        return []
    slope, offset = np.polyfit(pressure, push, 1)
    start = -offset / slope if slope else 0.0
    if (
        not 0.75 < slope < 1.25
        or abs(start - ATMOSPHERIC_PRESSURE) > MAX_START_OFFSET
        or pressure.min() < ATMOSPHERIC_PRESSURE - MAX_START_OFFSET
    ):
        return []
    vented = abs(pressure.min() - ATMOSPHERIC_PRESSURE) < MAX_VENT_OFFSET
    remedy = "Subtract the atmosphere's 101 kPa if the gauge counts from vacuum."
    if not vented:
        begins = f"the force begins at {format_quantity(start, 'kPa', 3)}"
        return [f"`pressure` in {file} may be absolute: near rest length {begins}. {remedy}"]
    got = f"a force that begins at {format_quantity(start, 'kPa', 3)}"
    raise refuse("`pressure` must be gauge pressure", got, file, remedy)


def _compute_force_area(length: np.ndarray, entry: MuscleToml) -> np.ndarray:
    """Return the ratio of force to pressure of the ideal braid, (n,) m²."""
    thread, turns = entry.braid
    return (3.0 * length**2 - thread**2) / (4.0 * math.pi * turns**2)


def _list_unit_errors(name: str, header: str) -> list[tuple[float, str]]:
    """Return the factor and description of each possible unit error of a column."""
    true = [
        unit
        for unit in CONFUSED_UNITS[name]
        if not math.isclose(compute_si_factor(unit), compute_si_factor(header))
    ]
    return [
        (compute_si_factor(header) / compute_si_factor(unit), f"{name} in {unit} under a header of {header}")
        for unit in true
    ]


def _suggest_remedy(ratio: float, unit_errors: list[tuple[float, str]]) -> str:
    """Return a remedy with the most probable unit errors; without them if no factor is near the ratio."""
    check = "the braid's numbers in muscle.toml"
    log_distances = [abs(math.log(ratio / factor)) if ratio > 0 else math.inf for factor, _ in unit_errors]
    if min(log_distances) > MAX_LOG_RATIO_NAMED:
        return f"Check the units in the headers and {check}."
    suspects = " or ".join(
        name
        for distance, (_, name) in zip(log_distances, unit_errors, strict=True)
        if distance < min(log_distances) + 0.05
    )
    return f"It looks like {suspects}; if it is not, check {check}."

"""Detection of unit errors: comparison of a recording with the ideal braid.

The ideal braid of inextensible threads has F = P (3 L² - B²) / (4 π N²) and D = sqrt(B² - L²) / (π N). The
force of a real muscle is smaller: rubber, contact pressure and taper reduce it by tens of per cent. A
contracted thick hose may reach a sixth of the ideal force, or none. Hence only rows near the rest length are
tested, where the rubber is not stretched, and the limits are wide. There, seven hose recordings and 42
simulated ones reached 0.8 to 1.3 of the ideal force, and 0.97 to 1.08 of the ideal diameter.
"""

from __future__ import annotations

import math

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.errors import BadInput
from pamjax.records.reading.muscle_toml import MuscleToml
from pamjax.records.recording import Recording
from pamjax.units import compute_si_factor, format_quantity

#: Limits of measured force over ideal force near rest; a muscle with a third of the ideal force passes.
_FORCE_RATIO_LIMITS = (0.3, 2.5)
#: Limits of measured diameter over ideal diameter; soft threads cause 1.35 at rest; a thick
#: wall adds a few tenths.
_DIAMETER_RATIO_LIMITS = (0.6, 1.75)
#: Limits of longest length over rest length; a muscle shortens by at most 40 %, and hardly lengthens.
_LENGTH_RATIO_LIMITS = (0.5, 1.6)
#: A column whose minimum is below this share of its maximum is a displacement, not a length.
_MAX_DISPLACEMENT_RATIO = 0.4

#: Minimum length of a row near rest, as a share of the rest length.
_MIN_LENGTH_NEAR_REST = 0.97
#: A message suggests a unit error if |log(ratio / factor)| is at most this, thus within a factor of 1.6.
_MAX_LOG_RATIO_NAMED = 0.5

#: Pa; a pressure outside is probably in another unit: air muscles burst above, and do not contract below.
_MIN_USUAL_PRESSURE, _MAX_USUAL_PRESSURE = 5e3, 1.5e6

#: Units that are often confused.
_CONFUSED_UNITS = {
    "pressure": ("Pa", "kPa", "bar", "MPa", "psi"),
    "force": ("N", "kN", "lbf", "kgf"),
    "length": ("mm", "cm", "m", "in"),
    "diameter": ("mm", "cm", "m", "in"),
}

#: Pa: atmospheric pressure; maximum distance from it of a vented reading, and of the pressure at zero force.
_ATMOSPHERIC_PRESSURE, _MAX_VENT_OFFSET, _MAX_START_OFFSET = 101.3e3, 4e3, 10e3

#: Forces below this number of standard deviations of their noise are those of a slack muscle.
_MAX_SLACK_SD = 4.0


def check_units(recording: Recording, muscle_toml: MuscleToml, units: dict[str, str], file: str) -> list[str]:
    """Return warnings about unusual values; refuse a recording with implausible units.

    Args:
        recording: the recording, SI.
        muscle_toml: contents of muscle.toml.
        units: unit in each column's header.
        file: name of the CSV file.

    Returns:
        warnings, one sentence each.

    Raises:
        BadInput: with the probable unit error.
    """
    column_units = {**DISPLAY_UNIT, **units}
    warnings = _check_length(recording, muscle_toml, column_units, file)
    _check_diameter(recording, muscle_toml, column_units, file)
    if recording.measures_length:
        # A set force does not depend on the pressure.
        return warnings
    _check_pull(recording, muscle_toml, column_units, file)
    warnings += _check_force(recording, muscle_toml, column_units, file)
    return warnings + _check_gauge(recording, muscle_toml, file)


def _check_pull(
    recording: Recording, muscle_toml: MuscleToml, column_units: dict[str, str], file: str
) -> None:
    """Refuse a recording without diameters whose forces are all noise: a slack muscle has no information."""
    noise = muscle_toml.sensors.force
    force = recording.force[recording.usable & np.isfinite(recording.force)]
    if noise is None or not force.size or np.isfinite(recording.diameter).any():
        return
    largest = float(np.max(np.abs(force)))
    if largest > _MAX_SLACK_SD * noise:
        return
    unit = column_units["force"]
    rule = (
        f"`force` of at least one row must exceed its noise ({format_quantity(noise, unit)}) by a factor of"
        f" {_MAX_SLACK_SD:g}"
    )
    remedy = "The muscle is slack in every row: measure at a larger length or pressure."
    raise BadInput.from_rule(rule, f"at most {format_quantity(largest, unit, 3)}", file, remedy)


def _check_length(
    recording: Recording, muscle_toml: MuscleToml, column_units: dict[str, str], file: str
) -> list[str]:
    rest_length, longest = muscle_toml.rest_length.value, float(np.nanmax(recording.length))
    ratio = longest / rest_length
    got, at_rest = (
        format_quantity(longest, column_units["length"]),
        format_quantity(rest_length, column_units["length"]),
    )
    if not _LENGTH_RATIO_LIMITS[0] < ratio < _LENGTH_RATIO_LIMITS[1]:
        rule = f"the longest `length` must be near the rest length ({at_rest})"
        if np.nanmin(recording.length) < _MAX_DISPLACEMENT_RATIO * longest:
            remedy = (
                "If the column is a displacement, convert it to a length: use `pamjax import` with a "
                "`scale` of -1 and the rest length in [tare]."
            )
            raise BadInput.from_rule(rule, got, file, remedy)
        raise BadInput.from_rule(
            rule, got, file, suggest_unit_remedy(ratio, list_unit_errors("length", column_units["length"]))
        )
    if abs(ratio - 1.0) > 0.15:
        return [
            f"no row of {file} is near rest: the longest `length` is {got}, the rest length {at_rest}."
            " Check `rest_length` in muscle.toml."
        ]
    return []


def _check_force(
    recording: Recording, muscle_toml: MuscleToml, column_units: dict[str, str], file: str
) -> list[str]:
    ideal = recording.pressure * _compute_force_area(recording.length, muscle_toml)
    is_tested = np.isfinite(recording.force) & (ideal > 0)
    near_rest = is_tested & (recording.length > _MIN_LENGTH_NEAR_REST * muscle_toml.rest_length.value)
    has_rows_near_rest = near_rest.sum() >= 3
    is_tested = near_rest if has_rows_near_rest else is_tested
    if is_tested.sum() < 3:
        return []
    is_tested &= ideal >= 0.5 * np.max(ideal[is_tested])
    low, ratio = np.quantile(recording.force[is_tested] / ideal[is_tested], [0.1, 0.9])
    if _FORCE_RATIO_LIMITS[0] < ratio < _FORCE_RATIO_LIMITS[1]:
        return []
    got = f"{ratio:.4g} times the force of the ideal braid"
    if low < -_FORCE_RATIO_LIMITS[0] and ratio < _FORCE_RATIO_LIMITS[0]:
        got = f"{low:.4g} times the force of the ideal braid"
        raise BadInput.from_rule(
            "`force` must be positive when the muscle pulls", got, file, "Change its sign."
        )
    largest_pressure = float(np.nanmax(recording.pressure))
    # A factor of the pressure multiplies the ideal force, and divides the ratio.
    pressure_errors = [
        (1.0 / factor, name) for factor, name in list_unit_errors("pressure", column_units["pressure"])
    ]
    has_pressure_error = largest_pressure > _MAX_USUAL_PRESSURE and _has_cause(ratio, pressure_errors)
    if ratio < _FORCE_RATIO_LIMITS[0] and not has_rows_near_rest and not has_pressure_error:
        return [
            f"`force` in {file} is {got}: the muscle is slack or very stiff, or a unit is wrong."
            " Check the units in the headers."
        ]
    force_errors = list_unit_errors("force", column_units["force"])
    # Each cause implies the true pressure: with an error of the force, it is the one in the file.
    usual_errors = [e for e in pressure_errors if _is_usual_pressure(largest_pressure * e[0])]
    usual_errors += force_errors if _is_usual_pressure(largest_pressure) else []
    unit_errors = usual_errors if _has_cause(ratio, usual_errors) else pressure_errors + force_errors
    raise BadInput.from_rule(
        "`force` and `pressure` must agree with the braid", got, file, suggest_unit_remedy(ratio, unit_errors)
    )


def _is_usual_pressure(pressure: float) -> bool:
    return _MIN_USUAL_PRESSURE < pressure <= _MAX_USUAL_PRESSURE


def _has_cause(ratio: float, unit_errors: list[tuple[float, str]]) -> bool:
    """Return whether the factor of a unit error is near the ratio."""
    return any(
        ratio > 0 and abs(math.log(ratio / factor)) < _MAX_LOG_RATIO_NAMED for factor, _ in unit_errors
    )


def _check_diameter(
    recording: Recording, muscle_toml: MuscleToml, column_units: dict[str, str], file: str
) -> None:
    ideal = muscle_toml.compute_braid_diameter(recording.length)
    is_tested = np.isfinite(recording.diameter) & (ideal > 0)
    if not is_tested.any():
        return
    ratio = float(np.median(recording.diameter[is_tested] / ideal[is_tested]))
    if _DIAMETER_RATIO_LIMITS[0] < ratio < _DIAMETER_RATIO_LIMITS[1]:
        return
    unit_errors = [
        (0.5, "a radius"),
        (math.pi, "a circumference"),
        *list_unit_errors("diameter", column_units["diameter"]),
    ]
    got = f"{ratio:.4g} times the diameter of the ideal braid"
    raise BadInput.from_rule(
        "`diameter` must agree with the braid", got, file, suggest_unit_remedy(ratio, unit_errors)
    )


def _check_gauge(recording: Recording, muscle_toml: MuscleToml, file: str) -> list[str]:
    """Return a warning if pressure may be absolute: near rest length, force is then zero at one atmosphere.

    Only rows near the rest length are used. There the rubber is not stretched, and does not reduce the force.
    """
    area = _compute_force_area(recording.length, muscle_toml)
    near_rest = np.isfinite(recording.force * recording.pressure) & (
        recording.length > _MIN_LENGTH_NEAR_REST * muscle_toml.rest_length.value
    )
    near_rest &= area > 0
    pressure, force_pressure = recording.pressure[near_rest], recording.force[near_rest] / area[near_rest]
    if near_rest.sum() < 8 or np.ptp(pressure) < 0.5 * _ATMOSPHERIC_PRESSURE:
        return []
    slope, offset = np.polyfit(pressure, force_pressure, 1)
    zero_force_pressure = -offset / slope if slope else 0.0
    if (
        not 0.75 < slope < 1.25
        or abs(zero_force_pressure - _ATMOSPHERIC_PRESSURE) > _MAX_START_OFFSET
        or pressure.min() < _ATMOSPHERIC_PRESSURE - _MAX_START_OFFSET
    ):
        return []
    is_vented = abs(pressure.min() - _ATMOSPHERIC_PRESSURE) < _MAX_VENT_OFFSET
    remedy = "If the sensor measures absolute pressure, subtract the atmospheric pressure of 101 kPa."
    got = f"zero force at {format_quantity(zero_force_pressure, 'kPa', 3)}"
    if not is_vented:
        return [f"`pressure` in {file} may be absolute: near the rest length, got {got}. {remedy}"]
    raise BadInput.from_rule("`pressure` must be gauge pressure", got, file, remedy)


def _compute_force_area(length: np.ndarray, muscle_toml: MuscleToml) -> np.ndarray:
    """Return the ratio of force to pressure of the ideal braid, (n,) m²."""
    thread, turns = muscle_toml.braid
    return (3.0 * length**2 - thread**2) / (4.0 * math.pi * turns**2)


def list_unit_errors(name: str, header: str) -> list[tuple[float, str]]:
    """Return the factor and description of each possible unit error of a column."""
    confused_units = [
        unit
        for unit in _CONFUSED_UNITS[name]
        if not math.isclose(compute_si_factor(unit), compute_si_factor(header))
    ]
    return [
        (compute_si_factor(header) / compute_si_factor(unit), f"{name} in {unit} under a header of {header}")
        for unit in confused_units
    ]


def suggest_unit_remedy(ratio: float, unit_errors: list[tuple[float, str]]) -> str:
    """Return a remedy with the most probable unit errors; without them if no factor is near the ratio."""
    check = "the entries of the braid in muscle.toml"
    log_distances = [abs(math.log(ratio / factor)) if ratio > 0 else math.inf for factor, _ in unit_errors]
    if min(log_distances) > _MAX_LOG_RATIO_NAMED:
        return f"Check the units in the headers and {check}."
    causes = " or ".join(
        name
        for distance, (_, name) in zip(log_distances, unit_errors, strict=True)
        if distance < min(log_distances) + 0.05
    )
    return f"Probable cause: {causes}. Otherwise check {check}."

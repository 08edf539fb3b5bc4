"""Unit slips: a recording that the ideal braid contradicts by a well-known factor is told so at the door.

The ideal braid of inextensible threads gives F = P (3 L² - B²) / (4 π N²) and D = sqrt(B² - L²) / (π N). Real
muscles pull less: rubber, dead pressure and taper take tens of per cent, and a contracted thick hose may
pull with a sixth, or not at all. So the best rows are asked, near rest length where rubber is not
stretched yet, and only what no muscle explains is refused. There, seven hose recordings and 42 simulated
ones reached 0.8 to 1.3 of the ideal force, and the diameter 0.97 to 1.08 of the ideal one.
"""

from __future__ import annotations

import math

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.errors import refuse
from pamjax.records.reading.muscle_toml import Entry
from pamjax.records.recording import Recording
from pamjax.units import in_unit, show

#: Ratio of measured to ideal force near rest: a muscle that lost two thirds of it still passes.
FORCE = (0.3, 2.5)
#: Ratio of measured to ideal diameter: soft threads give 1.35 at rest, a wall some tenths.
DIAMETER = (0.6, 1.75)
#: Ratio of the longest length to the rest length: a muscle shortens by 40 % at most, and hardly lengthens.
LENGTH = (0.5, 1.6)
#: What goes down to less than this share of its largest value is no length but a way.
WAY = 0.4

#: Share of the rest length from which on a row counts as near rest.
NEAR_REST = 0.97
#: A slip is named if the ratio is within e to this power of its factor, which is 1.6 times.
NAMED = 0.5

#: Units that labs mix up.
MIXED = {
    "pressure": ("Pa", "kPa", "bar", "MPa", "psi"),
    "force": ("N", "kN", "lbf", "kgf"),
    "length": ("mm", "cm", "m", "in"),
    "diameter": ("mm", "cm", "m", "in"),
}

#: Pa. A vented gauge that reads this close to the atmosphere's pressure, and a force that starts this close.
ATMOSPHERE, VENT_NEAR, START_NEAR = 101.3e3, 4e3, 10e3


def no_slip(recording: Recording, entry: Entry, units: dict[str, str], file: str) -> list[str]:
    """Refuse a recording whose units cannot be what its headers say.

    Args:
        recording: what was measured, SI.
        entry: what the lab says about the muscle.
        units: unit in each column's header.
        file: name of the CSV file.

    Returns:
        what is odd and yet possible, one sentence each.

    Raises:
        BadInput: with the likely slip named.
    """
    shown = {**DISPLAY_UNIT, **units}
    odd = _length(recording, entry, shown, file)
    odd += _force(recording, entry, shown, file)
    _diameter(recording, entry, shown, file)
    return odd + _gauge(recording, entry, file)


def _length(recording: Recording, entry: Entry, shown: dict[str, str], file: str) -> list[str]:
    rest, longest = entry.rest_length.value, float(np.nanmax(recording.length))
    ratio = longest / rest
    got, at_rest = show(longest, shown["length"]), show(rest, shown["length"])
    if not LENGTH[0] < ratio < LENGTH[1]:
        rule = f"the longest `length` must be near the rest length ({at_rest})"
        if np.nanmin(recording.length) < WAY * longest:
            remedy = (
                "If it is the way of the muscle's end, take it from the rest length: `pamjax import` with a "
                "`scale` of -1 and the rest length as [tare]."
            )
            raise refuse(rule, got, file, remedy)
        raise refuse(rule, got, file, _remedy(ratio, _swapped("length", shown["length"])))
    if abs(ratio - 1.0) > 0.15:
        return [f"the longest `length` in {file} is {got}, rest length {at_rest}: no row is near rest."]
    return []


def _force(recording: Recording, entry: Entry, shown: dict[str, str], file: str) -> list[str]:
    ideal = recording.pressure * _area(recording.length, entry)
    ask = np.isfinite(recording.force) & (ideal > 0)
    near = ask & (recording.length > NEAR_REST * entry.rest_length.value)
    unstretched = near.sum() >= 3
    ask = near if unstretched else ask
    if ask.sum() < 3:
        return []
    ask &= ideal >= 0.5 * np.max(ideal[ask])
    low, ratio = np.quantile(recording.force[ask] / ideal[ask], [0.1, 0.9])
    if FORCE[0] < ratio < FORCE[1]:
        return []
    got = f"{ratio:.4g} times the ideal braid's force"
    if low < -FORCE[0] and ratio < FORCE[0]:
        got = f"{low:.4g} times the ideal braid's force"
        raise refuse("a muscle that pulls must have a positive `force`", got, file, "Turn its sign.")
    if ratio < FORCE[0] and not unstretched:
        return [f"`force` in {file} comes to {got}: the muscle is slack or very stiff, or a unit is wrong."]
    # What a pressure's slip does to the ideal force, it does inversely to the ratio.
    slips = [(1.0 / factor, name) for factor, name in _swapped("pressure", shown["pressure"])]
    slips += _swapped("force", shown["force"])
    raise refuse("force and pressure must fit the braid", got, file, _remedy(ratio, slips))


def _diameter(recording: Recording, entry: Entry, shown: dict[str, str], file: str) -> None:
    thread, turns = entry.braid
    ideal = np.sqrt(np.maximum(thread**2 - recording.length**2, 0.0)) / (math.pi * turns)
    ask = np.isfinite(recording.diameter) & (ideal > 0)
    if not ask.any():
        return
    ratio = float(np.median(recording.diameter[ask] / ideal[ask]))
    if DIAMETER[0] < ratio < DIAMETER[1]:
        return
    slips = [(0.5, "a radius"), (math.pi, "a circumference"), *_swapped("diameter", shown["diameter"])]
    got = f"{ratio:.4g} times the ideal braid's diameter"
    raise refuse("`diameter` must fit the braid", got, file, _remedy(ratio, slips))


def _gauge(recording: Recording, entry: Entry, file: str) -> list[str]:
    """Whether pressure counts from vacuum: near rest length the force then starts at one atmosphere.

    Rubber that is not stretched yet asks for no dead pressure, so rows near rest length tell.
    """
    area = _area(recording.length, entry)
    near = np.isfinite(recording.force * recording.pressure) & (
        recording.length > NEAR_REST * entry.rest_length.value
    )
    near &= area > 0
    pressure, push = recording.pressure[near], recording.force[near] / area[near]
    if near.sum() < 8 or np.ptp(pressure) < 0.5 * ATMOSPHERE:
        return []
    slope, offset = np.polyfit(pressure, push, 1)
    start = -offset / slope if slope else 0.0
    if (
        not 0.75 < slope < 1.25
        or abs(start - ATMOSPHERE) > START_NEAR
        or pressure.min() < ATMOSPHERE - START_NEAR
    ):
        return []
    vented = abs(pressure.min() - ATMOSPHERE) < VENT_NEAR
    remedy = "Subtract the atmosphere's 101 kPa if the gauge counts from vacuum."
    if not vented:
        begins = f"the force begins at {show(start, 'kPa', 3)}"
        return [f"`pressure` in {file} may be absolute: near rest length {begins}. {remedy}"]
    got = f"a force that begins at {show(start, 'kPa', 3)}"
    raise refuse("`pressure` must be gauge pressure", got, file, remedy)


def _area(length: np.ndarray, entry: Entry) -> np.ndarray:
    """(n,) m²: what the pressure of the ideal braid is multiplied by to give its force."""
    thread, turns = entry.braid
    return (3.0 * length**2 - thread**2) / (4.0 * math.pi * turns**2)


def _swapped(name: str, header: str) -> list[tuple[float, str]]:
    """By which factor a column comes out wrong when its numbers are in another unit than its header says."""
    true = [unit for unit in MIXED[name] if not math.isclose(in_unit(unit), in_unit(header))]
    return [
        (in_unit(header) / in_unit(unit), f"{name} in {unit} under a header of {header}") for unit in true
    ]


def _remedy(ratio: float, slips: list[tuple[float, str]]) -> str:
    """Name the slip whose factor is nearest, and its equals, as far as a weak muscle lets it be told."""
    check = "the braid's numbers in muscle.toml"
    off = [abs(math.log(ratio / factor)) if ratio > 0 else math.inf for factor, _ in slips]
    if min(off) > NAMED:
        return f"Check the units in the headers and {check}."
    likely = " or ".join(
        name for distance, (_, name) in zip(off, slips, strict=True) if distance < min(off) + 0.05
    )
    return f"It looks like {likely}; if it is not, check {check}."

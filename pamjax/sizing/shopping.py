"""Shopping list of a design, and the measurements that show whether the delivered parts suit it.

    tube      F = μ A (λ − 1/λ²) (1 − m + m/λ)     force that stretches a tube by the factor λ, uniaxial
    yarn      F = E A ε                            force that stretches a yarn by the strain ε

A: cross-section of the unstretched rubber, or solid cross-section of the yarn; μ, m: shear modulus and Mooney
fraction; E: modulus of the yarn. The lengths include an allowance for the fittings and for tests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pamjax.sizing.specification.parts import find_barb, find_sleeve
from pamjax.units import format_quantity

if TYPE_CHECKING:
    from pamjax.sizing.result import Design

#: Length of yarn beyond the muscle that a braid needs at both ends together, m.
_YARN_ALLOWANCE = 0.2
#: Length of tube for tests, m, and length under a fitting if the spec states none, m.
_TUBE_ALLOWANCE, _FITTING_LENGTH = 0.2, 15e-3
#: Stretch of a tube and strain of a yarn in the tests on arrival.
_TUBE_STRETCH, _YARN_STRAIN = 1.2, 0.005
#: Weighed length of yarn, m.
_WEIGHED_LENGTH = 10.0


@dataclass(frozen=True)
class Part:
    """A part to buy: its name, the quantity and a remark, as text."""

    name: str
    quantity: str
    remark: str


def list_parts(design: Design) -> list[Part]:
    """Return the parts of all muscles of a design."""
    n, choice = design.numbers, design.choice
    count, ends = choice.parallel, 2 * choice.parallel
    fitting = design.spec.fittings or _FITTING_LENGTH
    tube_length = count * (n["rest_length"] + 2 * fitting) + _TUBE_ALLOWANCE
    bobbin_length = count * (n["thread_length"] + _YARN_ALLOWANCE)
    mass = choice.threads * bobbin_length * n["thread_area"] * choice.thread.density
    diameter, bore = (format_quantity(n[name], "mm", 3) for name in ("diameter", "bore"))
    size = (
        f"outer diameter {diameter}, wall {format_quantity(n['wall'], 'mm', 3)}"
        if choice.tube is None
        else choice.tube.metric_size
    )
    thread = "yarn" if choice.yarn_count else "thread"
    parts = [
        Part(
            f"{choice.bladder.name} tube, {size}",
            f"{_round_up(tube_length)} m",
            "to be made: no size of the table" if choice.tube is None else f"outer diameter {diameter}",
        ),
        Part(
            f"{choice.thread.name} {thread}, {choice.describe_thread()}",
            f"{_round_up(choice.threads * bobbin_length)} m",
            f"{format_quantity(mass, 'g', 2)} in total; the braid needs {choice.threads} threads of"
            f" {_round_up(bobbin_length)} m",
        ),
    ]
    barb = find_barb(n["bore"])
    barb_name = f"hose barbs for {barb} tube" if barb else f"turned plugs for a bore of {bore}"
    parts.append(Part(barb_name, str(ends), "one bored and one closed for each muscle"))
    clamp = format_quantity(n["diameter"] + 2 * choice.diameter, "mm", 3)
    parts.append(Part("clamps", str(ends), f"ear clamps or crimped rings for {clamp}, over tube and braid"))
    return parts


def format_sleeve(design: Design) -> str:
    """Return a sentence on a ready sleeve that covers the diameters of the braid, or "" if none does."""
    n, choice = design.numbers, design.choice
    sleeve = find_sleeve("pet", n["diameter"], design.output("widest") - 2 * choice.diameter)
    if sleeve is None:
        return ""
    low, high = (f"{1e3 * diameter:.3g}" for diameter in (sleeve.low, sleeve.high))
    angles = f"{math.degrees(sleeve.angle_at_high):.0f} to {math.degrees(sleeve.angle_at_low):.0f}"
    return (
        f"A polyester sleeve for {low} to {high} mm (trade size {sleeve.size}, {angles} degrees) covers these"
        " diameters."
        " Its threads differ: measure them and size again."
    )


def list_checks(design: Design) -> list[str]:
    """Return the measurements on arrival, each with its expected value and range."""
    n, choice, build = design.numbers, design.choice, design.problem.build
    wall_error = choice.tube.wall_tolerance if choice.tube is not None else math.sqrt(3) * design.errors.wall
    rubber_area = math.pi * (n["diameter"] - n["wall"]) * n["wall"]
    stretch, m = _TUBE_STRETCH, float(build.mooney)
    factor = rubber_area * (stretch - stretch**-2) * (1 - m + m / stretch)
    shear, modulus = choice.bladder.modulus, choice.thread.modulus
    mass = _WEIGHED_LENGTH * n["thread_area"] * choice.thread.density
    pull = _YARN_STRAIN * n["thread_area"]
    angle = math.degrees(n["braid_angle"])
    return [
        f"Tube: outer diameter {format_quantity(n['diameter'], 'mm', 3)}, wall"
        f" {format_quantity(n['wall'], 'mm', 3)} ± {format_quantity(wall_error, 'mm', 2)},"
        " at four places.",
        f"Tube: {_format_forces(factor * build.shear, factor * shear.low, factor * shear.high)}"
        f" must stretch it by {100 * (stretch - 1):.0f} %.",
        f"Thread: {_WEIGHED_LENGTH:g} m must weigh {format_quantity(mass, 'g', 3)} ± 5 %.",
        f"Thread: {_format_forces(pull * build.modulus, pull * modulus.low, pull * modulus.high)}"
        f" must stretch one by {100 * _YARN_STRAIN:g} %.",
        f"Braid at rest length {format_quantity(n['rest_length'], 'mm')}: {n['turns']:.3g} turns of each"
        f" thread, {angle:.1f} degrees from the circumference.",
    ]


def _format_forces(force: float, low: float, high: float) -> str:
    low, high = min(low, force), max(high, force)
    return f"{format_quantity(force, 'N', 2)} (range {low:.2g} to {high:.2g} N)"


def _round_up(length: float) -> str:
    """Return a length in metres, rounded up to a decimetre."""
    return f"{math.ceil(10 * length - 1e-9) / 10:.1f}"

"""The wall of the bladder: an incompressible rubber tube in contact with the braid.

    λz = L / l                      stretch along
    λc = (R + Ri) / (ri + ro)       stretch around, at the middle of the wall
    λr = 1 / (λz λc)                stretch through the wall
    Ri² = R² − (ro² − ri²) / λz     inner radius: the volume of the rubber is constant

    L, R    length and outer radius of the deformed tube (R is that of the braid)   m
    l       length of the unstretched tube                                          m
    ri, ro  its radii, d/2 and d/2 + t                                              m

The strain at the middle of the wall is used for all of it. The energy is within 0.2 % of that of a thick
tube, for walls up to a seventh of the outer radius. With the outer radius the error would be 10 to 20 %.

Three mechanisms need the dimensions of the wall. They are declared once, here, and have the same names in
each mechanism.

Neglects: the thickness of the threads, folds, slip in the fittings, and the tube's own ends.
Source: incompressibility; the mid-surface form was compared with a thick tube.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter

#: Share of the unstretched bore, as an area, below which the bore decreases smoothly instead of vanishing.
_MIN_BORE_SHARE = 0.01


class WallSize(Protocol):
    """Dimensions of a wall, m."""

    inner_diameter: Scalar
    thickness: Scalar
    length: Scalar


def declare_inner_diameter() -> Scalar:
    return parameter(
        "m", show="mm", low=3e-4, high=1.0, scale="log", about="inner diameter of the unstretched bladder",
        source="from capillaries of miniature muscles to building scale", default=19.0e-3,
    )  # fmt: skip


def declare_thickness() -> Scalar:
    return parameter(
        "m", show="mm", low=1e-5, high=0.1, scale="log", about="wall thickness of the unstretched bladder",
        source="commonly 0.5 to 2.5 mm", default=1.6e-3,
    )  # fmt: skip


def declare_length() -> Scalar:
    return parameter(
        "m", show="mm", low=1e-3, high=20.0, scale="log", about="length of the unstretched bladder",
        source="that of the muscle at rest; less if the bladder is stretched at assembly", default=0.2,
    )  # fmt: skip


class Stretch(NamedTuple):
    """Stretches of the wall along, around, and through (below one)."""

    axial: Array
    hoop: Array
    radial: Array


def rubber_volume(wall: WallSize) -> Array:
    """Return the volume of the rubber, m³."""
    return jnp.pi * wall.thickness * (wall.inner_diameter + wall.thickness) * wall.length


def stretch(wall: WallSize, state: State) -> Stretch:
    """Return the stretches of the wall in a state.

    A braid that is too narrow for the rubber has no bore. There the bore decreases smoothly, so that energy
    and force are finite.
    """
    width = wall.inner_diameter + wall.thickness
    axial = state.length / wall.length
    bore = state.radius**2 - wall.thickness * width / axial
    floor = _MIN_BORE_SHARE / 4 * wall.inner_diameter**2
    closing = floor**2 / (2 * floor - jnp.minimum(bore, floor))
    inner = jnp.sqrt(jnp.where(bore > floor, bore, closing))
    hoop = (state.radius + inner) / width
    return Stretch(axial, hoop, 1 / (axial * hoop))


def first_invariant(stretch: Stretch) -> Array:
    """Return I1 − 3 = λz² + λc² + λr² − 3."""
    axial, hoop, radial = stretch
    # As squares, so that the energy of the unstretched wall is exactly zero.
    return (axial - 1) ** 2 + (hoop - 1) ** 2 + (radial - 1) ** 2 + 2 * (axial + hoop + radial - 3)


def second_invariant(stretch: Stretch) -> Array:
    """Return I2 − 3 = λz⁻² + λc⁻² + λr⁻² − 3."""
    axial, hoop, radial = stretch
    return (hoop * radial) ** 2 + (radial * axial) ** 2 + (axial * hoop) ** 2 - 3


def neo_hookean_stresses(stretch: Stretch) -> tuple[Array, Array]:
    """Return the stresses of a neo-Hookean wall, per modulus and rubber volume.

    They are the derivatives of (I1 − 3) / 2 by λz and λc. This function is convex: λz² and λc² are convex,
    and so is λr² = e^(−2 ln λz − 2 ln λc).
    """
    axial, hoop, radial = stretch
    return axial - radial**2 / axial, hoop - radial**2 / hoop

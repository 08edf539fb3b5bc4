"""Cones at the ends: their reduction of volume and of mean diameter."""

import math

import jax

from pamjax.model.mechanisms.end_cones import EndCones
from tests.agreement import ROUNDING, agree
from tests.model.mechanisms.triangle import state

#: Radius at 0.2 m, where 2πRN = 0.15 m, and of the fittings, m.
WIDE, FITTING = 0.15 / (2 * math.pi * 1.25), 0.012


def test_cones_reduce_volume_and_mean_diameter():
    # κ (R − Rf) high, twice: V −= (2π/3) κ (R − Rf)² (2R + Rf), D −= 2 κ (R − Rf)² / L.
    at = state(0.2)
    shape = EndCones(0.5, FITTING).shape(at)
    lost = 0.5 * (WIDE - FITTING) ** 2
    agree(shape.volume, at.volume - 2 * math.pi / 3 * lost * (2 * WIDE + FITTING), ROUNDING)
    agree(shape.diameter, 2 * WIDE - 2 * lost / 0.2, ROUNDING)
    for name in ("length", "thread", "turns", "radius"):
        agree(getattr(shape, name), getattr(at, name), ROUNDING)


def test_cones_reduce_the_force():
    """Section D3: ΔF = −κ P (R − Rf) L / (πN²)."""
    cones = EndCones(0.5, FITTING)
    slope = jax.grad(lambda length: cones.shape(state(length)).volume - state(length).volume)(0.2)
    agree(-slope, -0.5 * (WIDE - FITTING) * 0.2 / (math.pi * 1.25**2), ROUNDING)

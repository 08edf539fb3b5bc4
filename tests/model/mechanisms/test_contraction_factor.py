"""Tondu's factor: the volume of a cylinder at k times the contraction."""

import math

import jax

from pamjax.model.mechanisms.contraction_factor import ContractionFactor
from tests.agreement import ROUNDING, agree
from tests.model.mechanisms.triangle import state


def test_volume_is_that_at_k_times_the_contraction_over_k():
    # k = 1.25 from 0.24 m: Lk = 0.24 − 1.25 (0.24 − 0.20) = 0.19 m; V = Lk (B² − Lk²) / (4πN²) / k.
    at = state(0.2)
    shape = ContractionFactor(0.25, 0.24).shape(at)
    agree(shape.volume, 0.19 * (0.25**2 - 0.19**2) / (4 * math.pi * 1.25**2) / 1.25, ROUNDING)
    for name in ("length", "thread", "turns", "radius", "diameter"):
        agree(getattr(shape, name), getattr(at, name), ROUNDING)


def test_force_is_that_at_k_times_the_contraction():
    """Section D2: −∂V/∂L = (3 Lk² − B²) / (4πN²) per pascal."""
    factor = ContractionFactor(0.25, 0.24)
    slope = jax.grad(lambda length: factor.shape(state(length)).volume)(0.2)
    agree(-slope, (3 * 0.19**2 - 0.25**2) / (4 * math.pi * 1.25**2), ROUNDING)

"""The shape of a braid that is clamped at both ends, with frictionless crossings of threads.

In scaled numbers, with ν = 2πN, radii as ρ = ν r / B (the cosine of the local braid angle), lengths in B
and volumes in B³/(4πN²):

    λ    length, L/B
    ρf   radius of the fittings
    f    force over pressure, in π (B/ν)²

The triangle relation holds at every crossing, so that a meridian of slope r' = dr/dl along its thread has
z'² = 1 − ρ² − (ρ'/ν)². The volume ∫ρ² z' dl is the maximum at this λ. The number c is the radius in the
middle of a very long muscle, with m = c², σ² = 1 − m, u = m − ρ². The first integral of the maximum is

    f = 2 − 3m       z' = σ + u (σ² − u) / 2σ³       ρ' = ν u √g / 2σ³       g = (σ² + u)(3σ² − u)

where u² is the double root of a cubic. The differences from a cylinder are therefore integrals of regular
functions over ρ, computed by Gauss-Legendre quadrature:

    λ = σ + (2/ν) ∫ (σ² − u)/√g dρ                                            from ρf to c
    V = 2σ³ − f λ − (2/ν) ∫ u √((3σ² − u)/(σ² + u)) dρ + Δ                    −dV/dλ = f

Δ is the correction for a short muscle, whose ends influence each other. u decreases as U e^(−kl) from an end,
k = √3 ν c/σ. The slope is zero in the middle, so that u is a hyperbolic cosine, U / cosh(k/2) at mid-length:

    Δ = 3U² / (σ k (1 + e^k)),     ln U = ln uf + 2 ∫ (g − m (2σ² − u)) / (√g (√3 cσ² + ρ √g)) dρ

It is exact for a small bulge at any k, and for any bulge to the order e^(−2k). V is evaluated where it is
stationary in σ, so that −dV/dλ = f, and force and volume are consistent. On the paper's muscle, k = 4.4 at
rest, the force differs by less than 0.05 N from a net of rings. It is not valid for k < 3 (length over
diameter below tan²θ).

Neglects: friction of the crossings, and threads clamped at an angle.
Source: the first integral is that of a hydrostatic pantograph net. The rest is derived here, and compared
with the maximum volume of a net of rings.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from pamjax.parameter import Scalar

#: Nodes of the integrals.
_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(10)

#: Number of Newton steps for the middle, and the step in σ of their numerical slope.
_MIDDLE_NEWTON_STEPS, _SINE_STEP = 6, 1e-5

#: Minimum and maximum radius of the fittings over the largest radius of the braid.
_MIN_FITTING_RATIO, _MAX_FITTING_RATIO = 0.02, 0.95

#: Minimum slope of λ in σ. The net of a very short muscle may fold.
_MIN_LENGTH_SLOPE = 0.1


class Net(NamedTuple):
    """Volume (m³), mean radius along the axis and radius in the middle (m) of a net."""

    volume: Array
    mean_radius: Array
    mid_radius: Array


def solve_net(length: Scalar, thread: Scalar, turns: Scalar, fitting: Scalar) -> Net:
    """Return the net at a length (m) and a thread length (m), clamped on fittings of a radius (m).

    Where no such net exists (fittings wider than the braid, extreme lengths) the net is extrapolated with
    the force of the last valid one.
    """
    nu = 2 * jnp.pi * turns
    edge = jnp.clip(nu * fitting / thread, _MIN_FITTING_RATIO, _MAX_FITTING_RATIO)
    sine = _solve_middle_sine(length / thread, edge, nu)
    profile = _Profile(sine, edge, nu)
    unit = thread / nu
    bulge, decay = profile.bulge()
    ends = _end_volume(sine, edge, nu)
    volume = 2 * sine**3 - (2 - 3 * profile.square) * length / thread - profile.end_loss() + ends
    half_decay = jnp.exp(-decay / 2)
    middle = profile.square - 2 * bulge * half_decay / (1 + half_decay**2)
    mid = jnp.sqrt(jnp.maximum(middle, 0.01 * profile.square))
    return Net(unit**2 * jnp.pi * thread * volume, unit * profile.mean() / (length / thread), unit * mid)


def _solve_middle_sine(length: Scalar, edge: Scalar, nu: Scalar) -> Array:
    """Return the sine of the braid angle in the middle of a very long muscle."""
    length, edge, nu = (jnp.asarray(x, float) for x in (length, edge, nu))
    constants = jax.lax.stop_gradient((length, edge, nu))
    low = jnp.sqrt(0.26 * (1 - constants[1] ** 2))
    high = jnp.sqrt(1 - 0.1 * constants[1] ** 2)

    def compute_error_and_slope(sine):
        below, length_at_sine, above = jax.vmap(lambda s: scaled_length(s, *constants[1:]))(
            sine + _SINE_STEP * jnp.arange(-1.0, 2.0)
        )
        return length_at_sine - constants[0], jnp.maximum(
            (above - below) / (2 * _SINE_STEP), _MIN_LENGTH_SLOPE
        )

    def step(_, sine):
        error, slope = compute_error_and_slope(sine)
        return jnp.clip(sine - error / slope, low, high)

    sine = jax.lax.fori_loop(0, _MIDDLE_NEWTON_STEPS, step, jnp.clip(constants[0], low, high))
    sine = jax.lax.stop_gradient(sine)
    # The value has converged. One more step with the known slope gives σ its first derivative. V is
    # stationary in σ, so that its first three derivatives are then correct.
    final_slope = jax.lax.stop_gradient(compute_error_and_slope(sine)[1])
    return jnp.clip(sine - (scaled_length(sine, edge, nu) - length) / final_slope, low, high)


def _end_volume(sine: Array, edge: Scalar, nu: Scalar) -> Array:
    """Return Δ, the increase of volume because both ends influence the middle."""
    bulge, decay = _Profile(sine, edge, nu).bulge()
    return 3 * bulge**2 / (sine * decay) * jax.nn.sigmoid(-decay)


def scaled_length(sine: Array, edge: Scalar, nu: Scalar) -> Array:
    """Return λ at a σ, where the potential 2σ³ − f λ − … is stationary."""
    return _Profile(sine, edge, nu).length() + jax.grad(_end_volume)(sine, edge, nu) / (6 * sine)


class _Profile:
    """Integrals from the fitting to the middle, at one σ."""

    def __init__(self, sine: Array, edge: Scalar, nu: Scalar):
        self.sine, self.nu = sine, nu
        self.square = 1 - sine**2
        self.top = jnp.sqrt(self.square)
        self.edge = edge
        self.half_range = 0.5 * (self.top - edge)
        self.radius = edge + self.half_range * (1 + _GAUSS_NODES)
        self.below = (self.top - self.radius) * (self.top + self.radius)
        self.covariance_root = jnp.sqrt((sine**2 + self.below) * (3 * sine**2 - self.below))

    def integrate_both_ends(self, integrand: Array) -> Array:
        return 2 / self.nu * self.half_range * jnp.sum(_GAUSS_WEIGHTS * integrand)

    def length(self) -> Array:
        """Return λ of a very long muscle."""
        return self.sine + self.integrate_both_ends((self.sine**2 - self.below) / self.covariance_root)

    def end_loss(self) -> Array:
        """Return the decrease of the potential V + f λ by the ends."""
        return self.integrate_both_ends(self.below * self.covariance_root / (self.sine**2 + self.below))

    def mean(self) -> Array:
        """Return ∫ ρ dz."""
        squared = self.sine**2
        difference = self.radius * (squared - self.below) - 2 * squared**2 / (self.top + self.radius)
        return self.top * self.sine + self.integrate_both_ends(difference / self.covariance_root)

    def bulge(self) -> tuple[Array, Array]:
        """Return U and k."""
        squared = self.sine**2
        regular = self.covariance_root**2 - self.square * (2 * squared - self.below)
        divisor = self.covariance_root * (
            jnp.sqrt(3.0) * self.top * squared + self.radius * self.covariance_root
        )
        log = 2 * self.half_range * jnp.sum(_GAUSS_WEIGHTS * regular / divisor)
        at_edge = (self.top - self.edge) * (self.top + self.edge)
        return at_edge * jnp.exp(log), jnp.sqrt(3.0) * self.nu * self.top / self.sine

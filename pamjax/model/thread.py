"""Thread laws: load and stored energy of the threads as functions of strain.

A law is a load-strain curve `load(strain)`, as a tensile test measures it, and its integral
`energy(strain)`. Both are stated: a numerical derivative of the energy would lose digits at small
strains. `load` is the pull of *all* threads together, in N. Threads, area and modulus affect a muscle only
by their product (`stiffness` = n E A).

Each curve is convex for a positive strain. It ends in a straight line of slope `stiffness`, which meets zero
load at the strain `slack`. `balance.py` requires both properties.

Sources: linear, Chambers & Wereley, Actuators 2022, 11, 219, Eqs. 5-7. Toe forms: exponential toe
and line after Fung, Biomechanics (1993); recruitment of crimped filaments after Kastelic, Palley &
Baer, J. Biomech. 13, 887 (1980); the smooth bilinear form is a hyperbola, derived here.
"""

from __future__ import annotations

import abc
import math
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from pamjax.parameter import Scalar, parameter

_ROOT_TAU = math.sqrt(2 * math.pi)

_STIFFNESS_SOURCE = "wide range: aramid to nylon yarns, 1 to 150 GPa, and braids of 20 to 500 threads"
_CRIMP_SOURCE = (
    "crimp of Kevlar-49 fabric ends at 0.25 to 0.65 % strain (Zhu et al., Compos. Sci. Technol. 74, 2013)"
)


def _declare_stiffness() -> Scalar:
    return parameter(
        "N",
        show="MN",
        low=1e2,
        high=1e9,
        scale="log",
        about="pull of all threads together at unit strain, n E A",
        source=_STIFFNESS_SOURCE,
    )


class AbstractThread(eqx.Module):
    """A law of the load of all threads together at a strain.

    Attributes:
        stiffness: slope of the curve once the threads are straight, N.
        newton_steps: number of Newton steps from `initial_strain` to rounding error, for all permitted
            parameters.
    """

    newton_steps: ClassVar[int] = 8
    stiffness: eqx.AbstractVar[Scalar]

    @abc.abstractmethod
    def load(self, strain: Scalar) -> Array:
        """Return the pull of all threads together, N, at the strain B/B0 − 1."""

    @property
    @abc.abstractmethod
    def slack_strain(self) -> Array:
        """Return the strain at which the extrapolated straight line at the end of the curve has zero load."""

    @abc.abstractmethod
    def energy(self, strain: Scalar) -> Array:
        """Return the energy of all threads per metre of unloaded thread, J/m: the area under `load`."""

    def initial_strain(self, pull: Scalar) -> Array:
        """Return a start value for the strain that balances `pull` × (1 + strain).

        This one is the balance of the straight line at the end of the curve. It is too large, so that
        Newton's method descends a convex curve without overshoot.
        """
        return (pull + self.stiffness * self.slack_strain) / (self.stiffness - pull)


class Inextensible(eqx.Module):
    """Threads of constant length: the inelastic braid assumption.

    The strain is zero at every load. This law has no load curve, and so is no `AbstractThread`. Neglects:
    stretch.
    """

    def energy(self, strain: Scalar) -> Array:
        """Return zero, J/m."""
        return jnp.zeros_like(strain)


class LinearThread(AbstractThread):
    """Linear threads: load = S ε.

    Neglects: crimp, slip, creep.
    """

    stiffness: Scalar = _declare_stiffness()

    @property
    def slack_strain(self) -> Array:
        return jnp.asarray(0.0)

    def load(self, strain: Scalar) -> Array:
        return self.stiffness * strain

    def energy(self, strain: Scalar) -> Array:
        return 0.5 * self.stiffness * strain**2


class SmoothToe(AbstractThread):
    """Two straight lines joined by a hyperbola; all derivatives exist.

    load = S [ r ε + (1 − r) (ε + q(ε) − q(0)) / 2 ],   q(ε) = sqrt((ε − c)² + w²)

        S  stiffness   N   slope once the threads are straight
        r  toe_ratio   1   slope at zero strain over S, before rounding
        c  crimp       1   strain at the corner
        w  width       1   strain over which the corner is rounded

    A softplus is a common alternative. With the same gap at the corner its load differs by less than
    0.08 w S. But it needs an exponential and a logarithm in every Newton step. With a hyperbola the balance
    without other terms is a quadratic equation, and one Newton step is enough.

    Neglects: a toe whose own slope changes much (use `RecruitmentToe`). The rounding decreases
    with the square of the distance from the corner, so that a large width changes the slope at zero strain.
    """

    newton_steps: ClassVar[int] = 1

    stiffness: Scalar = _declare_stiffness()
    toe_ratio: Scalar = parameter(
        "1", low=0.02, high=1.0, neutral=1.0, about="slope of the toe over the slope of the straight thread",
        source="full range; 1 is a linear thread",
    )  # fmt: skip
    crimp: Scalar = parameter(
        "1",
        show="%",
        low=0.0,
        high=0.015,
        about="strain at which the threads are straight",
        source=_CRIMP_SOURCE,
    )
    width: Scalar = parameter(
        "1", show="%", low=1e-5, high=5e-3, scale="log", source="of the order of the crimp itself",
        about="strain over which the toe turns into the line",
    )  # fmt: skip

    @property
    def slack_strain(self) -> Array:
        return 0.5 * (1 - self.toe_ratio) * (self.crimp + jnp.hypot(self.crimp, self.width))

    def load(self, strain: Scalar) -> Array:
        square = self.crimp**2 + self.width**2
        ends = jnp.sqrt(square + strain * (strain - 2 * self.crimp)) + jnp.sqrt(square)
        # q(ε) − q(0) as a quotient: the difference would lose the digits of a small strain.
        toe = 0.5 * (1 + (strain - 2 * self.crimp) / ends)
        return self.stiffness * strain * (self.toe_ratio + (1 - self.toe_ratio) * toe)

    def energy(self, strain: Scalar) -> Array:
        def area(x):
            return 0.5 * (x * jnp.hypot(x, self.width) + self.width**2 * jnp.arcsinh(x / self.width))

        rounding_energy = (
            area(strain - self.crimp) - area(-self.crimp) - strain * jnp.hypot(self.crimp, self.width)
        )
        toe = 0.5 * (0.5 * strain**2 + rounding_energy)
        return self.stiffness * (0.5 * self.toe_ratio * strain**2 + (1 - self.toe_ratio) * toe)

    def initial_strain(self, pull: Scalar) -> Array:
        # S q(ε) in load(ε) = pull (1 + ε), squared: a ε² − 2 h ε − g = 0. Its positive root is the solution.
        p, k, q = pull / self.stiffness, 0.5 * (1 - self.toe_ratio), jnp.hypot(self.crimp, self.width)
        a = (1 - p) * (p - self.toe_ratio)
        g = p * (p + 2 * k * q)
        h = (p + k * q) * (p - self.toe_ratio - k) + k**2 * self.crimp
        root = jnp.sqrt(jnp.maximum(h**2 + a * g, 0.0))
        return jnp.where(h < 0, g / (root - h), (h + root) / a)


class ExponentialToe(AbstractThread):
    """An exponential toe that continues as a line of the same slope.

    load = (S/k) ( e^(k (min(ε, c) − c)) − e^(−k c) ) + S max(ε − c, 0)

        S  stiffness   N   slope of the line
        c  crimp       1   strain at which the toe ends
        k  curvature   1   relative change of slope for a unit strain in the toe

    Neglects: a smooth curvature; the slope is continuous, but the second derivative jumps at c.
    """

    newton_steps: ClassVar[int] = 3

    stiffness: Scalar = _declare_stiffness()
    crimp: Scalar = parameter(
        "1", show="%", low=0.0, high=0.015, neutral=0.0, about="strain at which the threads are straight",
        source=_CRIMP_SOURCE,
    )  # fmt: skip
    curvature: Scalar = parameter(
        "1", low=10.0, high=3000.0, scale="log", about="growth of the toe's slope for a unit strain",
        source="one to ten e-foldings over a crimp of 0.3 to 1 %",
    )  # fmt: skip

    @property
    def slack_strain(self) -> Array:
        return self.crimp + jnp.expm1(-self.curvature * self.crimp) / self.curvature

    def load(self, strain: Scalar) -> Array:
        toe = jnp.exp(-self.curvature * self.crimp) * jnp.expm1(
            self.curvature * jnp.minimum(strain, self.crimp)
        )
        return self.stiffness * (toe / self.curvature + jnp.maximum(strain - self.crimp, 0.0))

    def energy(self, strain: Scalar) -> Array:
        below, beyond = jnp.minimum(strain, self.crimp), jnp.maximum(strain - self.crimp, 0.0)
        end = jnp.exp(-self.curvature * self.crimp)
        toe = end * jnp.expm1(self.curvature * below) / self.curvature
        return self.stiffness * ((toe - end * below) / self.curvature + toe * beyond + 0.5 * beyond**2)

    def initial_strain(self, pull: Scalar) -> Array:
        # Newton's method descends an exponential in steps of 1/k. The inverse of the curve at a load that is
        # slightly too large is already close to the root.
        above = super().initial_strain(pull)
        load = self.curvature * pull * (1 + above) / self.stiffness
        toe = jnp.log1p(load * jnp.exp(self.curvature * self.crimp)) / self.curvature
        return jnp.where(toe < self.crimp, toe, above)


class RecruitmentToe(AbstractThread):
    """Filaments with normally distributed slack, each of which pulls when it is straight.

    load = S [ g(ε) − g(0) ],   g(ε) = (ε − μ) Φ(z) + s φ(z),   z = (ε − μ) / s

        S  stiffness   N   slope once all filaments are straight
        μ  crimp       1   mean slack of the filaments
        s  spread      1   standard deviation of their slack

    All derivatives exist. Neglects: friction between filaments.
    """

    newton_steps: ClassVar[int] = 5

    stiffness: Scalar = _declare_stiffness()
    crimp: Scalar = parameter(
        "1", show="%", low=0.0, high=0.015, about="mean slack of the filaments", source=_CRIMP_SOURCE
    )
    spread: Scalar = parameter(
        "1", show="%", low=1e-5, high=1e-2, scale="log", about="standard deviation of the filaments' slack",
        source="of the order of the mean slack",
    )  # fmt: skip

    def _standard_normal(self, strain: Scalar) -> tuple[Array, Array, Array]:
        z = (strain - self.crimp) / self.spread
        # erfc, because JAX's normal distribution takes seven times as long.
        return z, 0.5 * jax.lax.erfc(-z / math.sqrt(2)), jnp.exp(-0.5 * z**2) / _ROOT_TAU

    def _recruited_strain(self, strain: Scalar) -> Array:
        z, share, density = self._standard_normal(strain)
        return self.spread * (z * share + density)

    def _recruited_area(self, strain: Scalar) -> Array:
        z, share, density = self._standard_normal(strain)
        return 0.5 * self.spread**2 * ((z**2 + 1) * share + z * density)

    @property
    def slack_strain(self) -> Array:
        return self.crimp + self._recruited_strain(jnp.asarray(0.0))

    def load(self, strain: Scalar) -> Array:
        return self.stiffness * (self._recruited_strain(strain) - self._recruited_strain(jnp.asarray(0.0)))

    def energy(self, strain: Scalar) -> Array:
        zero = jnp.asarray(0.0)
        return self.stiffness * (
            self._recruited_area(strain) - self._recruited_area(zero) - strain * self._recruited_strain(zero)
        )

    def initial_strain(self, pull: Scalar) -> Array:
        # The inverse of g at a load that is slightly too large. With y = √(2π) g/s and t = −2 ln y, the
        # normal tail (z < 0) has z² = t − 2 ln(z² + …). The rational function of t in the second logarithm
        # is a fit for all t of double precision. Its z is too large, by at most 0.022/|z|. From a start below
        # the root Newton's method jumps far above it, and then descends the tail in steps of only 1/|z|.
        # Above z = 0, g is nearly a hyperbola. There z is too small by at most 0.08.
        load = pull * (1 + super().initial_strain(pull)) / self.stiffness + self._recruited_strain(
            jnp.asarray(0.0)
        )
        y = _ROOT_TAU * load / self.spread
        y = jnp.maximum(y, jnp.finfo(y.dtype).tiny)
        t = -2 * jnp.log(jnp.minimum(y, 1.0))
        square = t - 2 * jnp.log((1 + t * (0.589 + 0.084 * t)) / (1 + 0.084 * t))
        z = jnp.where(y < 1, -jnp.sqrt(jnp.maximum(square, 0.0)), (y - 1 / y) / _ROOT_TAU)
        # Without pull the root is exactly zero, also where g(0) is smaller than the least number.
        return jnp.where(pull > 0, self.crimp + self.spread * z, 0.0)

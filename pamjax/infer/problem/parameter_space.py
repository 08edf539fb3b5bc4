"""Free parameters of a fit: names, bounds, priors, and a smooth map from the real line.

A fit works on unbounded coordinates u. Each parameter is a smooth bounded function of its u,

    value = low + (high − low) σ(z)            scale "linear"
    value = low (high/low)^σ(z)                scale "log"        z = z0 + u · width

where z0 is its starting point. `width` makes a unit of u about one prior standard deviation, or a tenth of
the value or range without a prior. So all coordinates have similar scales.

A parameter without a Gaussian prior has a uniform prior between its bounds, on its own scale. In z this
is the density σ(z) (1 − σ(z)). Its logarithm enters the fit as the residual 2 sqrt(ln cosh(z/2)). It is
negligible where the data determine the parameter, and otherwise prevents divergence to infinity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.errors import BadInput
from pamjax.parameter import Meaning
from pamjax.units import format_quantity

#: A parameter is at its bound if the distance is less than this fraction of its range, on its own scale.
BOUND_MARGIN = 0.01


@dataclass(frozen=True)
class FreeParameter:
    """One parameter that a fit estimates.

    Attributes:
        name: as in muscle.toml; unique in its space.
        meaning: unit, bounds, scale.
        start: starting value of the fit, SI.
        sd: standard deviation of its Gaussian prior around `start`, SI; infinite for none.
    """

    name: str
    meaning: Meaning
    start: float
    sd: float = math.inf

    def __post_init__(self) -> None:
        low, high = self.meaning.low, self.meaning.high
        if not low < self.start < high:
            unit = self.meaning.show
            rule = (
                f"`{self.name}` must be between {format_quantity(low, unit)} and"
                f" {format_quantity(high, unit)}"
            )
            raise BadInput.from_rule(rule, format_quantity(self.start, unit), remedy="Check its unit.")


class ParameterSpace(eqx.Module):
    """All free parameters of a fit, in order; a pytree with static names.

    Attributes:
        names: (p,) names.
        log_scale: (p,) whether a parameter has a logarithmic scale.
        low, high: (p,) bounds, SI.
        mean, sd: (p,) Gaussian prior, SI; sd is infinite for a uniform prior.
        origin, width: (p,) the map from u to z.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    log_scale: tuple[bool, ...] = eqx.field(static=True)
    low: Float[Array, " p"]
    high: Float[Array, " p"]
    mean: Float[Array, " p"]
    sd: Float[Array, " p"]
    origin: Float[Array, " p"]
    width: Float[Array, " p"]

    @property
    def size(self) -> int:
        return len(self.names)

    def _compute_relative_position(self, value: Array) -> Array:
        """Return the position of a value between its bounds, on its own scale, in (0, 1)."""
        log = jnp.array(self.log_scale)
        safe = jnp.where(log, value, 1.0)
        low, high = jnp.where(log, self.low, 1.0), jnp.where(log, self.high, 2.0)
        linear_position = (value - self.low) / (self.high - self.low)
        return jnp.where(log, jnp.log(safe / low) / jnp.log(high / low), linear_position)

    # Compiled together: each operation alone is a program to load.
    @eqx.filter_jit
    def to_values(self, u: Float[Array, " p"]) -> Float[Array, " p"]:
        """Return the values, SI, at coordinates u."""
        position = jax.nn.sigmoid(self.origin + u * self.width)
        log = jnp.array(self.log_scale)
        low, high = jnp.where(log, self.low, 1.0), jnp.where(log, self.high, 2.0)
        return jnp.where(log, low * (high / low) ** position, self.low + (self.high - self.low) * position)

    def to_named_values(self, u: Float[Array, " p"]) -> dict[str, Array]:
        """Return the values by name, SI."""
        return dict(zip(self.names, self.to_values(u), strict=True))

    def to_point(self, values: Mapping[str, float]) -> Float[Array, " p"]:
        """Return the coordinates u of given values, SI."""
        target = jnp.array([values[n] for n in self.names], dtype=float)
        position = jnp.clip(self._compute_relative_position(target), 1e-9, 1 - 1e-9)
        return (jax.scipy.special.logit(position) - self.origin) / self.width

    def compute_prior_residual(self, u: Float[Array, " p"]) -> Float[Array, " p"]:
        """Return (value − mean) / sd of every parameter, or the residual of its uniform prior."""
        gaussian = (self.to_values(u) - self.mean) / self.sd
        return jnp.where(
            jnp.isfinite(self.sd), gaussian, _compute_uniform_residual(self.origin + u * self.width)
        )

    def compute_log_prior(self, u: Float[Array, " p"]) -> Array:
        """Return the log prior density of u, without the normalisation of truncated Gaussians.

        A density in u has the factor d value / d u.
        """
        z = self.origin + u * self.width
        log_share = jax.nn.log_sigmoid(z) + jax.nn.log_sigmoid(-z) + jnp.log(jnp.abs(self.width))
        value = self.to_values(u)
        log = jnp.array(self.log_scale)
        value_range = jnp.where(log, jnp.log(self.high / jnp.where(log, self.low, 1.0)), self.high - self.low)
        is_gaussian = jnp.isfinite(self.sd)
        sd = jnp.where(is_gaussian, self.sd, 1.0)
        log_slope = jnp.log(jnp.where(log, value, 1.0) * value_range) + log_share
        gaussian = -0.5 * ((value - self.mean) / sd) ** 2 - jnp.log(sd) - 0.5 * jnp.log(2 * jnp.pi)
        return jnp.sum(jnp.where(is_gaussian, gaussian + log_slope, log_share))

    def take_first(self, count: int) -> ParameterSpace:
        """Return the space of the first parameters."""
        arrays = (a[:count] for a in (self.low, self.high, self.mean, self.sd, self.origin, self.width))
        return ParameterSpace(self.names[:count], self.log_scale[:count], *arrays)

    def move_inside_bounds(self, u: Float[Array, " p"]) -> Float[Array, " p"]:
        """Return u with every parameter at its bound reset to its starting value.

        At a bound the slope of the map is almost zero, so that the minimiser cannot move the parameter.
        """
        return jnp.where(np.isin(self.names, self.find_names_at_bound(u)), 0.0, u)

    def find_names_at_bound(self, u: Float[Array, " p"]) -> list[str]:
        """Return the names of the parameters at one of their bounds."""
        position = np.asarray(self._compute_relative_position(self.to_values(u)))
        is_at_limit = (position < BOUND_MARGIN) | (position > 1 - BOUND_MARGIN)
        return [name for name, at_limit in zip(self.names, is_at_limit, strict=True) if at_limit]


def build_space(parameters: Sequence[FreeParameter]) -> ParameterSpace:
    """Return the space of free parameters.

    Raises:
        BadInput: if two have the same name.
    """
    names = tuple(n.name for n in parameters)
    for name in names:
        if names.count(name) > 1:
            raise BadInput.from_rule(
                "free parameters need different names", f"{name!r} twice", remedy="Rename one."
            )
    log = np.array([n.meaning.scale == "log" for n in parameters], dtype=bool)
    low = np.array([n.meaning.low for n in parameters], dtype=float)
    high = np.array([n.meaning.high for n in parameters], dtype=float)
    start = np.array([n.start for n in parameters], dtype=float)
    sd = np.array([n.sd for n in parameters], dtype=float)
    position, rate = _compute_position_and_rate(start, low, high, log)
    # dvalue/dz = rate · position (1 − position). A unit of u changes the value by one prior sd, at most by a
    # fifth of its range; without a prior by a tenth of the range, or of the value on a logarithmic scale.
    step = np.minimum(
        np.where(np.isfinite(sd), sd, np.where(log, 0.1 * start, 0.1 * (high - low))), 0.2 * (high - low)
    )
    width = step / (rate * position * (1 - position))
    arrays = (jnp.asarray(a) for a in (low, high, start, sd, np.log(position / (1 - position)), width))
    return ParameterSpace(names, tuple(bool(v) for v in log), *arrays)


def _compute_uniform_residual(z: Array) -> Array:
    """Return sign(z) 2 sqrt(ln cosh(z/2)): half its square is −ln of the density, up to a constant."""
    small = jnp.abs(z) < 1e-2
    safe = jnp.where(small, 1.0, jnp.abs(z))
    # ln cosh y = y + ln(1 + e^(−2y)) − ln 2; for small y its series y²/2 − y⁴/12.
    root = 2 * jnp.sqrt(0.5 * safe + jnp.log1p(jnp.exp(-safe)) - jnp.log(2.0))
    return jnp.where(small, z / jnp.sqrt(2.0) * (1 - z**2 / 48), jnp.sign(z) * root)


def _compute_position_and_rate(start, low, high, log):
    """Return the position of the start between its bounds, and d value / d position there."""
    safe_low, safe_high = np.where(log, low, 1.0), np.where(log, high, 2.0)
    ratio = np.log(safe_high / safe_low)
    relative_position = np.where(
        log, np.log(np.where(log, start, 1.0) / safe_low) / ratio, (start - low) / (high - low)
    )
    return relative_position, np.where(log, start * ratio, high - low)

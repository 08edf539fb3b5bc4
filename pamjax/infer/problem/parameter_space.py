"""The numbers a fit may move: names, limits, priors, and a smooth map from the whole real line.

A fit works on plain numbers u without limits. Each named number is a smooth bounded image of its u,

    value = low + (high − low) σ(z)            scale "linear"
    value = low (high/low)^σ(z)                scale "log"        z = z0 + u · width

where z0 is its starting point and `width` makes a unit of u about one prior standard deviation (or a
tenth, where there is no prior), so that every direction starts out equally long.

A number without a Gaussian prior is taken to be anywhere between its limits on its own scale. In z that
is the density σ(z) (1 − σ(z)), whose logarithm joins the fit as the residual 2 sqrt(ln cosh(z/2)):
next to nothing where the data speak, and enough to keep a number that they do not hold from running off.
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

from pamjax.errors import refuse
from pamjax.parameter import Meaning
from pamjax.units import format_quantity

#: Share of a number's range, on its own scale, within which it counts as sitting at a limit.
LIMIT_MARGIN = 0.01


@dataclass(frozen=True)
class FreeParameter:
    """One number that a fit may move.

    Attributes:
        name: as in muscle.toml; unique in its space.
        meaning: unit, limits, scale.
        start: where the fit starts, SI.
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
                f"`{self.name}` must lie between {format_quantity(low, unit)} and"
                f" {format_quantity(high, unit)}"
            )
            raise refuse(rule, format_quantity(self.start, unit), remedy="Check its unit.")


class ParameterSpace(eqx.Module):
    """All numbers a fit may move, in order; an array program with static names.

    Attributes:
        names: (p,) names.
        log_scale: (p,) whether a number moves on a logarithmic scale.
        low, high: (p,) limits, SI.
        mean, sd: (p,) Gaussian prior, SI; sd infinite where there is none.
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
        """Where a value sits between its limits on its own scale, in (0, 1)."""
        log = jnp.array(self.log_scale)
        safe = jnp.where(log, value, 1.0)
        low, high = jnp.where(log, self.low, 1.0), jnp.where(log, self.high, 2.0)
        straight = (value - self.low) / (self.high - self.low)
        return jnp.where(log, jnp.log(safe / low) / jnp.log(high / low), straight)

    def to_values(self, u: Float[Array, " p"]) -> Float[Array, " p"]:
        """Values, SI, of a point of the real line."""
        share = jax.nn.sigmoid(self.origin + u * self.width)
        log = jnp.array(self.log_scale)
        low, high = jnp.where(log, self.low, 1.0), jnp.where(log, self.high, 2.0)
        return jnp.where(log, low * (high / low) ** share, self.low + (self.high - self.low) * share)

    def to_named_values(self, u: Float[Array, " p"]) -> dict[str, Array]:
        """Values by name."""
        return dict(zip(self.names, self.to_values(u), strict=True))

    def to_point(self, values: Mapping[str, float]) -> Float[Array, " p"]:
        """The point of the real line at which the values are these."""
        wanted = jnp.array([values[n] for n in self.names], dtype=float)
        share = jnp.clip(self._compute_relative_position(wanted), 1e-9, 1 - 1e-9)
        return (jax.scipy.special.logit(share) - self.origin) / self.width

    def compute_prior_residual(self, u: Float[Array, " p"]) -> Float[Array, " p"]:
        """(value − mean) / sd of every number, or what stands for it where any value is as likely."""
        gaussian = (self.to_values(u) - self.mean) / self.sd
        return jnp.where(
            jnp.isfinite(self.sd), gaussian, _compute_uniform_residual(self.origin + u * self.width)
        )

    def compute_log_prior(self, u: Float[Array, " p"]) -> Array:
        """Logarithm of the prior density of u, up to the constant that the limits cut off a Gaussian.

        A residual says how unlikely a value is; a density in u needs d value / d u beside it.
        """
        z = self.origin + u * self.width
        log_share = jax.nn.log_sigmoid(z) + jax.nn.log_sigmoid(-z) + jnp.log(jnp.abs(self.width))
        value = self.to_values(u)
        log = jnp.array(self.log_scale)
        reach = jnp.where(log, jnp.log(self.high / jnp.where(log, self.low, 1.0)), self.high - self.low)
        known = jnp.isfinite(self.sd)
        sd = jnp.where(known, self.sd, 1.0)
        log_slope = jnp.log(jnp.where(log, value, 1.0) * reach) + log_share
        gaussian = -0.5 * ((value - self.mean) / sd) ** 2 - jnp.log(sd) - 0.5 * jnp.log(2 * jnp.pi)
        return jnp.sum(jnp.where(known, gaussian + log_slope, log_share))

    def take_first(self, count: int) -> ParameterSpace:
        """The first numbers alone."""
        arrays = (a[:count] for a in (self.low, self.high, self.mean, self.sd, self.origin, self.width))
        return ParameterSpace(self.names[:count], self.log_scale[:count], *arrays)

    def move_inside_limits(self, u: Float[Array, " p"]) -> Float[Array, " p"]:
        """A point to start from: a number at, or beyond, a limit goes back to where it began.

        There the map is so flat that nothing would bring it back.
        """
        return jnp.where(np.isin(self.names, self.find_names_at_limit(u)), 0.0, u)

    def find_names_at_limit(self, u: Float[Array, " p"]) -> list[str]:
        """Names that sit at one of their limits."""
        share = np.asarray(self._compute_relative_position(self.to_values(u)))
        stuck = (share < LIMIT_MARGIN) | (share > 1 - LIMIT_MARGIN)
        return [n for n, s in zip(self.names, stuck, strict=True) if s]


def build_space(parameters: Sequence[FreeParameter]) -> ParameterSpace:
    """A space of free numbers.

    Raises:
        BadInput: if two share a name.
    """
    names = tuple(n.name for n in parameters)
    for name in names:
        if names.count(name) > 1:
            raise refuse("every free number needs a name of its own", f"{name!r} twice")
    log = np.array([n.meaning.scale == "log" for n in parameters], dtype=bool)
    low = np.array([n.meaning.low for n in parameters], dtype=float)
    high = np.array([n.meaning.high for n in parameters], dtype=float)
    start = np.array([n.start for n in parameters], dtype=float)
    sd = np.array([n.sd for n in parameters], dtype=float)
    share, rate = _compute_position_and_rate(start, low, high, log)
    # dvalue/dz = rate · share (1 − share); a unit of u moves the value by one prior sd, at most by a
    # fifth of its range, and by a tenth of that range's natural step where nothing is known.
    step = np.minimum(
        np.where(np.isfinite(sd), sd, np.where(log, 0.1 * start, 0.1 * (high - low))), 0.2 * (high - low)
    )
    width = step / (rate * share * (1 - share))
    arrays = (jnp.asarray(a) for a in (low, high, start, sd, np.log(share / (1 - share)), width))
    return ParameterSpace(names, tuple(bool(v) for v in log), *arrays)


def _compute_uniform_residual(z: Array) -> Array:
    """2 sqrt(ln cosh(z/2)) with the sign of z: half its square is −ln of the density, up to a constant."""
    small = jnp.abs(z) < 1e-2
    safe = jnp.where(small, 1.0, jnp.abs(z))
    # ln cosh y = y + ln(1 + e^(−2y)) − ln 2; for small y its series y²/2 − y⁴/12.
    root = 2 * jnp.sqrt(0.5 * safe + jnp.log1p(jnp.exp(-safe)) - jnp.log(2.0))
    return jnp.where(small, z / jnp.sqrt(2.0) * (1 - z**2 / 48), jnp.sign(z) * root)


def _compute_position_and_rate(start, low, high, log):
    """Position of the start between its limits, and d value / d position there."""
    safe_low, safe_high = np.where(log, low, 1.0), np.where(log, high, 2.0)
    ratio = np.log(safe_high / safe_low)
    share = np.where(log, np.log(np.where(log, start, 1.0) / safe_low) / ratio, (start - low) / (high - low))
    return share, np.where(log, start * ratio, high - low)

"""The log-density of a posterior: what was believed, and every sample given the one before it.

All numbers, the muscle's and the noise's, live in one `Space`, so that a sampler walks on the whole real
line. One point is a pure function; the samplers `vmap` it.

Where the noise has more than one memory the innovations of `streams.py` still repeat each other. If
`worth` > `REPEATS` of them say what one independent one would, the log-likelihood of that channel counts
1/worth: the model that misses something slowly is not to be sure of itself. For noise as in `streams.py`
nothing is changed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.errors import nearest, refuse
from pamjax.infer.fitting.result import Fit
from pamjax.infer.posterior.ar1_likelihood import Stream, noise_numbers, worth
from pamjax.infer.problem.dataset import Member
from pamjax.infer.problem.parameter_space import Free, Space, space
from pamjax.parameter import Meaning

#: Innovations that repeat each other more than this are not taken for independent.
REPEATS = 1.5


class Density(eqx.Module):
    """A posterior, up to its constant.

    Attributes:
        members: the recordings, each sample that counts with weight one: their misfit is in SI.
        streams: for each member its channels.
        powers: for each member one over the worth of its channels' innovations.
        at: every number, the muscles' first.
    """

    members: tuple[Member, ...]
    streams: tuple[tuple[Stream, ...], ...]
    powers: tuple[tuple[Array, ...], ...]
    at: Space

    def samples(self, u: Float[Array, " p"]) -> list[list[Array]]:
        """Log-density of every sample given those before it, for each member and channel, (n,) each."""
        values = self.at.values(u)
        return [
            [stream.log_density(misfit, values) for stream, misfit in self._misfits(k, values)]
            for k in range(len(self.members))
        ]

    def _misfits(self, k: int, values: Array):
        misfit = self.members[k].misfit(values)
        return [(stream, misfit[stream.channel]) for stream in self.streams[k]]

    def log_likelihood(self, u: Float[Array, " p"]) -> Array:
        """Of all samples, each channel to its power; −∞ where the muscle has no solution."""
        parts = zip(self.samples(u), self.powers, strict=True)
        total = sum(p * jnp.sum(x) for xs, ps in parts for x, p in zip(xs, ps, strict=True))
        return jnp.where(jnp.isfinite(total), total, -jnp.inf)

    def __call__(self, u: Float[Array, " p"]) -> Array:
        """Logarithm of the posterior density of u, up to a constant."""
        total = self.at.log_prior(u) + self.log_likelihood(u)
        return jnp.where(jnp.isnan(total), -jnp.inf, total)

    def innovations(self, u: Float[Array, " p"]) -> list[list[Array]]:
        """What of every sample those before it did not foretell, in its own sd, (n,) each."""
        values = self.at.values(u)
        return [
            [stream.standard(misfit, values)[0] for stream, misfit in self._misfits(k, values)]
            for k in range(len(self.members))
        ]


@eqx.filter_jit
def log_densities(density: Density, u: Float[Array, "w p"]) -> Float[Array, " w"]:
    """The log-density at many points at once."""
    return jax.vmap(density)(u)


@eqx.filter_jit
def _innovations(density: Density, u: Float[Array, " p"]) -> list[list[Array]]:
    return density.innovations(u)


def density_of(fit: Fit, beliefs: Mapping[str, Mapping[str, Any]] | None = None) -> tuple[Density, Array]:
    """The posterior that belongs to a fit, and the fit's place in it.

    Args:
        fit: what was fitted, with a square loss.
        beliefs: by name what is believed instead: "value", "sd", "low" and "high", SI, each optional.

    Returns:
        the density and (p,) the point at which the muscle's numbers are the fit's.
    """
    if fit.loss != "square":
        remedy = "Fit with `--loss square`, or take the far samples out."
        raise refuse("a posterior needs a likelihood", f"a {fit.loss} loss", remedy=remedy)
    beliefs = dict(beliefs or {})
    numbers = [_believed(_free(name, e), beliefs.pop(name, None)) for name, e in fit.estimates.items()]
    found = fit.space.values(fit.solution.u)
    members, streams = [], []
    for one, member in zip(fit.cases, fit.members, strict=True):
        head = "" if len(fit.cases) == 1 else f"{one.case.name}/"
        noise, channels = noise_numbers(one.case, member, found, head, len(numbers))
        numbers += [_believed(n, beliefs.pop(n.name, None)) for n in noise]
        members.append(_in_si(member))
        streams.append(tuple(channels))
    if beliefs:
        name = next(iter(beliefs))
        raise refuse(
            f"{name!r} is no free number of this fit", remedy=nearest(name, [n.name for n in numbers])
        )
    at = space(numbers)
    powers = tuple(tuple(jnp.asarray(1.0) for _ in channels) for channels in streams)
    density = Density(tuple(members), tuple(streams), powers, at)
    start = {n.name: n.start for n in numbers} | dict(zip(fit.space.names, np.asarray(found), strict=True))
    return density, at.point({n.name: _inside(n, start[n.name]) for n in numbers})


def tempered(density: Density, u: Array, fit: Fit) -> Density:
    """The density with each channel counting for what its innovations at a point are worth."""
    powers = []
    found = _innovations(density, u)
    for one, channels, innovations in zip(fit.cases, density.streams, found, strict=True):
        said = [worth(np.asarray(w), s, one.case) for s, w in zip(channels, innovations, strict=True)]
        powers.append(tuple(jnp.asarray(1 / w if w > REPEATS else 1.0) for w in said))
    return eqx.tree_at(lambda d: d.powers, density, tuple(powers))


def _free(name: str, estimate) -> Free:
    return Free(name, estimate.meaning, estimate.prior, estimate.prior_sd)


def _believed(number: Free, belief: Mapping[str, Any] | None) -> Free:
    """The number under another belief."""
    if not belief:
        return number
    about: Meaning = number.meaning
    low, high = belief.get("low", about.low), belief.get("high", about.high)
    if not about.low <= low < high <= about.high:
        rule = f"the limits of `{number.name}` must rise and stay within what is physical"
        raise refuse(rule, f"{low:g} to {high:g} {about.unit}", "the priors")
    start = belief.get("value", min(max(number.start, low + 1e-3 * (high - low)), high - 1e-3 * (high - low)))
    about = replace(about, low=low, high=high)
    return Free(number.name, about, start, belief.get("sd", number.sd))


def _inside(number: Free, value: float) -> float:
    """A value brought a little inside its limits."""
    low, high = number.meaning.low, number.meaning.high
    reach = 1e-3 * (high - low)
    return number.start if not low + 1e-9 * reach < value < high - 1e-9 * reach else float(value)


def _in_si(one: Member) -> Member:
    """The member with weight one for every sample that counts, and zero for the others."""

    def there(weight):
        return jnp.where(weight > 0, one.rows.used, 0.0)

    new = (there(one.rows.force_weight), there(one.rows.diameter_weight))
    return eqx.tree_at(lambda m: (m.rows.force_weight, m.rows.diameter_weight), one, new)

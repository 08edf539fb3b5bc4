"""The log-density of a posterior: what was believed, and every sample given the one before it.

All numbers, the muscle's and the noise's, live in one `ParameterSpace`, so that a sampler walks on the whole
real
line. One point is a pure function; the samplers `vmap` it.

Where the noise has more than one memory the innovations of `ar1_likelihood.py` still repeat each other. If
`estimate_innovation_autocorrelation` > `MAX_WHITE_AUTOCORRELATION_TIME` of them say what one independent one
would, the log-likelihood of that channel counts
1/worth: the model that misses something slowly is not to be sure of itself. For noise as in
`ar1_likelihood.py`
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

from pamjax.errors import refuse, suggest_word
from pamjax.infer.fitting.result import Fit
from pamjax.infer.posterior.ar1_likelihood import (
    Ar1Likelihood,
    build_noise_parameters,
    estimate_innovation_autocorrelation,
)
from pamjax.infer.problem.dataset import Dataset
from pamjax.infer.problem.parameter_space import FreeParameter, ParameterSpace, build_space
from pamjax.parameter import Meaning

#: Innovations that repeat each other more than this are not taken for independent.
MAX_WHITE_AUTOCORRELATION_TIME = 1.5


class PosteriorDensity(eqx.Module):
    """A posterior, up to its constant.

    Attributes:
        datasets: the recordings, each sample that counts with weight one: their misfit is in SI.
        likelihoods: for each member its channels.
        powers: for each member one over the worth of its channels' innovations.
        space: every number, the muscles' first.
    """

    datasets: tuple[Dataset, ...]
    likelihoods: tuple[tuple[Ar1Likelihood, ...], ...]
    powers: tuple[tuple[Array, ...], ...]
    space: ParameterSpace

    def compute_sample_log_densities(self, u: Float[Array, " p"]) -> list[list[Array]]:
        """Log-density of every sample given those before it, for each member and channel, (n,) each."""
        values = self.space.to_values(u)
        return [
            [
                likelihood.compute_log_density(misfit, values)
                for likelihood, misfit in self._pair_residuals(k, values)
            ]
            for k in range(len(self.datasets))
        ]

    def _pair_residuals(self, k: int, values: Array):
        misfit = self.datasets[k].compute_standardised_residuals(values)
        return [(likelihood, misfit[likelihood.channel]) for likelihood in self.likelihoods[k]]

    def compute_log_likelihood(self, u: Float[Array, " p"]) -> Array:
        """Of all samples, each channel to its power; −∞ where the muscle has no solution."""
        parts = zip(self.compute_sample_log_densities(u), self.powers, strict=True)
        total = sum(p * jnp.sum(x) for xs, ps in parts for x, p in zip(xs, ps, strict=True))
        return jnp.where(jnp.isfinite(total), total, -jnp.inf)

    def __call__(self, u: Float[Array, " p"]) -> Array:
        """Logarithm of the posterior density of u, up to a constant."""
        total = self.space.compute_log_prior(u) + self.compute_log_likelihood(u)
        return jnp.where(jnp.isnan(total), -jnp.inf, total)

    def compute_innovations(self, u: Float[Array, " p"]) -> list[list[Array]]:
        """What of every sample those before it did not foretell, in its own sd, (n,) each."""
        values = self.space.to_values(u)
        return [
            [
                likelihood.standardise_innovations(misfit, values)[0]
                for likelihood, misfit in self._pair_residuals(k, values)
            ]
            for k in range(len(self.datasets))
        ]


@eqx.filter_jit
def compute_log_densities(density: PosteriorDensity, u: Float[Array, "w p"]) -> Float[Array, " w"]:
    """The log-density at many points at once."""
    return jax.vmap(density)(u)


@eqx.filter_jit
def _compute_innovations(density: PosteriorDensity, u: Float[Array, " p"]) -> list[list[Array]]:
    return density.compute_innovations(u)


def build_density(
    fit: Fit, priors: Mapping[str, Mapping[str, Any]] | None = None
) -> tuple[PosteriorDensity, Array]:
    """The posterior that belongs to a fit, and the fit's place in it.

    Args:
        fit: what was fitted, with a square loss.
        priors: by name what is believed instead: "value", "sd", "low" and "high", SI, each optional.

    Returns:
        the density and (p,) the point at which the muscle's numbers are the fit's.
    """
    if fit.loss != "square":
        remedy = "Fit with `--loss square`, or take the far samples out."
        raise refuse("a posterior needs a likelihood", f"a {fit.loss} loss", remedy=remedy)
    priors = dict(priors or {})
    parameters = [
        _apply_prior(_build_free_parameter(name, e), priors.pop(name, None))
        for name, e in fit.estimates.items()
    ]
    values = fit.space.to_values(fit.solution.u)
    datasets, likelihoods = [], []
    for case_fit, dataset in zip(fit.cases, fit.datasets, strict=True):
        prefix = "" if len(fit.cases) == 1 else f"{case_fit.case.name}/"
        noise, channels = build_noise_parameters(case_fit.case, dataset, values, prefix, len(parameters))
        parameters += [_apply_prior(n, priors.pop(n.name, None)) for n in noise]
        datasets.append(_set_unit_weights(dataset))
        likelihoods.append(tuple(channels))
    if priors:
        name = next(iter(priors))
        raise refuse(
            f"{name!r} is no free number of this fit", remedy=suggest_word(name, [n.name for n in parameters])
        )
    parameter_space = build_space(parameters)
    powers = tuple(tuple(jnp.asarray(1.0) for _ in channels) for channels in likelihoods)
    density = PosteriorDensity(tuple(datasets), tuple(likelihoods), powers, parameter_space)
    start = {n.name: n.start for n in parameters} | dict(
        zip(fit.space.names, np.asarray(values), strict=True)
    )
    return density, parameter_space.to_point({n.name: _clip_to_limits(n, start[n.name]) for n in parameters})


def temper_density(density: PosteriorDensity, u: Array, fit: Fit) -> PosteriorDensity:
    """The density with each channel counting for what its innovations at a point are worth."""
    powers = []
    all_innovations = _compute_innovations(density, u)
    for case_fit, channels, innovations in zip(fit.cases, density.likelihoods, all_innovations, strict=True):
        autocorrelation_times = [
            estimate_innovation_autocorrelation(np.asarray(w), s, case_fit.case)
            for s, w in zip(channels, innovations, strict=True)
        ]
        powers.append(
            tuple(
                jnp.asarray(1 / w if w > MAX_WHITE_AUTOCORRELATION_TIME else 1.0)
                for w in autocorrelation_times
            )
        )
    return eqx.tree_at(lambda d: d.powers, density, tuple(powers))


def _build_free_parameter(name: str, estimate) -> FreeParameter:
    return FreeParameter(name, estimate.meaning, estimate.prior, estimate.prior_sd)


def _apply_prior(parameter: FreeParameter, prior: Mapping[str, Any] | None) -> FreeParameter:
    """The number under another belief."""
    if not prior:
        return parameter
    about: Meaning = parameter.meaning
    low, high = prior.get("low", about.low), prior.get("high", about.high)
    if not about.low <= low < high <= about.high:
        rule = f"the limits of `{parameter.name}` must rise and stay within what is physical"
        raise refuse(rule, f"{low:g} to {high:g} {about.unit}", "the priors")
    start = prior.get(
        "value", min(max(parameter.start, low + 1e-3 * (high - low)), high - 1e-3 * (high - low))
    )
    about = replace(about, low=low, high=high)
    return FreeParameter(parameter.name, about, start, prior.get("sd", parameter.sd))


def _clip_to_limits(parameter: FreeParameter, value: float) -> float:
    """A value brought a little inside its limits."""
    low, high = parameter.meaning.low, parameter.meaning.high
    reach = 1e-3 * (high - low)
    return parameter.start if not low + 1e-9 * reach < value < high - 1e-9 * reach else float(value)


def _set_unit_weights(dataset: Dataset) -> Dataset:
    """The member with weight one for every sample that counts, and zero for the others."""

    def compute_mask(weight):
        return jnp.where(weight > 0, dataset.rows.training_mask, 0.0)

    new = (compute_mask(dataset.rows.force_weight), compute_mask(dataset.rows.diameter_weight))
    return eqx.tree_at(lambda m: (m.rows.force_weight, m.rows.diameter_weight), dataset, new)

"""Log-density of a posterior: the priors, and the likelihood of every sample given the earlier ones.

    ln p(u | data) = ln prior(u) + Σ over channels of power × Σ over samples of ln p(sample | earlier samples)

The coefficients of form errors are integrated out (`form_coefficients.py`).

The parameters of muscle and noise are in one `ParameterSpace`, with unbounded coordinates u.

The power of a channel is one for the noise of `ar1_likelihood.py`. With other noise, the innovations are
correlated. If their autocorrelation time exceeds `_MAX_WHITE_AUTOCORRELATION_TIME`, the power is one over it.
This widens the posterior.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.errors import BadInput, suggest_word
from pamjax.infer.fitting.result import Fit
from pamjax.infer.posterior.ar1_likelihood import (
    Ar1Likelihood,
    build_noise_parameters,
    estimate_innovation_autocorrelation,
)
from pamjax.infer.posterior.form_coefficients import (
    CoefficientDistribution,
    FormColumns,
    condition_coefficients,
)
from pamjax.infer.problem.dataset import Dataset
from pamjax.infer.problem.parameter_space import FreeParameter, ParameterSpace, build_space
from pamjax.jit import compile_on_call
from pamjax.parameter import Meaning

#: Largest autocorrelation time of innovations that count as independent, samples.
_MAX_WHITE_AUTOCORRELATION_TIME = 1.5

#: Distance from a bound, as a share of the range, below which a value is at the bound; covers rounding only.
_ROUNDING_TOLERANCE = 1e-12


class PosteriorDensity(eqx.Module):
    """Log-density of a posterior, up to a constant.

    Attributes:
        datasets: the recordings, with weight one for each informative sample, so that residuals are in SI.
        likelihoods: for each dataset the noise models of its channels.
        powers: for each dataset the powers of its channels' likelihoods.
        forms: for each dataset its form errors.
        space: all parameters, those of the muscles first.
    """

    datasets: tuple[Dataset, ...]
    likelihoods: tuple[tuple[Ar1Likelihood, ...], ...]
    powers: tuple[tuple[Array, ...], ...]
    forms: tuple[FormColumns, ...]
    space: ParameterSpace

    @property
    def has_form_errors(self) -> bool:
        """Return whether a dataset has form errors that are not zero."""
        return any(form.count for form in self.forms)

    def compute_sample_log_densities(
        self, u: Float[Array, " p"], coefficients: Sequence[Float[Array, " r"]]
    ) -> list[list[Array]]:
        """Return the log-density of every sample given the earlier ones, (n,) by dataset and channel.

        Args:
            u: unbounded coordinates of the parameters.
            coefficients: those of the form errors, by dataset.
        """
        values = self.space.to_values(u)
        return [
            self._compute_channel_log_densities(
                k, self._compute_residual(k, values) - self.forms[k].compute_form(coefficients[k]), values
            )
            for k in range(len(self.datasets))
        ]

    def _compute_residual(self, k: int, values: Array) -> Float[Array, "2 n"]:
        """Return measured − equation of one dataset, SI; zero for a sample that is not informative."""
        return jnp.stack(self.datasets[k].compute_standardised_residuals(values))

    def _compute_channel_log_densities(self, k: int, residual: Array, values: Array) -> list[Array]:
        return [
            likelihood.compute_log_density(residual[likelihood.channel], values)
            for likelihood in self.likelihoods[k]
        ]

    def compute_coefficients(self, k: int, values: Float[Array, " p"]) -> CoefficientDistribution:
        """Return the distribution of the form errors' coefficients of dataset k, given the values, SI."""
        return self._condition_coefficients(k, self._compute_residual(k, values), values)

    def _condition_coefficients(self, k: int, residual: Array, values: Array) -> CoefficientDistribution:
        return condition_coefficients(self.forms[k], residual, self.likelihoods[k], self.powers[k], values)

    def compute_log_likelihood(self, u: Float[Array, " p"]) -> Array:
        """Return the log-likelihood, each channel with its power; −∞ if the muscle has no solution."""
        values, total = self.space.to_values(u), jnp.asarray(0.0)
        for k, powers in enumerate(self.powers):
            residual = self._compute_residual(k, values)
            log_densities = self._compute_channel_log_densities(k, residual, values)
            total += sum(p * jnp.sum(x) for x, p in zip(log_densities, powers, strict=True))
            if self.forms[k].count:
                total += self._condition_coefficients(k, residual, values).log_factor
        return jnp.where(jnp.isfinite(total), total, -jnp.inf)

    def __call__(self, u: Float[Array, " p"]) -> Array:
        """Return the logarithm of the posterior density of u, up to a constant."""
        total = self.space.compute_log_prior(u) + self.compute_log_likelihood(u)
        return jnp.where(jnp.isnan(total), -jnp.inf, total)

    def compute_innovations(self, u: Float[Array, " p"]) -> tuple[list[list[Array]], list[Array]]:
        """Return innovations without the estimated form errors, and the estimated coefficients.

        With the estimate ĉ, |innovations|² + |ĉ|² is χ² of noise and form errors together, for powers of one.

        Args:
            u: unbounded coordinates of the parameters.

        Returns:
            the innovation of every sample in its own sd, (n,) by dataset and channel; and (r,) by dataset.
        """
        values = self.space.to_values(u)
        innovations, coefficients = [], []
        for k, form in enumerate(self.forms):
            residual, mean = self._compute_residual(k, values), jnp.zeros(0)
            if form.count:
                mean = self._condition_coefficients(k, residual, values).mean
                residual -= form.compute_form(mean)
            innovations.append(
                [s.standardise_innovations(residual[s.channel], values)[0] for s in self.likelihoods[k]]
            )
            coefficients.append(mean)
        return innovations, coefficients


@compile_on_call
def compute_log_densities(density: PosteriorDensity, u: Float[Array, "w p"]) -> Float[Array, " w"]:
    """Return the log-density at many points."""
    return jax.vmap(density)(u)


@compile_on_call
def _compute_innovations(density: PosteriorDensity, u: Float[Array, " p"]) -> list[list[Array]]:
    return density.compute_innovations(u)[0]


def build_density(
    fit: Fit, priors: Mapping[str, Mapping[str, Any]] | None = None
) -> tuple[PosteriorDensity, Array]:
    """Return the posterior density of a fit, and the fit's solution in its coordinates.

    Args:
        fit: the fit, with a square loss.
        priors: by name, priors that replace those of the fit: "value", "sd", "low" and "high", SI, each
            optional.

    Returns:
        the density, and (p,) the coordinates u of the fit's solution.
    """
    if fit.loss != "square":
        remedy = 'Fit with `loss="square"`, or remove the outliers.'
        raise BadInput.from_rule("a posterior needs a likelihood", f"a {fit.loss} loss", remedy=remedy)
    for case_fit in fit.cases:
        if case_fit.case.recording.measures_length:
            rule, got = (
                "a posterior needs a measured force or diameter",
                "a measured length ([test] of muscle.toml)",
            )
            raise BadInput.from_rule(
                rule, got, case_fit.case.name, "Use the standard deviations of `pamjax fit`."
            )
    priors = dict(priors or {})
    parameters = [
        _apply_prior(_build_free_parameter(name, e), priors.pop(name, None))
        for name, e in fit.estimates.items()
    ]
    values = fit.space.to_values(fit.solution.u)
    datasets, likelihoods, forms = [], [], []
    for case_fit, dataset in zip(fit.cases, fit.datasets, strict=True):
        prefix = "" if len(fit.cases) == 1 else f"{case_fit.case.name}/"
        noise, channels = build_noise_parameters(case_fit.case, dataset, values, prefix, len(parameters))
        parameters += [_apply_prior(n, priors.pop(n.name, None)) for n in noise]
        datasets.append(_set_unit_weights(dataset))
        likelihoods.append(tuple(channels))
        forms.append(FormColumns.from_filter(dataset.form_filter, dataset.rows.pressure.size))
    if priors:
        name = next(iter(priors))
        raise BadInput.from_rule(
            f"{name!r} is not a free parameter of this fit",
            remedy=suggest_word(name, [n.name for n in parameters]),
        )
    parameter_space = build_space(parameters)
    powers = tuple(tuple(jnp.asarray(1.0) for _ in channels) for channels in likelihoods)
    density = PosteriorDensity(tuple(datasets), tuple(likelihoods), powers, tuple(forms), parameter_space)
    start = {n.name: n.start for n in parameters} | dict(
        zip(fit.space.names, np.asarray(values), strict=True)
    )
    return density, parameter_space.to_point(
        {n.name: _replace_value_at_bound(n, start[n.name]) for n in parameters}
    )


def apply_autocorrelation_powers(density: PosteriorDensity, u: Array, fit: Fit) -> PosteriorDensity:
    """Return the density with each channel's power from its innovations' autocorrelation time at u."""
    powers = []
    all_innovations = _compute_innovations(density, u)
    for case_fit, channels, innovations in zip(fit.cases, density.likelihoods, all_innovations, strict=True):
        autocorrelation_times = [
            estimate_innovation_autocorrelation(np.asarray(w), s, case_fit.case)
            for s, w in zip(channels, innovations, strict=True)
        ]
        powers.append(
            tuple(
                jnp.asarray(1 / w if w > _MAX_WHITE_AUTOCORRELATION_TIME else 1.0)
                for w in autocorrelation_times
            )
        )
    return eqx.tree_at(lambda d: d.powers, density, tuple(powers))


def _build_free_parameter(name: str, estimate) -> FreeParameter:
    return FreeParameter(name, estimate.meaning, estimate.prior, estimate.prior_sd)


def _apply_prior(parameter: FreeParameter, prior: Mapping[str, Any] | None) -> FreeParameter:
    """Return the parameter with another prior."""
    if not prior:
        return parameter
    meaning: Meaning = parameter.meaning
    low, high = prior.get("low", meaning.low), prior.get("high", meaning.high)
    if not meaning.low <= low < high <= meaning.high:
        rule = f"the bounds of `{parameter.name}` must be ascending and within its physical bounds"
        remedy = "Change `low` or `high`."
        raise BadInput.from_rule(rule, f"{low:g} to {high:g} {meaning.unit}", "the priors", remedy)
    start = prior.get(
        "value", min(max(parameter.start, low + 1e-3 * (high - low)), high - 1e-3 * (high - low))
    )
    meaning = replace(meaning, low=low, high=high)
    return FreeParameter(parameter.name, meaning, start, prior.get("sd", parameter.sd))


def _replace_value_at_bound(parameter: FreeParameter, value: float) -> float:
    """Return the value, or the starting value of the parameter if the value is at or outside a bound."""
    low, high = parameter.meaning.low, parameter.meaning.high
    tolerance = _ROUNDING_TOLERANCE * (high - low)
    return float(value) if low + tolerance < value < high - tolerance else parameter.start


def _set_unit_weights(dataset: Dataset) -> Dataset:
    """Return the dataset with weight one for every informative sample, else zero, and no form errors."""

    def compute_mask(weight):
        return jnp.where(weight > 0, dataset.rows.training_mask, 0.0)

    dataset = replace(dataset, form_filter=None)
    new = (compute_mask(dataset.rows.force_weight), compute_mask(dataset.rows.diameter_weight))
    return eqx.tree_at(lambda m: (m.rows.force_weight, m.rows.diameter_weight), dataset, new)

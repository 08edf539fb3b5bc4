"""Result of sampling: draws of every parameter, their convergence, and a report."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from pamjax.drawing import DrawableResult
from pamjax.infer.fitting.result import Fit
from pamjax.infer.posterior.ar1_likelihood import find_noise_units
from pamjax.infer.posterior.convergence import ConvergenceDiagnostics
from pamjax.infer.posterior.form_sizes import FormErrorSize, compute_form_sizes
from pamjax.infer.posterior.identifiability_report import Verdict, build_verdicts
from pamjax.infer.posterior.laplace import GaussianApproximation
from pamjax.infer.posterior.log_density import PosteriorDensity
from pamjax.infer.posterior.predictive import draw_coefficients
from pamjax.notebook import NotebookText

#: Draws from which the sizes of the form errors are computed.
_SIZE_DRAWS = 400


@dataclass(frozen=True)
class Marginal:
    """Posterior of one parameter: mean, sd, median and the 90 % credible interval, SI."""

    mean: float
    sd: float
    median: float
    low: float
    high: float


def summarise_draws(draws: np.ndarray) -> Marginal:
    """Return the marginal posterior of one number from its draws, (n,)."""
    low, median, high = map(float, np.quantile(draws, (0.05, 0.5, 0.95)))
    return Marginal(float(draws.mean()), float(draws.std(ddof=1)), median, low, high)


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(DrawableResult, NotebookText):
    """Draws of the parameters of muscle and noise; prints as a report.

    Attributes:
        fit: the fit from which sampling started.
        density: the log-density; `density.space` has the parameters.
        gaussian: the Gaussian approximation that defines the sampler's coordinates.
        draws: (n, chains, p) values, SI, without burn-in.
        log_density: (n, chains) up to a constant, as a density of the unbounded coordinates u.
        stats: (n, chains) by name: "accepted", and for nuts "diverging" and "steps".
        convergence: effective sample size, split-R̂ and autocorrelation time.
        converged: whether the targets are met.
        targets: smallest effective sample size and largest split-R̂.
        sampler, seed: "emcee" or "nuts", and the seed.
        priors: priors that replace those of muscle.toml, SI.
    """

    fit: Fit
    density: PosteriorDensity = field(repr=False)
    gaussian: GaussianApproximation = field(repr=False)
    draws: np.ndarray = field(repr=False)
    log_density: np.ndarray = field(repr=False)
    stats: dict[str, np.ndarray] = field(repr=False)
    convergence: ConvergenceDiagnostics
    converged: bool
    targets: tuple[float, float]
    sampler: str
    seed: int
    priors: dict[str, dict[str, Any]]

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the parameters, the muscle's first."""
        return self.density.space.names

    def find_units(self, name: str) -> tuple[str, str]:
        """Return the SI unit and the display unit of a parameter."""
        if name in self.fit.estimates:
            meaning = self.fit.estimates[name].meaning
            return meaning.unit, meaning.show
        return find_noise_units(name)

    @cached_property
    def flat(self) -> np.ndarray:
        """Return the draws of all chains together, (draws, p), SI."""
        return self.draws.reshape(-1, self.draws.shape[2])

    @cached_property
    def marginals(self) -> dict[str, Marginal]:
        """Return the marginal posterior of each parameter, by name."""
        return dict(zip(self.names, map(summarise_draws, self.flat.T), strict=True))

    def draw_coefficients(self, values: np.ndarray) -> list[np.ndarray]:
        """Return draws of the form errors' coefficients, (draws, r) by case, at values, (draws, p), SI."""
        return [
            draw_coefficients(self.density, values, k, self.seed) for k in range(len(self.density.datasets))
        ]

    @cached_property
    def correlation(self) -> np.ndarray:
        """Return the correlation matrix of the parameters, (p, p)."""
        return np.corrcoef(self.flat, rowvar=False)

    @cached_property
    def form_errors(self) -> tuple[dict[str, FormErrorSize], ...]:
        """Return the sizes of the form errors by mechanism, for each case; empty for exact equations."""
        values = self.thin_draws(_SIZE_DRAWS)
        pairs = zip(self.fit.cases, self.fit.datasets, strict=True)
        return tuple(
            compute_form_sizes(self.density, case_fit, dataset, values, k, self.seed)
            for k, (case_fit, dataset) in enumerate(pairs)
        )

    @cached_property
    def verdicts(self) -> dict[str, Verdict]:
        """Return the identifiability of each of the muscle's parameters."""
        return build_verdicts(self.fit, self.density.space, self.flat)

    def thin_draws(self, count: int) -> np.ndarray:
        """Return (at most count, p) draws at equal distances over all chains, SI."""
        # A constant integer step could be a multiple of the number of chains, and select one chain only.
        rows = np.linspace(0, len(self.flat) - 1, min(count, len(self.flat))).round().astype(int)
        return self.flat[rows]

    def __str__(self) -> str:
        from pamjax.infer.posterior.report import format_posterior_summary

        return format_posterior_summary(self)

"""What a posterior says: draws of every number, how far they can be trusted, and a note."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from pamjax.infer.fitting.result import Fit
from pamjax.infer.posterior.ar1_likelihood import find_noise_units
from pamjax.infer.posterior.convergence import ConvergenceDiagnostics
from pamjax.infer.posterior.identifiability_report import Verdict, build_verdicts
from pamjax.infer.posterior.laplace import GaussianApproximation
from pamjax.infer.posterior.log_density import PosteriorDensity


@dataclass(frozen=True)
class Marginal:
    """One number's posterior: mean, sd, median and the 90 % interval, SI."""

    mean: float
    sd: float
    median: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Posterior:
    """Draws of the muscle's numbers and of the noise's; prints as a lab note.

    Attributes:
        fit: the fit it began from.
        density: its log-density; `density.at` names the numbers.
        gaussian: the Gaussian it was whitened with.
        draws: (n, chains, p) values, SI, without the first fifth.
        log_density: (n, chains) up to a constant, as a density of the plain numbers u.
        stats: (n, chains) by name: "accepted", and for nuts "diverging" and "steps".
        convergence: effective samples, split-R̂ and autocorrelation time.
        converged: whether that is as good as wanted.
        targets: effective samples and split-R̂ asked for.
        sampler, seed: "emcee" or "nuts", and the seed.
        priors: what was believed instead of muscle.toml, SI.
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
        """The numbers, the muscle's first."""
        return self.density.space.names

    def find_units(self, name: str) -> tuple[str, str]:
        """SI unit of a number, and the unit in which a person reads it."""
        if name in self.fit.estimates:
            about = self.fit.estimates[name].meaning
            return about.unit, about.show
        return find_noise_units(name)

    @cached_property
    def flat(self) -> np.ndarray:
        """(draws, p) of all chains together, SI."""
        return self.draws.reshape(-1, self.draws.shape[2])

    @cached_property
    def marginals(self) -> dict[str, Marginal]:
        """Each number's posterior, by name."""
        low, median, high = np.quantile(self.flat, (0.05, 0.5, 0.95), axis=0)
        rows = zip(self.flat.mean(0), self.flat.std(0, ddof=1), median, low, high, strict=True)
        return {name: Marginal(*map(float, row)) for name, row in zip(self.names, rows, strict=True)}

    @cached_property
    def correlation(self) -> np.ndarray:
        """(p, p) of the numbers, in their order."""
        return np.corrcoef(self.flat, rowvar=False)

    @cached_property
    def verdicts(self) -> dict[str, Verdict]:
        """Of each of the muscle's numbers: is it determined?"""
        return build_verdicts(self.fit, self.density.space, self.flat)

    def thin_draws(self, count: int) -> np.ndarray:
        """(count, p) draws spread evenly over the whole chain, SI; fewer where there are fewer."""
        n, chains, size = self.draws.shape
        every = max(1, n * chains // count)
        return self.draws.reshape(n * chains, size)[::every][:count]

    def __str__(self) -> str:
        from pamjax.infer.posterior.report import format_posterior_note

        return format_posterior_note(self)

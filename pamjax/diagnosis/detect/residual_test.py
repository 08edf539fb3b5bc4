"""Test of the residual of a model against noise and against the error of the mechanisms' equations."""

from __future__ import annotations

import numpy as np

from pamjax.diagnosis.detect.score_test import compute_score_directions
from pamjax.diagnosis.detect.significance import ResidualTest, compute_significance
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import evaluate_estimate
from pamjax.diagnosis.refit.model_fit import ModelFit, fit_model
from pamjax.diagnosis.settings import DiagnosisSettings


def run_baseline_test(problem: LibraryProblem, values: np.ndarray, seed: int = 0) -> ResidualTest:
    """Return the test of the baseline's residual along the score directions of all mechanisms.

    The test includes the held-out rows: a misfit can occur in these alone. It chooses no mechanism.

    Args:
        problem: the recording and the library.
        values: (p,) starting values of the fit to all rows, SI.
        seed: seed of the random draws for the p-value.
    """
    baseline = fit_model(problem, np.ones(problem.n, dtype=bool), (), values)
    return run_residual_test(problem, baseline, seed)


def run_residual_test(problem: LibraryProblem, fit: ModelFit, seed: int = 0) -> ResidualTest:
    """Return the test of a model's residual along the score directions of the mechanisms outside it.

    Args:
        problem: the recording and the library.
        fit: the refitted model.
        seed: seed of the random draws for the p-value.
    """
    directions = compute_score_directions(
        problem,
        fit.noise,
        fit.estimate,
        [candidate for candidate in build_candidates(problem) if candidate.id not in fit.ids],
    )
    return compute_significance(problem, fit.noise, fit.estimate, directions, seed)


def is_residual_significant(
    baseline_test: ResidualTest, residual_test: ResidualTest, settings: DiagnosisSettings
) -> bool:
    """Return whether a residual is significant and large: misfit that the mechanisms do not explain.

    A residual can be significant only because there are thousands of samples. It is then smaller than the
    error of a textbook equation and does not count as unexplained.

    Args:
        baseline_test: test of the baseline's residual.
        residual_test: test of the model's residual.
        settings: thresholds of the diagnosis.
    """
    return residual_test.p_value < settings.detection_p_value and is_residual_large(
        baseline_test, residual_test, settings
    )


def is_residual_large(
    baseline_test: ResidualTest, residual_test: ResidualTest, settings: DiagnosisSettings
) -> bool:
    """Return whether the rms of a residual is large compared with the noise and the baseline's residual."""
    residual_excess, baseline_excess = (
        max(residual_test.mean_square - 1, 0.0),
        max(baseline_test.mean_square - 1, 0.0),
    )
    return bool(
        residual_excess
        > max(settings.min_unexplained_rms**2, settings.min_unexplained_rms_share**2 * baseline_excess)
    )


def compute_residual_share(problem: LibraryProblem, baseline: ModelFit, model: ModelFit) -> float:
    """Return the share of the baseline's excess χ² that the model leaves, both with the baseline's noise."""
    baseline_excess, model_excess = (
        evaluate_estimate(problem, baseline.noise, fit.estimate.free, fit.estimate.values).chi2
        - baseline.noise.size
        for fit in (baseline, model)
    )
    return float(np.clip(model_excess / baseline_excess, 0.0, 1.0)) if baseline_excess > 0 else 0.0

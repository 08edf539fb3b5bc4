"""Comparison of two mechanisms on a recording, by the criterion of a diagnosis.

Each mechanism is added to the same model: the baseline with some other mechanisms. The other one is then
refitted with the noise of the better one, also in its place. Both fits include form errors, because real
effects depart from their equations. The BIC with form errors decides, as for the rivals in a diagnosis.

Neglects: a diagnosis selects mechanisms without its held-out rows. Here, all rows are used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pamjax.diagnosis.detect.residual_test import is_residual_significant, run_residual_test
from pamjax.diagnosis.detect.significance import ResidualTest
from pamjax.diagnosis.form_errors.fit import add_form_errors
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.next_experiment.experiment import fit_best_rival, fit_rival
from pamjax.diagnosis.refit.model_fit import ModelFit, fit_model
from pamjax.diagnosis.select.mechanism_refits import refit_fully
from pamjax.progress import Progress, ignore_progress


@dataclass(frozen=True, eq=False)
class PairComparison:
    """Fits of two mechanisms, each added to the same model, and their comparison.

    Attributes:
        fits: fit with the first and with the second mechanism, with the noise of the better one.
        better: index of the better fit.
        bic_difference: BIC of the second minus BIC of the first fit, with form errors.
        bic_limit: the recording distinguishes the two if their BIC differs by more than this.
        residual_tests: test of the residual of each fit, with form errors.
        neither_explains: whether the residuals of both are larger than noise and form errors.
    """

    fits: tuple[ModelFit, ModelFit]
    better: int
    bic_difference: float
    bic_limit: float
    residual_tests: tuple[ResidualTest, ResidualTest]
    neither_explains: bool

    @property
    def is_distinguished(self) -> bool:
        """Return whether the recording distinguishes the two, as in a diagnosis."""
        return abs(self.bic_difference) > self.bic_limit

    @property
    def chi2_difference(self) -> float:
        """Return χ² of the second minus χ² of the first fit, without form errors."""
        return float(self.fits[1].corrected_chi2 - self.fits[0].corrected_chi2)


def compare_pair(
    problem: LibraryProblem,
    first: str,
    second: str,
    mechanisms: Sequence[str] = (),
    progress: Progress = ignore_progress,
) -> PairComparison:
    """Return the comparison of two mechanisms on a recording.

    Args:
        problem: the recording and the library.
        first, second: ids of the mechanisms.
        mechanisms: ids of mechanisms in both models.
        progress: called with the current step and the completed fraction.
    """
    progress("fitting mechanisms", 0.05)
    baseline = fit_baseline(problem)
    fits = [_fit_in_both_orders(problem, baseline, id, mechanisms) for id in (first, second)]
    better = int(np.argmin([_compute_bic(problem, fit) for fit in fits]))
    progress("fitting mechanisms", 0.2)
    better_id, other_id = (first, second) if better == 0 else (second, first)
    rival_fit = fit_rival(problem, fits[better], better_id, other_id)
    assert rival_fit is not None
    # With the noise of its own residual, a worse model would hide its misfit in the noise.
    own_fit = replace(fits[1 - better], noise=fits[better].noise)
    fits[1 - better] = min(
        rival_fit, *refit_fully(problem, [own_fit]), key=lambda fit: _compute_bic(problem, fit)
    )
    form_fits = [add_form_errors(problem, fit) for fit in fits]
    progress("testing residuals", 0.3)
    first_test, second_test = (run_residual_test(problem, fit) for fit in form_fits)
    baseline_test = run_residual_test(problem, baseline)
    settings = problem.settings
    return PairComparison(
        (fits[0], fits[1]),
        better,
        float(form_fits[1].full_bic - form_fits[0].full_bic),
        # The limit of a diagnosis for rivals of a named mechanism.
        float(settings.tie_chi2 + settings.tie_excess_share * form_fits[better].excess_chi2),
        (first_test, second_test),
        all(is_residual_significant(baseline_test, test, settings) for test in (first_test, second_test)),
    )


def _fit_in_both_orders(
    problem: LibraryProblem, baseline: ModelFit, id: str, mechanisms: Sequence[str]
) -> ModelFit:
    """Return the better fit of a mechanism and others, added before it or after it.

    One order can end at a local minimum.
    """
    fits = []
    for order in dict.fromkeys([(*mechanisms, id), (id, *mechanisms)]):
        fit = baseline
        for each in order:
            fit = fit_mechanism(problem, fit, each)
        fits.append(fit)
    return min(fits, key=lambda fit: _compute_bic(problem, fit))


def _compute_bic(problem: LibraryProblem, fit: ModelFit) -> float:
    """Return the BIC with form errors and with the log-determinant of the noise."""
    return add_form_errors(problem, fit).full_bic


def fit_baseline(problem: LibraryProblem) -> ModelFit:
    """Return the fit of the baseline model alone."""
    return fit_model(problem, np.ones(problem.n, dtype=bool), (), problem.neutral)


def fit_mechanism(problem: LibraryProblem, reduced_fit: ModelFit, id: str) -> ModelFit:
    """Return the fit of a model with one more mechanism in its best form."""
    candidates = [candidate for candidate in build_candidates(problem) if candidate.id == id]
    start_fit = fit_best_rival(problem, reduced_fit, candidates)
    return fit_model(problem, np.ones(problem.n, dtype=bool), start_fit.mechanisms, start_fit.estimate.values)

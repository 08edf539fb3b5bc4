"""The rest: whether what a model leaves of a recording is more than noise and the rough edges of forms."""

from __future__ import annotations

from pamjax.diagnosis.detect.score_test import compute_score_directions
from pamjax.diagnosis.detect.significance import DETECTION_P_VALUE, Significance, compute_significance
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.candidate_fit import CandidateFit

#: A rest counts as unexplained from this rms, in noise standard deviations ...
MIN_UNEXPLAINED_RMS = 0.3
#: ... and this share of the baseline's own: textbook forms leave a tenth of what they explain.
MIN_UNEXPLAINED_RMS_SHARE = 0.15


def run_residual_test(problem: LibraryProblem, fit: CandidateFit, seed: int = 0) -> Significance:
    """What a model leaves, judged along every form that is not in it.

    Args:
        problem: the recording before the library.
        fit: refitted.
        seed: of the draws behind the p-value.
    """
    directions = compute_score_directions(
        problem,
        fit.noise,
        fit.estimate,
        [candidate for candidate in build_candidates(problem) if candidate.id not in fit.ids],
    )
    return compute_significance(problem, fit.noise, fit.estimate, directions, seed)


def is_residual_significant(mismatch: Significance, residual_test: Significance) -> bool:
    """Whether what the names leave, or all of it where there is none, is more than the rough edges of forms.

    A mismatch that only thousands of samples together show is detected, and too faint to be called none
    of what is known: some textbook form would come as near.

    Args:
        mismatch: of the baseline.
        residual_test: of the model.
    """
    return residual_test.p_value < DETECTION_P_VALUE and is_residual_large(mismatch, residual_test)


def is_residual_large(mismatch: Significance, residual_test: Significance) -> bool:
    """Whether what is left would be more, were all of it known not to be noise."""
    residual_excess, mismatch_excess = (
        max(residual_test.mean_square - 1, 0.0),
        max(mismatch.mean_square - 1, 0.0),
    )
    return bool(residual_excess > max(MIN_UNEXPLAINED_RMS**2, MIN_UNEXPLAINED_RMS_SHARE**2 * mismatch_excess))

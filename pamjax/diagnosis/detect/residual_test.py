"""The rest: whether what a model leaves of a recording is more than noise and the rough edges of forms."""

from __future__ import annotations

from pamjax.diagnosis.detect.score_test import signatures
from pamjax.diagnosis.detect.significance import DETECTED, Significance, significance
from pamjax.diagnosis.library.candidates import forms
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.refit.candidate_fit import Model

#: A rest counts as unexplained from this rms, in noise standard deviations ...
REST = 0.3
#: ... and this share of the baseline's own: textbook forms leave a tenth of what they explain.
REST_SHARE = 0.15


def rest_of(found: Problem, model: Model, seed: int = 0) -> Significance:
    """What a model leaves, judged along every form that is not in it.

    Args:
        found: the recording before the library.
        model: refitted.
        seed: of the draws behind the p-value.
    """
    seen = signatures(found, model.white, model.at, [f for f in forms(found) if f.id not in model.ids])
    return significance(found, model.white, model.at, seen, seed)


def leaves_more(mismatch: Significance, rest: Significance) -> bool:
    """Whether what the names leave, or all of it where there is none, is more than the rough edges of forms.

    A mismatch that only thousands of samples together show is detected, and too faint to be called none
    of what is known: some textbook form would come as near.

    Args:
        mismatch: of the baseline.
        rest: of the model.
    """
    return rest.p_value < DETECTED and leaves_much(mismatch, rest)


def leaves_much(mismatch: Significance, rest: Significance) -> bool:
    """Whether what is left would be more, were all of it known not to be noise."""
    beyond, before = max(rest.square - 1, 0.0), max(mismatch.square - 1, 0.0)
    return bool(beyond > max(REST**2, REST_SHARE**2 * before))

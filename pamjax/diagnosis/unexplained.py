"""Unexplained part of a misfit: its reasons, and the probability of an effect outside the library."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING

from pamjax.text import format_p_value

if TYPE_CHECKING:
    from pamjax.diagnosis.result import Diagnosis

#: Shares of recordings with an effect outside the library, by the result. Measured with seeds 97 and 101 of
#: the bank of other forms (63 of 66, 19 of 23, 2 of 211), of which 28 % have such an effect. By the rule of
#: succession, k of n give (k + 1) / (n + 2). Source: docs/statistics.md.
_OUTSIDE_SHARE_WITHOUT_NAMES = 0.94
_OUTSIDE_SHARE_BESIDE_NAMES = 0.80
_OUTSIDE_SHARE_IF_EXPLAINED = 0.014


class UnexplainedReason(Enum):
    """Reason for which a part of the misfit counts as unexplained; its value is a clause."""

    RESIDUAL = "the residual test is significant also with the mechanisms"
    TEMPLATE = "an effect outside the library explains the misfit better than a mechanism"
    LEFT_OUT_BLOCKS = (
        "in cross-validation, the mechanisms do not explain most of the misfit of the left-out blocks"
    )
    HELD_OUT_ERROR = "the error of the held-out blocks is much larger than expected"
    INCREASED_ERROR = "the mechanisms increase the error of the held-out blocks"


def state_unexplained_reason(diagnosis: Diagnosis) -> str:
    """Return the reason as a clause; "" if nothing is unexplained."""
    reason = diagnosis.unexplained_reason
    if reason is UnexplainedReason.RESIDUAL and not diagnosis.named_mechanisms:
        return "no mechanism explains the significant misfit of the baseline"
    return reason.value if reason else ""


def compute_unexplained_probability(diagnosis: Diagnosis) -> float:
    """Return the probability that physics outside the library is in the recording.

    It depends only on the two decisions of the diagnosis, and not on the size of the residual.
    """
    if not diagnosis.unexplained:
        return _OUTSIDE_SHARE_IF_EXPLAINED
    return _OUTSIDE_SHARE_BESIDE_NAMES if diagnosis.named_mechanisms else _OUTSIDE_SHARE_WITHOUT_NAMES


def describe_unexplained_probability(diagnosis: Diagnosis) -> str | None:
    """Return the share of simulated recordings as a sentence; None if no simulated recording is similar.

    Without time, many mechanisms of the library are not tested, and can be the unexplained part.
    """
    if not diagnosis.unexplained or not diagnosis.problem.case.recording.has_time:
        return None
    share = compute_unexplained_probability(diagnosis)
    return (
        f"Of simulated recordings with such a result, {100 * share:.0f} % have an effect outside the library."
    )


def describe_unexplained_reason(diagnosis: Diagnosis) -> str | None:
    """Return a sentence on the reason; None if nothing is unexplained or named."""
    reason = diagnosis.unexplained_reason
    if reason is None:
        return None
    if reason is UnexplainedReason.RESIDUAL and not diagnosis.named_mechanisms:
        # The residual is that of the baseline: the test of the misfit has its own sentence.
        return None
    p_text = format_p_value(diagnosis.residual_test.p_value)
    if reason is UnexplainedReason.RESIDUAL:
        return f"Reason: {reason.value} ({p_text})."
    if diagnosis.residual_test.p_value < diagnosis.settings.detection_p_value:
        return f"Reason: {reason.value}."
    return f"The residual test is not significant ({p_text}), but {reason.value}."

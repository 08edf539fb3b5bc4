"""Reasons for which a part of a misfit counts as unexplained, and their sentences."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING

from pamjax.text import format_p_value

if TYPE_CHECKING:
    from pamjax.diagnosis.result import Diagnosis


class UnexplainedReason(Enum):
    """Reason for which a part of the misfit counts as unexplained; its value is a clause."""

    RESIDUAL = "the residual test is significant also with the mechanisms"
    TEMPLATE = "an effect outside the library explains the misfit better than a mechanism"
    LEFT_OUT_BLOCKS = "the mechanisms do not predict most of the misfit of blocks that a fit leaves out"
    HELD_OUT_ERROR = "the error of the held-out blocks is much larger than expected"
    INCREASED_ERROR = "the mechanisms increase the error of the held-out blocks"


def state_unexplained_reason(diagnosis: Diagnosis) -> str:
    """Return the reason as a clause; "" if nothing is unexplained."""
    reason = diagnosis.unexplained_reason
    if reason is UnexplainedReason.RESIDUAL and not diagnosis.named_mechanisms:
        return "no mechanism explains the significant misfit of the baseline"
    return reason.value if reason else ""


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

"""Predicted lengths of an isotonic test that no braid can have.

The predicted length is one Newton step from the measured one (`model/isotonic.py`). Where the stiffness of
the model is almost zero, the step can leave the range of the geometry: 0 < L < thread length.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.infer.problem.informative_samples import find_informative_samples
from pamjax.units import format_quantity

if TYPE_CHECKING:
    from pamjax.infer.fitting.result import CaseFit

#: Stretch of a thread up to which a predicted length counts as possible.
_MAX_STRETCH = 0.02


def _find_impossible_lengths(length: np.ndarray, thread_length: float) -> np.ndarray:
    """Return which predicted lengths no braid can have, (n,); False for blanks.

    Args:
        length: (n,) predicted lengths, m.
        thread_length: length of one thread, m.
    """
    with np.errstate(invalid="ignore"):
        return (length <= 0) | (length > (1 + _MAX_STRETCH) * thread_length)


def describe_impossible_lengths(case_fit: CaseFit) -> str | None:
    """Return a warning on predicted lengths that the geometry excludes; None without them."""
    if not case_fit.case.recording.measures_length:
        return None
    thread_length = float(case_fit.muscle.thread_length)
    informative = find_informative_samples(case_fit.case, "length")
    kinds = {"predicted": case_fit.prediction, "predicted held-out": case_fit.held_out_prediction}
    for kind, prediction in kinds.items():
        if "length" not in prediction:
            continue
        is_impossible = informative & _find_impossible_lengths(prediction["length"], thread_length)
        if is_impossible.any():
            limit = format_quantity(thread_length, DISPLAY_UNIT["length"], 4)
            count = f"{int(is_impossible.sum())} of {int(informative.sum())}"
            return (
                f"{count} {kind} lengths are impossible (not between 0 and the thread length, {limit}):"
                " do not use this fit to predict lengths"
            )
    return None

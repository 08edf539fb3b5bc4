"""Rows of a recording by their use in a fit: used, without a value, or without information."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pamjax.infer.problem.informative_samples import find_informative_samples, find_slack_samples
from pamjax.records.case import Case


def describe_unused_rows(case: Case) -> Iterator[str]:
    """Return a line for each channel with rows that a fit does not use: all rows, used rows, reasons.

    A row is not used without a value of the channel, of pressure or of length, or if it is an outlier. It is
    not used either if its value does not depend on the parameters; see `find_informative_samples`.

    Args:
        case: the recording and its muscle.toml.
    """
    for channel in case.recording.model_channels:
        is_used = find_informative_samples(case, channel)
        has_value = case.recording.usable & np.isfinite(getattr(case.recording, channel))
        if case.recording.measures_length:
            has_value &= np.isfinite(case.recording.force)
        is_slack = has_value & ~is_used & find_slack_samples(case)
        reasons = {
            "without information (slack muscle)": is_slack,
            "without information (pressure near zero)": has_value & ~is_used & ~is_slack,
            "without a value": ~has_value,
        }
        counts = [f"{count} {reason}" for reason, rows in reasons.items() if (count := int(rows.sum()))]
        if counts and has_value.any():
            yield f"{channel}: {case.recording.n} rows, {int(is_used.sum())} used, {', '.join(counts)}"

"""Summary of a recording before a fit: rows, ranges, outliers, blocks and identifiability."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pamjax.infer.fitting.determination import classify_sd_ratio
from pamjax.infer.fitting.identifiability import ParameterIdentifiability
from pamjax.infer.problem.row_counts import describe_unused_rows
from pamjax.model.parameters import find_meaning
from pamjax.notebook import NotebookText
from pamjax.records.blocks import find_blocks
from pamjax.records.case import Case
from pamjax.records.long_recording import advise_reduction
from pamjax.records.reading.muscle_toml import describe_unused_bladder
from pamjax.units import compute_si_factor, format_count, format_quantity

#: Effects that depend on the order of the samples.
EFFECTS_OVER_TIME = "friction, damping, relaxation, delays and drift"


@dataclass(frozen=True, repr=False)
class CaseSummary(NotebookText):
    """Result of `pamjax check`; prints as a report.

    Attributes:
        case: the recording and its muscle.toml.
        parameters: identifiability of each parameter.
        sentences: the same in words.
        mechanisms: ids of the mechanisms in the model.
    """

    case: Case
    parameters: list[ParameterIdentifiability]
    sentences: list[str]
    mechanisms: Sequence[str] = ()

    def __str__(self) -> str:
        # The text of the case includes the outliers.
        lines = [str(self.case), *(f"  {line}" for line in describe_unused_rows(self.case))]
        lines += [f"  {self._format_blocks()}", ""]
        width = max((len(d.name) for d in self.parameters), default=0)
        lines += [f"  {self._format_parameter(d, max(width, 22))}" for d in self.parameters]
        notes = describe_unused_bladder(self.case.muscle_toml, self.mechanisms)
        notes += advise_reduction(self.case.recording)
        if not self.case.recording.has_time:
            notes.append(f"Without the column `time`, a diagnosis cannot test {EFFECTS_OVER_TIME}.")
        return "\n".join([*lines, "", *self.sentences, *notes, "The case can be fitted."])

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as a JSON document, in display units."""
        recording = self.case.recording
        return {
            "case": self.case.name,
            "rows": recording.n,
            "channels": list(recording.channels),
            "blocks": {"kind": find_blocks(recording).kind, "names": list(find_blocks(recording).names)},
            "set_aside": [str(a) for a in recording.outliers],
            "warnings": list(self.case.warnings),
            "numbers": {d.name: self._build_row(d) for d in self.parameters},
            "says": self.sentences,
        }

    def _format_blocks(self) -> str:
        case_blocks = find_blocks(self.case.recording)
        missing = int((~self.case.recording.usable).sum())
        lack = "lacks" if missing == 1 else "lack"
        tail = f"; {format_count(missing, 'row')} {lack} pressure or length" if missing else ""
        return (
            f"{format_count(len(case_blocks.names), case_blocks.kind.removesuffix('s'))}"
            f" for cross-validation{tail}"
        )

    def _format_parameter(self, d: ParameterIdentifiability, width: int) -> str:
        unit = find_meaning(d.name).show
        prior_sd = f"± {format_quantity(d.prior_sd, unit, 2)}" if math.isfinite(d.prior_sd) else "unknown"
        expected_sd = (
            f"± {format_quantity(d.expected_sd, unit, 2)}" if np.isfinite(d.expected_sd) else "unknown"
        )
        kind = classify_sd_ratio(d.sd_ratio)
        expected = f"{expected_sd:>14} expected after a fit without misfit"
        return f"{d.name:<{width}} {prior_sd:>14} prior, {expected}: {kind}"

    def _build_row(self, d: ParameterIdentifiability) -> dict[str, Any]:
        unit = find_meaning(d.name).show
        scale = compute_si_factor(unit)
        return {
            "unit": unit,
            "sd_before": d.prior_sd / scale if math.isfinite(d.prior_sd) else None,
            "sd_after_at_best": d.expected_sd / scale if np.isfinite(d.expected_sd) else None,
            "determined": d.is_determined,
        }

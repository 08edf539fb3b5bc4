"""A recording before it is fitted: rows, ranges, outliers, blocks, and what it could determine."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pamjax.infer.fitting.identifiability import Determination
from pamjax.model.parameters import meaning
from pamjax.records.blocks import blocks
from pamjax.records.case import Case
from pamjax.units import in_unit, many, show


@dataclass(frozen=True)
class Inspection:
    """What `pamjax check` says; prints as a note."""

    case: Case
    numbers: list[Determination]
    sentences: list[str]

    def __str__(self) -> str:
        # What was set aside is among the case's own notes.
        lines = [str(self.case), f"  {self._blocks()}", ""]
        lines += [f"  {self._number(d)}" for d in self.numbers]
        return "\n".join([*lines, "", *self.sentences, "Fit to be fitted."])

    def as_dict(self) -> dict[str, Any]:
        """For programs; numbers in the units in which a person reads them."""
        recording = self.case.recording
        return {
            "case": self.case.name,
            "rows": recording.n,
            "channels": list(recording.channels),
            "blocks": {"kind": blocks(recording).kind, "names": list(blocks(recording).names)},
            "set_aside": [str(a) for a in recording.aside],
            "warnings": list(self.case.warnings),
            "numbers": {d.name: self._row(d) for d in self.numbers},
            "says": self.sentences,
        }

    def _blocks(self) -> str:
        found = blocks(self.case.recording)
        missing = int((~self.case.recording.usable).sum())
        lack = "lacks" if missing == 1 else "lack"
        tail = f"; {many(missing, 'row')} {lack} pressure or length" if missing else ""
        return f"{many(len(found.names), found.kind.removesuffix('s'))} to hold out in turn{tail}"

    def _number(self, d: Determination) -> str:
        unit = meaning(d.name).show
        before = f"± {show(d.before, unit, 2)}" if math.isfinite(d.before) else "unknown"
        after = f"± {show(d.after, unit, 2)}" if np.isfinite(d.after) else "unknown"
        verdict = "determined" if d.determined else "not determined"
        return f"{d.name:<22} {before:>14} before, {after:>14} after at best: {verdict}"

    def _row(self, d: Determination) -> dict[str, Any]:
        unit = meaning(d.name).show
        scale = in_unit(unit)
        return {
            "unit": unit,
            "sd_before": d.before / scale if math.isfinite(d.before) else None,
            "sd_after_at_best": d.after / scale if np.isfinite(d.after) else None,
            "determined": d.determined,
        }

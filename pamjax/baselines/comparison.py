"""Beside the gain: what a formula and a flexible curve make of the same held-out rows.

| split         | held out                                            | asks                         |
|---------------|-----------------------------------------------------|------------------------------|
| held out      | the diagnosis' own blocks, inside the range         | is it good between settings? |
| extrapolation | the highest pressure, or the most contracted length | is it good beyond them?      |

The baseline, the baseline with names, Sárosi's formula (force alone) and the baseline with a Gaussian
process on its residual are each fitted without the held-out rows. On the first split no choice has seen
them either; on the second the names are those of the diagnosis, and only their numbers are refitted.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.baselines.empirical import fit_sarosi
from pamjax.baselines.gaussian_process import discrepancy, inputs
from pamjax.channels import DISPLAY_UNIT, to_display
from pamjax.diagnosis.crossval.gain import rmse
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.refit.candidate_fit import settle
from pamjax.diagnosis.refit.misfit_weighting import weighed
from pamjax.diagnosis.result import Diagnosis
from pamjax.errors import BadInput
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.records.files import write_beside
from pamjax.records.levels import find_levels, on_levels
from pamjax.units import show

SCHEMA = "pamjax.gain/1"

HELD_OUT, EXTRAPOLATION = "held out", "extrapolation"
BASELINE, NAMED, SAROSI, PROCESS = "baseline", "named", "sarosi", "gaussian_process"

#: How a model is called before people.
TITLE = {
    BASELINE: "baseline",
    NAMED: "with names",
    SAROSI: "Sárosi's formula",
    PROCESS: "a Gaussian process",
}

#: Fewer settings than this leave none to go beyond.
ENOUGH = 3
#: Share of the range of contraction that is held out where nothing settles.
BEYOND = 0.2


@dataclass(frozen=True, eq=False)
class Split:
    """One question, and how each model answers it.

    Attributes:
        name: "held out" or "extrapolation".
        rows: what was held out, in words.
        out: (n,) which rows.
        rmse: by model, then channel, SI; a model that cannot be fitted is missing.
        remarks: by model, what to know of its fit.
    """

    name: str
    rows: str
    out: np.ndarray
    rmse: dict[str, dict[str, float]]
    remarks: dict[str, str]


@dataclass(frozen=True, eq=False)
class Contest:
    """The splits of one recording, with the noise that nobody can beat, by channel, SI."""

    splits: tuple[Split, ...]
    noise: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """As it stands in gain.json."""
        return {
            "schema": SCHEMA,
            "noise": {c: {"sd": to_display(c, v), "unit": DISPLAY_UNIT[c]} for c, v in self.noise.items()},
            "splits": [
                {
                    "name": split.name,
                    "rows": split.rows,
                    "rmse": {
                        model: {
                            c: {"value": to_display(c, v), "unit": DISPLAY_UNIT[c]} for c, v in by.items()
                        }
                        for model, by in split.rmse.items()
                    },
                    "remarks": split.remarks,
                }
                for split in self.splits
            ],
        }

    def __str__(self) -> str:
        """Two lines a channel: the rivals on the rows of the diagnosis, and everybody beyond."""
        lines = []
        for split in self.splits:
            for channel in (c for c in self.noise if c in split.rmse[BASELINE]):
                models = [m for m in split.rmse if split.name != HELD_OUT or m in (SAROSI, PROCESS)]
                told = [_score(split, m, channel) for m in models if channel in split.rmse[m]]
                if told:
                    lines.append(f"  {_asked(split)}: {channel} by {', '.join(told)} {DISPLAY_UNIT[channel]}")
        return "\n".join(lines)


def _asked(split: Split) -> str:
    return "the same rows" if split.name == HELD_OUT else f"{split.rows}, held out"


def _score(split: Split, model: str, channel: str) -> str:
    star = "*" if model in split.remarks else ""
    off = to_display(channel, split.rmse[model][channel])
    return f"{TITLE[model]} {off:.3g}{star}" if off < 1000 else f"{TITLE[model]} {off:.0f}{star}"


def contest(one: Diagnosis, seed: int = 0) -> Contest:
    """Hold a diagnosis' model against a formula and a Gaussian process, between settings and beyond them.

    Args:
        one: the diagnosis.
        seed: of the Gaussian process' search.
    """
    found, gain = one.found, one.gain
    splits = []
    if gain.held_out.any():
        rows = gain.blocks.split(": ")[-1]
        splits.append(_split(one, HELD_OUT, rows, gain.held_out, gain.before, gain.after, seed))
    far, words = beyond(found)
    if far.any():
        before, after = _refitted(one, far)
        splits.append(_split(one, EXTRAPOLATION, words, far, before, after, seed))
    noise = {}
    for c, channel in enumerate(CHANNELS):
        colour, rows = one.model.white.colours[c], one.model.white.rows[c]
        if colour is not None:
            noise[channel] = float(np.sqrt(np.mean(colour.sd[rows] ** 2)))
    return Contest(tuple(splits), noise)


def beyond(found: Problem) -> tuple[np.ndarray, str]:
    """(n,) the rows at the end of what was measured, and what they are, in words; none where that is all."""
    recording = found.case.recording
    seen = np.isfinite(found.measured).any(axis=0)
    for channel, what, end in ((recording.pressure, "kPa", max), (recording.length, "mm", min)):
        label = np.where(seen, on_levels(channel, levels := find_levels(channel, recording.has_time)), -1)
        settings = np.unique(label[label >= 0])
        if settings.size >= ENOUGH:
            last = end(settings.tolist())
            kind = "the highest isobar" if what == "kPa" else "the most contracted length"
            return label == last, f"{kind}, {show(float(levels[last]), what, 3)}"
    low, high = np.nanquantile(recording.length[seen], [0.0, 1.0]) if seen.any() else (0.0, 0.0)
    short = seen & (recording.length < low + BEYOND * (high - low))
    return short, f"lengths below {show(low + BEYOND * (high - low), 'mm', 3)}"


def _refitted(one: Diagnosis, out: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Predictions of the baseline and of the named model, both refitted without some rows."""
    found = one.found
    before = settle(found, ~out, (), one.baseline.at.values)
    shown = found.shows(before.at.values)
    if not one.names:
        return shown, shown
    after = weighed(found, ~out, one.model.chosen, one.naming.values)
    return shown, found.shows(after.at.values)


def _split(one: Diagnosis, name, rows: str, out: np.ndarray, before, after, seed: int) -> Split:
    found = one.found
    shown: dict[str, np.ndarray] = {BASELINE: before}
    remarks: dict[str, str] = {}
    if one.names:
        shown[NAMED] = after
    try:
        force, remark = _sarosi(found, ~out)
        shown[SAROSI] = np.stack([force, np.full(found.n, np.nan)])
        remarks |= {SAROSI: remark} if remark else {}
    except BadInput:
        pass
    x, left = inputs(found), found.measured - before
    learnt = [
        discrepancy(x, left[c], ~out, seed) if _enough(left[c], ~out) else left[c] * np.nan for c in (0, 1)
    ]
    shown[PROCESS] = before + np.stack(learnt)
    return Split(name, rows, out, {m: rmse(found, v, out) for m, v in shown.items()}, remarks)


def _enough(left: np.ndarray, told: np.ndarray) -> bool:
    return int(np.count_nonzero(np.isfinite(left) & told)) >= ENOUGH


def _sarosi(found: Problem, told: np.ndarray) -> tuple[np.ndarray, str]:
    recording = found.case.recording
    contraction = 1 - recording.length / found.case.entry.rest_length.value
    force = np.where(told, found.measured[0], np.nan)
    law = fit_sarosi(recording.pressure, contraction, force)
    return law.force(recording.pressure, contraction), (
        "its exponent ran to an end of its range" if law.at_limit else ""
    )


def save_contest(held: Contest, folder: Path) -> Path:
    """Write gain.json, beside and then renamed."""
    path = folder / "gain.json"
    with write_beside(path) as beside:
        beside.write_text(json.dumps(held.as_dict(), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return path

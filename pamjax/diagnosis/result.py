"""A diagnosis: what it holds, how it prints, and how it stands in diagnosis.json and prediction.csv."""

from __future__ import annotations

import io
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pamjax.channels import DISPLAY_UNIT, to_display
from pamjax.diagnosis.crossval.gain import Gain
from pamjax.diagnosis.detect.locate import Box
from pamjax.diagnosis.detect.significance import DETECTED, Significance
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.next_experiment.experiment import Experiment
from pamjax.diagnosis.refit.candidate_fit import Model
from pamjax.diagnosis.refit.least_squares import AT_LIMIT, driven
from pamjax.diagnosis.saved_model import improved
from pamjax.diagnosis.select.selection import Name, Naming
from pamjax.infer.fitting.report import quantity
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.model.registry import mechanism
from pamjax.parameter import Meaning
from pamjax.records.blocks import Blocks
from pamjax.records.files import write_beside
from pamjax.units import in_unit

SCHEMA = "pamjax.diagnosis/1"


#: Most lines of the verdict on a screen.
LINES = 25

#: Most notes below it.
NOTES = 3


@dataclass(frozen=True)
class Number:
    """A number with its standard deviation, SI; NaN where that is not defined."""

    value: float
    sd: float
    meaning: Meaning
    at_limit: bool = False


@dataclass(frozen=True)
class Moved:
    """A baseline parameter before and after naming, SI, and the shift in standard deviations of before."""

    before: float
    after: float
    shift: float
    meaning: Meaning


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What a recording says of its model.

    Attributes:
        found: the recording before the library.
        naming: what was named, from the rows that were not held out.
        model: the named model, refitted to every row.
        baseline: the baseline, refitted to every row.
        mismatch: the baseline's residual, judged.
        where: boxes of the mismatch.
        rest: the named model's residual, judged.
        unexplained: whether something is left that no name explains.
        rest_where: boxes of that.
        rest_share: share of the excess misfit that is left.
        blocks: the blocks of the recording.
        gain: before and after on held-out blocks.
        parameters: of each name, by id, the amplitude first.
        moved: the baseline's parameters before and after.
        notes: what the reader of the case noticed, what the recording cannot tell, what it drives too far.
        experiments: what to do next.
    """

    found: Problem
    naming: Naming
    model: Model
    baseline: Model
    mismatch: Significance
    where: list[Box]
    rest: Significance
    unexplained: bool
    rest_where: list[Box]
    rest_share: float
    blocks: Blocks
    gain: Gain
    parameters: dict[str, dict[str, Number]]
    moved: dict[str, Moved]
    notes: list[str]
    experiments: list[Experiment]

    @property
    def names(self) -> tuple[Name, ...]:
        """What the model holds, most probable first."""
        return self.naming.names

    @property
    def detected(self) -> bool:
        """Whether there is a mismatch beyond noise."""
        return bool(self.mismatch.p_value < DETECTED)

    @property
    def faint(self) -> bool:
        """Whether the mismatch is beyond noise, and yet too small to be named or called unexplained."""
        return self.detected and not self.names and not self.unexplained

    def as_dict(self) -> dict[str, Any]:
        """The verdict as `pamjax.diagnosis/1`."""
        return {
            "schema": SCHEMA,
            "case": self.found.case.name,
            "baseline": {
                "model": self.found.law,
                "parameters": {n: _number(v) for n, v in baseline_numbers(self).items()},
                "rmse": {c: _in_unit(c, v) for c, v in _rmse(self.found, self.baseline).items()},
            },
            "noise": _noise(self),
            "mismatch": {
                "detected": self.detected,
                "p_value": self.mismatch.p_value,
                "where": [_box(b) for b in self.where] if self.detected else [],
            },
            "missing_physics": [_name(self, name) for name in self.naming.established],
            "unexplained": {
                "detected": self.unexplained,
                "p_value": self.rest.p_value,
                "share": self.rest_share,
                "where": [_box(b) for b in self.rest_where] if self.unexplained else [],
            },
            "improvement": {"held_out": {"blocks": self.gain.blocks} | _improvement(self.gain)},
            "parameters_moved": {n: _moved(m) for n, m in self.moved.items()},
            "next_experiment": [e.as_dict() for e in self.experiments],
        }

    def predictions(self) -> pd.DataFrame:
        """One line a row: what was predicted before and after, held-out rows by fits that never saw them."""
        recording, gain = self.found.case.recording, self.gain
        columns: dict[str, Any] = {
            "row": recording.row,
            "block": [self.blocks.names[k] if k >= 0 else "" for k in self.blocks.label],
            "held_out": gain.held_out.astype(int),
        }
        for c, channel in enumerate(CHANNELS):
            for when, prediction in (("before", gain.before), ("after", gain.after)):
                columns[f"{channel}_{when} [{DISPLAY_UNIT[channel]}]"] = to_display(channel, prediction[c])
        return pd.DataFrame(columns)

    def __str__(self) -> str:
        return "\n".join(_lines(self)[:LINES])


def save(diagnosis: Diagnosis, folder: Path) -> list[Path]:
    """Write diagnosis.json, prediction.csv and the improved model, each beside and then renamed."""
    folder.mkdir(parents=True, exist_ok=True)
    document = json.dumps(diagnosis.as_dict(), indent=1, allow_nan=False) + "\n"
    table = io.StringIO()
    diagnosis.predictions().to_csv(table, index=False, float_format="%.6g")
    model = json.dumps(improved(diagnosis.found, diagnosis.model), indent=1, allow_nan=False) + "\n"
    files = {"diagnosis.json": document, "prediction.csv": table.getvalue(), "model.json": model}
    for name, text in files.items():
        with write_beside(folder / name) as beside:
            beside.write_text(text)
    return [folder / name for name in files]


def baseline_numbers(one: Diagnosis) -> dict[str, Number]:
    """The baseline's own parameters."""
    return {one.found.names[k]: number_of(one.found, one.baseline, k) for k in one.baseline.at.moved}


def number_of(found: Problem, model: Model, k: int) -> Number:
    """A number of a model, and whether it was driven to an end of its range that switches nothing off."""
    value, meaning = float(model.at.values[k]), found.meaning[k]
    ends = {model.at.moved[j] for j in driven(found, model.at)}
    off = AT_LIMIT * (found.high[k] - found.low[k])
    neutral = meaning.neutral is not None and abs(value - meaning.neutral) < off
    return Number(value, model.sd(k), meaning, k in ends and not neutral)


def _scale(meaning: Meaning) -> tuple[float, str]:
    """How many SI units the shown unit is, and its name; a pure number stays one."""
    unit = "1" if meaning.unit == "1" else meaning.show
    return in_unit(unit), unit


def _number(number: Number) -> dict[str, Any]:
    scale, unit = _scale(number.meaning)
    return {"value": number.value / scale, "sd": _or_none(number.sd / scale), "unit": unit}


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _in_unit(channel: str, value: float) -> dict[str, Any]:
    return {"value": to_display(channel, value), "unit": DISPLAY_UNIT[channel]}


def _rmse(found: Problem, model: Model) -> dict[str, float]:
    misfit = found.measured - found.shows(model.at.values)
    return {
        channel: float(np.sqrt(np.nanmean(misfit[c] ** 2)))
        for c, channel in enumerate(CHANNELS)
        if np.isfinite(misfit[c]).any()
    }


def _noise(one: Diagnosis) -> dict[str, Any]:
    out = {}
    for c, channel in enumerate(CHANNELS):
        colour, rows = one.model.white.colours[c], one.model.white.rows[c]
        if colour is None:
            continue
        sd = float(np.sqrt(np.mean(colour.sd[rows] ** 2)))
        out[channel] = {
            "sd": to_display(channel, sd),
            "unit": DISPLAY_UNIT[channel],
            "correlation_time_s": _correlation_time(one.found, rows, colour.correlation),
        }
    return out


def _correlation_time(found: Problem, rows: np.ndarray, correlation: float) -> float:
    time = found.case.recording.time
    if time is None or correlation <= 0 or rows.size < 2:
        return 0.0
    return float(-np.median(np.diff(time[rows])) / math.log(correlation))


def _box(box: Box) -> dict[str, Any]:
    return {
        "channel": box.channel,
        "direction": box.direction,
        "pressure_kPa": [p / 1e3 for p in box.pressure],
        "contraction": list(box.contraction),
        "time_s": list(box.time),
        "share": box.share,
        "says": box.says,
    }


def _name(one: Diagnosis, name: Name) -> dict[str, Any]:
    about = mechanism(name.id).about
    return {
        "id": name.id,
        "name": about.title,
        "probability": name.probability,
        "parameters": {n: _number(v) for n, v in one.parameters[name.id].items()},
        "indistinguishable_from": list(name.ties),
        "says": about.signature,
    }


def _improvement(gain: Gain) -> dict[str, Any]:
    return {
        c: {
            "rmse_before": to_display(c, gain.rmse_before[c]),
            "rmse_after": to_display(c, gain.rmse_after[c]),
            "unit": DISPLAY_UNIT[c],
        }
        for c in gain.rmse_before
    }


def _moved(moved: Moved) -> dict[str, Any]:
    scale, unit = _scale(moved.meaning)
    return {
        "before": moved.before / scale,
        "after": moved.after / scale,
        "unit": unit,
        "shift_in_sd": moved.shift,
    }


def _lines(one: Diagnosis) -> list[str]:
    case, gain = one.found.case, one.gain
    lines = [f"{case.name}: {case.entry.name}, {one.found.law} baseline"]
    p = one.mismatch.p_value
    if not one.detected:
        lines.append(f"  nothing is missing that this recording could show (p = {p:.2g})")
    else:
        lines.append(f"  the baseline misses something (p {'< 1e-12' if p < 1e-12 else f'= {p:.1g}'})")
        lines += [f"    {box.says} ({box.share:.0%} of the misfit)" for box in one.where[:3]]
    for name in one.names:
        lines.append(f"  {name.id}: {mechanism(name.id).about.title}, probability {name.probability:.2f}")
        lines.append("    " + ", ".join(told(n, v) for n, v in list(one.parameters[name.id].items())[:3]))
        if name.ties:
            lines.append(f"    it or {' or '.join(name.ties)}: this recording cannot tell them apart")
    if one.faint:
        share = math.sqrt(max(one.mismatch.square - 1, 0.0))
        lines.append(f"  too faint to be named: {share:.2f} of the noise in rms, seen only over many samples")
    if one.unexplained:
        lines.append(f"  unexplained: {one.rest_share:.0%} of the misfit is none of what pamjax knows")
        lines += [f"    {box.says}" for box in one.rest_where[:2]]
    for channel, before in gain.rmse_before.items():
        before, after = (to_display(channel, rmse) for rmse in (before, gain.rmse_after[channel]))
        lines.append(
            f"  held out ({gain.blocks.split(':')[0]}): {channel} {before:.3g} -> {after:.3g}"
            f" {DISPLAY_UNIT[channel]}, noise {_noise(one)[channel]['sd']:.3g}"
        )
    for n, m in sorted(one.moved.items(), key=lambda pair: -abs(pair[1].shift))[:2]:
        scale, unit = _scale(m.meaning)
        if one.names and abs(m.shift) > 1:
            unit = "" if unit == "1" else f" {unit}"
            lines.append(f"  {n} moved from {m.before / scale:.4g} to {m.after / scale:.4g}{unit}")
    lines += [f"  next: {e.protocol} (power {e.power:.2f})" for e in one.experiments[:2]]
    return lines + [f"  note: {words}" for words in one.notes[:NOTES]]


def told(name: str, number: Number) -> str:
    """A number for people, as "coefficient 0.210 ± 0.012"."""
    limit = ", at an end of its range" if number.at_limit else ""
    return f"{name} {quantity(number.value, number.sd, _scale(number.meaning)[1])}{limit}"

"""The report of a diagnosis: one offline HTML file, the answer and its map first, the evidence below."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.baselines.comparison import BASELINE, TITLE, Contest
from pamjax.channels import DISPLAY_UNIT
from pamjax.diagnosis.detect.significance import DETECTED
from pamjax.diagnosis.result import Diagnosis, baseline_numbers
from pamjax.infer.fitting.report import quantity
from pamjax.model.registry import mechanism
from pamjax.parameter import Meaning
from pamjax.units import in_unit, show
from pamjax.view.figures import diagnosis as figures
from pamjax.view.figures.diagnosis_loops import left_out_figure, loops_figure
from pamjax.view.figures.mismatch_map import map_figure, other_channels
from pamjax.view.reports.page import Picture, picture, write_page
from pamjax.view.wording import noise_says, signed

#: A p-value below this is told as smaller, not as a number.
TINY = 1e-12


def save_report(one: Diagnosis, path: str | Path, command: str = "", held: Contest | None = None) -> Path:
    """Write the report of a diagnosis.

    Args:
        one: the diagnosis.
        path: the HTML file; its folder must exist.
        command: what repeats it, in a shell; the plain command if left out.
        held: the gain beside a formula and a Gaussian process, where it was asked for.
    """
    told = one.as_dict()
    return write_page(
        path,
        "diagnosis.html.jinja",
        title=headline(one),
        muscle=one.found.case.entry.name,
        told=told,
        answer=answer(one),
        chance=chance(one.mismatch.p_value),
        rest_chance=chance(one.rest.p_value),
        map=_drawn(one, partial(map_figure, one, None), "map"),
        more_maps=[_drawn(one, partial(map_figure, one, c), f"map-{c}") for c in other_channels(one)],
        boxes=[box | {"percent": _percent(box["share"])} for box in told["mismatch"]["where"]],
        box_rows=[_box(one, k, box) for k, box in enumerate(told["mismatch"]["where"], 1)],
        names=[_name(one, k) for k in range(len(one.names))],
        loops=_drawn(one, partial(loops_figure, one), "loops"),
        left_out=_drawn(one, partial(left_out_figure, one), "left-out"),
        held_out=_drawn(one, partial(figures.held_out_figure, one), "held-out"),
        scores=list(_scores(told)),
        contest=_contest(held) if held and held.splits else None,
        moved=_drawn(one, partial(figures.moved_figure, one), "moved"),
        moves=list(_moves(one)),
        ties=any(name.ties for name in one.names),
        experiments=[[e.protocol, _and(list(e.separates)), f"{e.power:.2f}"] for e in one.experiments],
        baseline=[
            [n, _quantity(v.value, v.sd, v.meaning), v.meaning.about]
            for n, v in baseline_numbers(one).items()
        ],
        notes=one.notes,
        assumed=list(_assumed(one)),
        checksum=one.found.case.checksum,
        command=command or shlex.join(["pamjax", "diagnose", str(one.found.case.folder)]),
    )


def headline(one: Diagnosis) -> str:
    """The answer in a line."""
    if not one.detected:
        return "Nothing is missing that this recording could show"
    if one.faint:
        return "Something is missing, too faint to be named"
    if not one.names:
        return "Something is missing, and it is nothing that pamjax knows"
    told = _and([mechanism(name.id).about.title for name in one.names])
    more = ", and something that pamjax does not know" if one.unexplained else ""
    return f"Left out: {told}{more}"


def answer(one: Diagnosis) -> tuple[str, str]:
    """The answer in two sentences: what is wrong and where; what is missing and what naming it gains."""
    law = one.found.law
    if not one.detected:
        first = f"The {law} baseline explains this recording to its noise ({chance(one.mismatch.p_value)})."
        gained = _gained(one)
        return (
            first,
            f"Blocks that no fit has seen are missed by {gained}." if gained else "Nothing was held out.",
        )
    where = one.where[0].says if one.where else "It shows in no one place."
    first = f"The {law} baseline misses something ({chance(one.mismatch.p_value)}): {_lower(where)}"
    if one.faint:
        return first, "It is so far below the noise of a sample that a name would be a guess."
    if not one.names:
        return first, "No mechanism in pamjax's library explains it well enough to be named."
    named = _and([f"{name.id} ({_sure(name.probability)})" for name in one.names])
    rest = f" {one.rest_share:.0%} of the misfit is left unexplained." if one.unexplained else ""
    gained = _gained(one)
    return first, f"What it left out is {named}{f'; with it, {gained}' if gained else ''}.{rest}"


def chance(p: float) -> str:
    """A p-value in words that no line breaks.

    >>> chance(0.4321).split(), chance(1e-40).split()
    (['p', '=', '0.43'], ['p', '<', '1e-12'])
    """
    return (f"p < {TINY:g}" if p < TINY else f"p = {p:.2g}").replace(" ", "\u00a0")


def _sure(probability: float) -> str:
    return "probability above 0.99" if probability > 0.995 else f"probability {probability:.2f}"


def _gained(one: Diagnosis) -> str:
    """What naming gains on held-out blocks, on the channels where it gains or loses a tenth."""
    told = one.as_dict()
    parts = []
    for channel, score in told["improvement"]["held_out"].items():
        if channel == "blocks":
            continue
        before, after, unit = score["rmse_before"], score["rmse_after"], score["unit"]
        floor = f"where noise is {told['noise'][channel]['sd']:.3g} {unit}"
        if not one.names:
            parts.append(f"{before:.3g} {unit} of {channel}, {floor},")
        elif not 0.9 < after / before < 1.1:
            parts.append(
                f"held-out {channel} is missed by {after:.3g} instead of {before:.3g} {unit}, {floor}"
            )
    return _and(parts).rstrip(",")


def _and(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else ", ".join(parts[:-1]) + " and " + parts[-1] if parts else ""


def _lower(sentence: str) -> str:
    return sentence[:1].lower() + sentence[1:]


def _drawn(one: Diagnosis, draw, name: str) -> Picture | None:
    return picture(lambda narrow: draw(narrow=narrow), name)


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _box(one: Diagnosis, number: int, box: dict[str, Any]) -> list[str]:
    """A row of the table of boxes."""
    clock = "s" if one.found.case.recording.has_time else "(row)"
    ends = [
        f"{low:z.0f} to {high:z.0f} {unit}"
        for (low, high), unit in (
            (box["pressure_kPa"], "kPa"),
            ([100 * c for c in box["contraction"]], "%"),
            (box["time_s"], clock),
        )
    ]
    return [str(number), box["channel"], box["direction"], *ends, _percent(box["share"])]


def _name(one: Diagnosis, k: int) -> dict[str, Any]:
    name = one.names[k]
    about = mechanism(name.id).about
    return {
        "id": name.id,
        "about": about,
        "sure": _sure(name.probability),
        "ties": list(name.ties),
        "rows": [[n, _quantity(v.value, v.sd, v.meaning), v.meaning.about]
                 for n, v in one.parameters[name.id].items()],
        "candidates": _drawn(one, partial(figures.candidates_figure, one, name), f"candidates-{name.id}"),
    }  # fmt: skip


def _quantity(value: float, sd: float | None, meaning: Meaning) -> str:
    return quantity(value, sd, "1" if meaning.unit == "1" else meaning.show)


def _scores(told: dict[str, Any]) -> Iterator[list[str]]:
    for channel, score in told["improvement"]["held_out"].items():
        if channel != "blocks":
            kinds = ["rmse_before", "rmse_after"] if told["missing_physics"] else ["rmse_before"]
            numbers = [*(score[kind] for kind in kinds), told["noise"][channel]["sd"]]
            yield [channel, *(f"{number:.4g} {score['unit']}" for number in numbers)]


def _contest(held: Contest) -> dict[str, Any]:
    """A row for each split and channel, a column for each model."""
    models = list(dict.fromkeys(model for split in held.splits for model in split.rmse))
    rows, remarks = [], []
    for split in held.splits:
        for channel, noise in held.noise.items():
            if channel in split.rmse[BASELINE]:
                cells = [split.rmse.get(model, {}).get(channel) for model in models]
                starred = ["*" if model in split.remarks else "" for model in models]
                told = [
                    "–" if value is None else f"{figures.told(value, channel)}{star}"
                    for value, star in zip(cells, starred, strict=True)
                ]
                rows.append([f"{split.name}: {split.rows}", channel, *told, figures.told(noise, channel)])
        remarks += [f"{TITLE[model]}, {split.name}: {remark}" for model, remark in split.remarks.items()]
    head = ["held out", "channel", *(TITLE[model] for model in models), "noise"]
    return {"head": head, "rows": rows, "remarks": remarks}


def _moves(one: Diagnosis) -> Iterator[list[str]]:
    """Each baseline number before and after, those that moved most first."""
    before = baseline_numbers(one)
    for name, moved in sorted(one.moved.items(), key=lambda pair: -abs(pair[1].shift)):
        place = one.found.place(name)
        after = _quantity(moved.after, one.model.sd(place), moved.meaning)
        yield [
            name, _quantity(moved.before, before[name].sd, moved.meaning), after, f"{signed(moved.shift)} sd",
        ]  # fmt: skip


def _assumed(one: Diagnosis) -> Iterator[str]:
    case, found = one.found.case, one.found
    numbers = _and([f"{found.names[k]} {_prior(found, k)}" for k in np.flatnonzero(found.own).tolist()][:8])
    yield f"The baseline is a braid of {found.law} threads. Its numbers were believed before: {numbers}."
    for channel, noise in one.as_dict()["noise"].items():
        c = ("force", "diameter").index(channel)
        colour = one.model.white.colours[c]
        assert colour is not None
        shared = f"; neighbours share it by {colour.correlation:.2f}" if colour.correlation else ""
        if colour.given:
            yield f"{noise_says(case, channel, noise['sd'] * in_unit(DISPLAY_UNIT[channel]))}{shared}."
            continue
        yield (
            f"Noise of {channel} is {noise['sd']:.3g} {noise['unit']} a sample, read off neighbouring"
            f" samples, with that of pressure and length carried through the model{shared}."
        )
    begun = "was at rest" if case.before == "relaxed" else "had been through the same recording once"
    gaps = "goes on across a jump" if case.gaps == "carry" else "begins anew at a jump"
    yield f"Before its first sample the muscle {begun}; its memory {gaps} of the recording."
    yield (
        f"A mismatch counts from p < {DETECTED:g}, over everything that was looked at:"
        f" {one.mismatch.looked} directions. Names were chosen without the held-out blocks;"
        " the numbers shown are refitted to all rows."
    )
    out = int(found.n - np.isfinite(found.measured).any(axis=0).sum())
    yield f"{found.n} rows were read; {out} of them have nothing to compare."


def _prior(found, k: int) -> str:
    meaning, sd = found.meaning[k], float(found.sd[k])
    if not math.isfinite(sd):
        return f"within {show(found.low[k], meaning.show, 3)} and {show(found.high[k], meaning.show, 3)}"
    return _quantity(float(found.start[k]), sd, meaning)

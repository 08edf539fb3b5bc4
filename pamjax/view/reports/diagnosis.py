"""Report of a diagnosis: one offline HTML file with the answer and its map first, then the evidence."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.baselines.comparison import BASELINE_MODEL, MODEL_TITLES, ModelComparison
from pamjax.channels import DISPLAY_UNIT
from pamjax.diagnosis.detect.significance import DETECTION_P_VALUE
from pamjax.diagnosis.result import Diagnosis, get_baseline_estimates
from pamjax.infer.fitting.report import format_estimate
from pamjax.model.registry import find_mechanism
from pamjax.parameter import Meaning
from pamjax.units import compute_si_factor, format_quantity
from pamjax.view.figures import diagnosis as figures
from pamjax.view.figures.diagnosis_loops import plot_left_out, plot_loops
from pamjax.view.figures.mismatch_map import list_other_channels, plot_map
from pamjax.view.reports.page import Picture, build_picture, write_page
from pamjax.view.wording import format_noise, format_signed

#: A p-value below this is told as smaller, not as a number.
MIN_SHOWN_P_VALUE = 1e-12


def write_diagnosis_report(
    diagnosis: Diagnosis, path: str | Path, command: str = "", comparison: ModelComparison | None = None
) -> Path:
    """Write the report of a diagnosis.

    Args:
        diagnosis: the diagnosis.
        path: the HTML file; its folder must exist.
        command: shell command that repeats the diagnosis; the plain command if omitted.
        comparison: held-out scores of an empirical formula and a Gaussian process, if computed.
    """
    document = diagnosis.as_dict()
    return write_page(
        path,
        "diagnosis.html.jinja",
        title=format_headline(diagnosis),
        muscle=diagnosis.problem.case.entry.name,
        told=document,
        answer=format_answer(diagnosis),
        chance=format_p_value(diagnosis.mismatch.p_value),
        rest_chance=format_p_value(diagnosis.residual_test.p_value),
        map=_draw_picture(diagnosis, partial(plot_map, diagnosis, None), "map"),
        more_maps=[
            _draw_picture(diagnosis, partial(plot_map, diagnosis, c), f"map-{c}")
            for c in list_other_channels(diagnosis)
        ],
        boxes=[box | {"percent": _format_percent(box["share"])} for box in document["mismatch"]["where"]],
        box_rows=[
            _build_box_row(diagnosis, k, box) for k, box in enumerate(document["mismatch"]["where"], 1)
        ],
        names=[_describe_mechanism(diagnosis, k) for k in range(len(diagnosis.named_mechanisms))],
        loops=_draw_picture(diagnosis, partial(plot_loops, diagnosis), "loops"),
        left_out=_draw_picture(diagnosis, partial(plot_left_out, diagnosis), "left-out"),
        held_out=_draw_picture(diagnosis, partial(figures.plot_held_out_scores, diagnosis), "held-out"),
        scores=list(_list_scores(document)),
        contest=_describe_comparison(comparison) if comparison and comparison.splits else None,
        moved=_draw_picture(diagnosis, partial(figures.plot_shifts, diagnosis), "moved"),
        moves=list(_list_shifts(diagnosis)),
        ties=any(name.indistinguishable for name in diagnosis.named_mechanisms),
        experiments=[
            [experiment.protocol, _join_words(list(experiment.separates)), f"{experiment.power:.2f}"]
            for experiment in diagnosis.experiments
        ],
        baseline=[
            [n, _format_quantity(v.value, v.sd, v.meaning), v.meaning.about]
            for n, v in get_baseline_estimates(diagnosis).items()
        ],
        notes=diagnosis.notes,
        assumed=list(_list_assumptions(diagnosis)),
        checksum=diagnosis.problem.case.checksum,
        command=command or shlex.join(["pamjax", "diagnose", str(diagnosis.problem.case.folder)]),
    )


def format_headline(diagnosis: Diagnosis) -> str:
    """Return the finding in one line."""
    if not diagnosis.detected:
        return "Nothing is missing that this recording could show"
    if diagnosis.is_faint:
        return "Something is missing, too faint to be named"
    if not diagnosis.named_mechanisms:
        return "Something is missing, and it is nothing that pamjax knows"
    titles = _join_words([find_mechanism(name.id).about.title for name in diagnosis.named_mechanisms])
    addition = ", and something that pamjax does not know" if diagnosis.unexplained else ""
    return f"Left out: {titles}{addition}"


def format_answer(diagnosis: Diagnosis) -> tuple[str, str]:
    """Return the misfit and its place, then the identified mechanisms and their held-out gain."""
    law = diagnosis.problem.law
    if not diagnosis.detected:
        first_sentence = (
            f"The {law} baseline explains this recording to its noise"
            f" ({format_p_value(diagnosis.mismatch.p_value)})."
        )
        gain = _format_gain(diagnosis)
        return (
            first_sentence,
            f"Blocks that no fit has seen are missed by {gain}." if gain else "Nothing was held out.",
        )
    where = (
        diagnosis.mismatch_boxes[0].description if diagnosis.mismatch_boxes else "It shows in no one place."
    )
    first_sentence = (
        f"The {law} baseline misses something"
        f" ({format_p_value(diagnosis.mismatch.p_value)}): {_lower_first(where)}"
    )
    if diagnosis.is_faint:
        return first_sentence, "It is so far below the noise of a sample that a name would be a guess."
    if not diagnosis.named_mechanisms:
        return first_sentence, "No mechanism in pamjax's library explains it well enough to be named."
    names = _join_words(
        [f"{name.id} ({_format_probability(name.probability)})" for name in diagnosis.named_mechanisms]
    )
    remainder = (
        f" {diagnosis.residual_share:.0%} of the misfit is left unexplained." if diagnosis.unexplained else ""
    )
    gain = _format_gain(diagnosis)
    return first_sentence, f"What it left out is {names}{f'; with it, {gain}' if gain else ''}.{remainder}"


def format_p_value(p: float) -> str:
    """Return a p-value as text with non-breaking spaces.

    >>> format_p_value(0.4321).split(), format_p_value(1e-40).split()
    (['p', '=', '0.43'], ['p', '<', '1e-12'])
    """
    return (f"p < {MIN_SHOWN_P_VALUE:g}" if p < MIN_SHOWN_P_VALUE else f"p = {p:.2g}").replace(" ", "\u00a0")


def _format_probability(probability: float) -> str:
    return "probability above 0.99" if probability > 0.995 else f"probability {probability:.2f}"


def _format_gain(diagnosis: Diagnosis) -> str:
    """Return the held-out error of each channel; with mechanisms, of those that change by 10 % or more."""
    document = diagnosis.as_dict()
    parts = []
    for channel, score in document["improvement"]["held_out"].items():
        if channel == "blocks":
            continue
        before, after, unit = score["rmse_before"], score["rmse_after"], score["unit"]
        noise_text = f"where noise is {document['noise'][channel]['sd']:.3g} {unit}"
        if not diagnosis.named_mechanisms:
            parts.append(f"{before:.3g} {unit} of {channel}, {noise_text},")
        elif not 0.9 < after / before < 1.1:
            parts.append(
                f"held-out {channel} is missed by {after:.3g} instead of {before:.3g} {unit}, {noise_text}"
            )
    return _join_words(parts).rstrip(",")


def _join_words(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else ", ".join(parts[:-1]) + " and " + parts[-1] if parts else ""


def _lower_first(sentence: str) -> str:
    return sentence[:1].lower() + sentence[1:]


def _draw_picture(diagnosis: Diagnosis, plot, name: str) -> Picture | None:
    return build_picture(lambda narrow: plot(narrow=narrow), name)


def _format_percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _build_box_row(diagnosis: Diagnosis, number: int, box: dict[str, Any]) -> list[str]:
    """Return a row of the table of boxes."""
    time_unit = "s" if diagnosis.problem.case.recording.has_time else "(row)"
    limits = [
        f"{low:z.0f} to {high:z.0f} {unit}"
        for (low, high), unit in (
            (box["pressure_kPa"], "kPa"),
            ([100 * c for c in box["contraction"]], "%"),
            (box["time_s"], time_unit),
        )
    ]
    return [str(number), box["channel"], box["direction"], *limits, _format_percent(box["share"])]


def _describe_mechanism(diagnosis: Diagnosis, k: int) -> dict[str, Any]:
    mechanism = diagnosis.named_mechanisms[k]
    description = find_mechanism(mechanism.id).about
    return {
        "id": mechanism.id,
        "about": description,
        "sure": _format_probability(mechanism.probability),
        "ties": list(mechanism.indistinguishable),
        "rows": [
            [n, _format_quantity(v.value, v.sd, v.meaning), v.meaning.about]
            for n, v in diagnosis.parameters[mechanism.id].items()
        ],
        "candidates": _draw_picture(
            diagnosis, partial(figures.plot_candidates, diagnosis, mechanism), f"candidates-{mechanism.id}"
        ),
    }


def _format_quantity(value: float, sd: float | None, meaning: Meaning) -> str:
    return format_estimate(value, sd, "1" if meaning.unit == "1" else meaning.show)


def _list_scores(document: dict[str, Any]) -> Iterator[list[str]]:
    for channel, score in document["improvement"]["held_out"].items():
        if channel != "blocks":
            kinds = ["rmse_before", "rmse_after"] if document["missing_physics"] else ["rmse_before"]
            numbers = [*(score[kind] for kind in kinds), document["noise"][channel]["sd"]]
            yield [channel, *(f"{number:.4g} {score['unit']}" for number in numbers)]


def _describe_comparison(comparison: ModelComparison) -> dict[str, Any]:
    """Return a row for each split and channel, with a column for each model."""
    models = list(dict.fromkeys(model for split in comparison.splits for model in split.rmse))
    rows, remarks = [], []
    for split in comparison.splits:
        for channel, noise in comparison.noise_sd.items():
            if channel in split.rmse[BASELINE_MODEL]:
                cells = [split.rmse.get(model, {}).get(channel) for model in models]
                starred = ["*" if model in split.remarks else "" for model in models]
                cell_texts = [
                    "–" if value is None else f"{figures.format_channel_value(value, channel)}{star}"
                    for value, star in zip(cells, starred, strict=True)
                ]
                rows.append(
                    [
                        f"{split.name}: {split.rows_description}",
                        channel,
                        *cell_texts,
                        figures.format_channel_value(noise, channel),
                    ]
                )
        remarks += [
            f"{MODEL_TITLES[model]}, {split.name}: {remark}" for model, remark in split.remarks.items()
        ]
    head = ["held out", "channel", *(MODEL_TITLES[model] for model in models), "noise"]
    return {"head": head, "rows": rows, "remarks": remarks}


def _list_shifts(diagnosis: Diagnosis) -> Iterator[list[str]]:
    """Yield each baseline parameter before and after, largest shift first."""
    baseline_before = get_baseline_estimates(diagnosis)
    for name, shift in sorted(diagnosis.parameter_shifts.items(), key=lambda pair: -abs(pair[1].shift)):
        index = diagnosis.problem.index(name)
        after = _format_quantity(shift.after, diagnosis.model.sd(index), shift.meaning)
        yield [
            name,
            _format_quantity(shift.before, baseline_before[name].sd, shift.meaning),
            after,
            f"{format_signed(shift.shift)} sd",
        ]


def _list_assumptions(diagnosis: Diagnosis) -> Iterator[str]:
    case, problem = diagnosis.problem.case, diagnosis.problem
    numbers = _join_words(
        [
            f"{problem.names[k]} {_format_prior(problem, k)}"
            for k in np.flatnonzero(problem.is_baseline).tolist()
        ][:8]
    )
    yield f"The baseline is a braid of {problem.law} threads. Its numbers were believed before: {numbers}."
    for channel, noise in diagnosis.as_dict()["noise"].items():
        channel_index = ("force", "diameter").index(channel)
        channel_noise = diagnosis.model.noise.channels[channel_index]
        assert channel_noise is not None
        correlation_text = (
            f"; neighbours share it by {channel_noise.correlation:.2f}" if channel_noise.correlation else ""
        )
        if channel_noise.stated:
            sd = noise["sd"] * compute_si_factor(DISPLAY_UNIT[channel])
            yield f"{format_noise(case, channel, sd)}{correlation_text}."
            continue
        yield (
            f"Noise of {channel} is {noise['sd']:.3g} {noise['unit']} a sample, read off neighbouring"
            f" samples, with that of pressure and length carried through the model{correlation_text}."
        )
    history_text = "was at rest" if case.before == "relaxed" else "had been through the same recording once"
    gaps = "goes on across a jump" if case.gaps == "carry" else "begins anew at a jump"
    yield f"Before its first sample the muscle {history_text}; its memory {gaps} of the recording."
    yield (
        f"A mismatch counts from p < {DETECTION_P_VALUE:g}, over everything that was looked at:"
        f" {diagnosis.mismatch.direction_count} directions. Names were chosen without the held-out blocks;"
        " the numbers shown are refitted to all rows."
    )
    empty_rows = int(problem.n - np.isfinite(problem.measured).any(axis=0).sum())
    yield f"{problem.n} rows were read; {empty_rows} of them have nothing to compare."


def _format_prior(problem, k: int) -> str:
    meaning, sd = problem.meanings[k], float(problem.prior_sd[k])
    if not math.isfinite(sd):
        return (
            f"within {format_quantity(problem.low[k], meaning.show, 3)} and"
            f" {format_quantity(problem.high[k], meaning.show, 3)}"
        )
    return _format_quantity(float(problem.start[k]), sd, meaning)

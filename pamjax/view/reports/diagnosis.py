"""Report of a diagnosis: one offline HTML file with the result and its map first, then the evidence."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.baselines.comparison import BASELINE_MODEL, MODEL_TITLES, ModelComparison
from pamjax.channels import DISPLAY_UNIT, format_channel_value
from pamjax.diagnosis.estimates import ParameterEstimate, build_parameter_estimate
from pamjax.diagnosis.result import Diagnosis, get_baseline_estimates
from pamjax.diagnosis.settings import describe_settings
from pamjax.diagnosis.suggested_commands import MODEL_FILE, list_suggested_commands
from pamjax.diagnosis.unexplained import describe_unexplained_reason
from pamjax.infer.form_errors.parts import MIN_SHOWN_EFFECT
from pamjax.model.registry import find_mechanism
from pamjax.parameter import Meaning, get_display_unit
from pamjax.text import format_p_value, join_words
from pamjax.units import compute_si_factor, format_estimate, format_number, format_quantity
from pamjax.view.figures import diagnosis as figures
from pamjax.view.figures.diagnosis_loops import (
    plot_explained_residuals,
    plot_loops,
    select_shown_groups,
)
from pamjax.view.figures.misfit_map import format_map_caption, list_other_channels, plot_map
from pamjax.view.reports.diagnosis_answer import (
    format_headline,
    format_percent,
    format_probability,
    list_answers,
    list_held_out_bars,
)
from pamjax.view.reports.page import Picture, build_picture, write_page
from pamjax.view.wording import BRANCHES_SENTENCE, format_history, format_noise, format_signed


def write_diagnosis_report(
    diagnosis: Diagnosis,
    path: str | Path,
    command: str = "",
    comparison: ModelComparison | None = None,
    folder: str | Path | None = None,
) -> Path:
    """Write the report of a diagnosis.

    Args:
        diagnosis: the diagnosis.
        path: the HTML file; its folder must exist.
        command: shell command that repeats the diagnosis; the plain command if omitted.
        comparison: held-out scores of an empirical formula and a Gaussian process, if computed.
        folder: the folder with model.json, as the user wrote it. Without it, the commands of the report work
            in the folder of the report.
    """
    document = diagnosis.as_dict()
    model_file = MODEL_FILE if folder is None else str(Path(folder) / MODEL_FILE)
    model = shlex.quote(model_file)
    return write_page(
        path,
        "diagnosis.html.jinja",
        title=format_headline(diagnosis),
        muscle=diagnosis.problem.case.muscle_toml.name,
        document=document,
        answers=list_answers(diagnosis, comparison, model),
        bars=list_held_out_bars(diagnosis, comparison),
        p_value=format_p_value(diagnosis.baseline_test.p_value),
        unexplained_reason=describe_unexplained_reason(diagnosis),
        map=_draw_picture(partial(plot_map, diagnosis, None), "map", has_title=False),
        map_caption=format_map_caption(diagnosis),
        other_maps=[
            _draw_picture(partial(plot_map, diagnosis, c), f"map-{c}") for c in list_other_channels(diagnosis)
        ],
        region_place="time" if diagnosis.problem.case.recording.has_time else "rows of recording.csv",
        regions=[
            region | {"percent": format_percent(region["share"])} for region in document["mismatch"]["where"]
        ],
        region_rows=[
            _build_region_row(diagnosis, k, region)
            for k, region in enumerate(document["mismatch"]["where"], 1)
        ],
        mechanisms=[_describe_mechanism(diagnosis, k) for k in range(len(diagnosis.named_mechanisms))],
        groups=_list_groups(diagnosis),
        loops_caption=_format_loops_caption(diagnosis),
        loops=_draw_picture(partial(plot_loops, diagnosis), "loops"),
        residuals=_draw_picture(partial(plot_explained_residuals, diagnosis), "residuals"),
        held_out=_draw_picture(partial(figures.plot_held_out_scores, diagnosis), "held-out"),
        scores=list(_list_scores(diagnosis, document)),
        max_error_ratio=f"{diagnosis.settings.max_held_out_error_ratio:g}",
        has_form_errors=diagnosis.form_prediction is not None,
        comparison=_describe_comparison(comparison) if comparison and comparison.splits else None,
        shift_figure=_draw_picture(partial(figures.plot_shifts, diagnosis), "shifts"),
        shifts=list(_list_shifts(diagnosis)),
        ties=any(mechanism.indistinguishable for mechanism in diagnosis.named_mechanisms),
        tie_advice=[
            f"To separate `{mechanism.id}` from the others: {find_mechanism(mechanism.id).about.experiment}"
            for mechanism in diagnosis.named_mechanisms
            if mechanism.indistinguishable
        ],
        experiments=[
            [experiment.protocol, join_words(list(experiment.separates)), f"{experiment.power:.2f}"]
            for experiment in diagnosis.experiments
        ],
        baseline=[[n, str(v), v.meaning.about] for n, v in get_baseline_estimates(diagnosis).items()],
        notes=diagnosis.notes,
        model_file=model_file,
        command_folder="of this report" if folder is None else "in which you ran the diagnosis",
        suggested_commands=list_suggested_commands(diagnosis, model),
        assumptions=list(_list_assumptions(diagnosis)),
        settings=list(_list_settings(diagnosis)),
        changed_settings=_format_changed_settings(diagnosis),
        checksum=diagnosis.problem.case.checksum,
        command=command or shlex.join(["pamjax", "diagnose", str(diagnosis.problem.case.folder)]),
    )


def _draw_picture(plot, name: str, has_title: bool = True) -> Picture | None:
    return build_picture(lambda narrow: plot(narrow=narrow), name, has_title)


def _build_region_row(diagnosis: Diagnosis, number: int, region: dict[str, Any]) -> list[str]:
    """Return a row of the table of regions."""
    time_unit = " s" if diagnosis.problem.case.recording.has_time else ""
    limits = [
        f"{low:z.0f} to {high:z.0f}{unit}"
        for (low, high), unit in (
            (region["pressure_kPa"], " kPa"),
            ([100 * c for c in region["contraction"]], " %"),
            (region["time_s"], time_unit),
        )
    ]
    return [str(number), region["channel"], region["direction"], *limits, format_percent(region["share"])]


def _list_groups(diagnosis: Diagnosis) -> list[str]:
    """Return the isobars or lengths of the loops, which the page can show one by one."""
    names = list(select_shown_groups(diagnosis).names)
    return names if len(names) > 1 else []


def _format_loops_caption(diagnosis: Diagnosis) -> str:
    sentences = [
        "Measured and predicted values at some settings.",
        "Held-out blocks are predicted by fits that exclude them.",
    ]
    if diagnosis.problem.case.recording.has_time:
        sentences.append(BRANCHES_SENTENCE)
    if diagnosis.form_prediction is not None:
        sentences.append("The band is ± 2 standard deviations of parameters and form errors.")
    return " ".join(sentences)


def _describe_mechanism(diagnosis: Diagnosis, k: int) -> dict[str, Any]:
    mechanism = diagnosis.named_mechanisms[k]
    description = find_mechanism(mechanism.id).about
    return {
        "id": mechanism.id,
        "about": description,
        "probability": format_probability(mechanism.probability),
        "ties": list(mechanism.indistinguishable),
        "form_error": _format_form_error(diagnosis, mechanism.id),
        "rows": [[n, str(v), v.meaning.about] for n, v in diagnosis.parameters[mechanism.id].items()],
        "candidates": _draw_picture(
            partial(figures.plot_candidates, diagnosis, mechanism), f"candidates-{mechanism.id}"
        ),
    }


def _format_form_error(diagnosis: Diagnosis, id: str) -> str:
    """Return sentences on the part of the equation and that of the form error; "" for a mechanism without."""
    part = diagnosis.form_errors.get(id)
    if part is None:
        return ""
    # A channel with an effect far below its noise is not shown.
    sizes = [
        [format_channel_value(float(rms[c]), channel) for rms in (part.effect_rms, part.form_rms)]
        for c, channel in enumerate(diagnosis.problem.channels)
        if part.effect_rms[c] > MIN_SHOWN_EFFECT * diagnosis.model.noise.compute_rms_sd(c)
    ]
    if not sizes:
        return ""
    textbook, form = (join_words([pair[k] for pair in sizes]) for k in (0, 1))
    sentence = f"Textbook part: {textbook} rms, according to the equation of the mechanism."
    if not part.share:
        return f"{sentence} Form error: none."
    return f"{sentence} Form error: {form} rms, {format_percent(part.ratio)} of the textbook part."


def _format_quantity(value: float, sd: float | None, meaning: Meaning) -> str:
    return format_estimate(value, sd, get_display_unit(meaning)[1])


def _list_scores(diagnosis: Diagnosis, document: dict[str, Any]) -> Iterator[list[str]]:
    for channel, score in document["improvement"]["held_out"].items():
        if channel != "blocks":
            kinds = ["rmse_before", "rmse_after"] if document["missing_physics"] else ["rmse_before"]
            values = [score[kind] for kind in kinds]
            if diagnosis.form_prediction is not None:
                values.insert(1, score["rmse_equations"])
            if document["missing_physics"]:
                values.append(score["rmse_expected"])
            values.append(document["noise"][channel]["sd"])
            yield [
                channel,
                *("–" if value is None else f"{format_number(value, 4)} {score['unit']}" for value in values),
            ]


def _describe_comparison(comparison: ModelComparison) -> dict[str, Any]:
    """Return a row for each split and channel, with a column for each model."""
    models = list(dict.fromkeys(model for split in comparison.splits for model in split.rmse))
    rows, remarks = [], []
    for split in comparison.splits:
        for channel, noise in comparison.noise_sd.items():
            if channel in split.rmse[BASELINE_MODEL]:
                cells = [split.rmse.get(model, {}).get(channel) for model in models]
                stars = ["*" if model in split.remarks else "" for model in models]
                cell_texts = [
                    "–" if value is None else f"{figures.format_channel_value(value, channel)}{star}"
                    for value, star in zip(cells, stars, strict=True)
                ]
                rows.append(
                    [
                        f"{split.rows_description} ({split.name})",
                        channel,
                        *cell_texts,
                        figures.format_channel_value(noise, channel),
                    ]
                )
        remarks += [
            f"{MODEL_TITLES[model]}, {split.name}: {remark}" for model, remark in split.remarks.items()
        ]
    head = ["held-out rows", "channel", *(MODEL_TITLES[model] for model in models), "noise"]
    return {"head": head, "rows": rows, "remarks": remarks}


def _list_shifts(diagnosis: Diagnosis) -> Iterator[list[str]]:
    """Yield each baseline parameter without and with the mechanisms, largest shift first."""
    baseline_estimates = get_baseline_estimates(diagnosis)
    for name, shift in sorted(diagnosis.parameter_shifts.items(), key=lambda pair: -pair[1].order):
        shift_text = f"{format_signed(shift.shift_in_sd)} sd" if math.isfinite(shift.shift_in_sd) else "–"
        estimates = baseline_estimates[name], _estimate_with_mechanisms(diagnosis, name)
        yield [name, *map(str, estimates), shift_text]


def _estimate_with_mechanisms(diagnosis: Diagnosis, name: str) -> ParameterEstimate:
    problem = diagnosis.problem
    return build_parameter_estimate(problem, diagnosis.model, problem.index(name))


def _list_assumptions(diagnosis: Diagnosis) -> Iterator[str]:
    case, problem = diagnosis.problem.case, diagnosis.problem
    priors = "; ".join(
        [
            f"{problem.names[k]} {_format_prior(problem, k)}"
            for k in np.flatnonzero(problem.is_baseline).tolist()
        ][:8]
    )
    yield f"The baseline is a braid of {problem.law} threads. Priors of its parameters: {priors}."
    for channel, noise in diagnosis.as_dict()["noise"].items():
        channel_index = diagnosis.problem.channels.index(channel)
        channel_noise = diagnosis.model.noise.by_channel[channel_index]
        assert channel_noise is not None
        correlation_text = (
            f" The autocorrelation of adjacent rows is {channel_noise.correlation:.2f}."
            if channel_noise.correlation
            else ""
        )
        if channel_noise.is_stated:
            sd = noise["sd"] * compute_si_factor(DISPLAY_UNIT[channel])
            yield f"{format_noise(case, channel, sd)}.{correlation_text}"
            continue
        yield (
            f"Noise of {channel} is {format_number(noise['sd'], 3)} {noise['unit']} per row. It is estimated"
            f" from adjacent rows and includes the noise of pressure and length.{correlation_text}"
        )
    yield f"{format_history(case)}."
    yield (
        f"pamjax reports a misfit if the global p-value over {diagnosis.baseline_test.direction_count} tested"
        f" patterns of the residual is below {diagnosis.settings.detection_p_value:g}."
    )
    yield (
        "The mechanisms were selected without the held-out blocks. The parameters are fitted to all rows."
        if diagnosis.held_out_errors.held_out_mask.any()
        else "No block was held out. All rows were used to select the mechanisms and to fit the parameters."
    )
    unused_rows = int(problem.n - np.isfinite(problem.measured).any(axis=0).sum())
    yield f"The recording has {problem.n} rows. {unused_rows} of them are not compared with the model."


def _list_settings(diagnosis: Diagnosis) -> Iterator[list[str]]:
    """Yield a row for each setting; the default follows a changed value."""
    for setting in describe_settings(diagnosis.settings):
        value = f"{setting.value:.4g}"
        if setting.value != setting.default:
            value += f" (default {setting.default:.4g})"
        unit = "" if setting.unit in ("1", "count") else f" [{setting.unit}]"
        yield [setting.name, value, f"{setting.meaning}{unit}", setting.group]


def _format_changed_settings(diagnosis: Diagnosis) -> str:
    """Return a sentence on the settings that differ from their defaults."""
    settings = list(describe_settings(diagnosis.settings))
    changed = [f"{s.name} = {s.value:.4g}" for s in settings if s.value != s.default]
    if not changed:
        return f"All {len(settings)} settings of the diagnosis have their default values."
    return f"Settings that differ from their default values: {', '.join(changed)}."


def _format_prior(problem, k: int) -> str:
    meaning, sd = problem.meanings[k], float(problem.prior_sd[k])
    if not math.isfinite(sd):
        return (
            f"from {format_quantity(problem.low[k], meaning.show, 3)} to"
            f" {format_quantity(problem.high[k], meaning.show, 3)}"
        )
    return _format_quantity(float(problem.start[k]), sd, meaning)

"""Report of a fit: how well the model fits the recording, and the fitted parameters."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.channels import format_channel_value
from pamjax.infer.fitting.determination import (
    DETERMINED,
    NOT_DETERMINED,
    PARTLY_DETERMINED,
    classify_sd_ratio,
)
from pamjax.infer.fitting.identifiability import describe_weak_information
from pamjax.infer.fitting.report import (
    describe_contradicted_values,
    describe_fit_shortage,
    describe_noise_ratio,
    describe_origin,
    exceeds_noise,
    format_case_notes,
    format_correlations,
    format_fitted_value,
    format_form_errors,
    format_minimiser_state,
    format_misfit,
)
from pamjax.infer.fitting.result import CaseFit, Estimate, Fit
from pamjax.infer.problem.priors import is_length_error
from pamjax.text import join_words
from pamjax.units import format_estimate, format_quantity
from pamjax.view.figures import fit as figures
from pamjax.view.figures.fit_priors import select_with_prior
from pamjax.view.figures.layout import build_layout
from pamjax.view.reports.page import Picture, build_picture, write_page
from pamjax.view.wording import (
    BRANCHES_SENTENCE,
    capitalise_sentence,
    format_history,
    format_noise,
    is_stated_noise,
)

#: Largest number of parameters in the summary.
MAX_NAMED = 3
#: Largest number of isobars or lengths that the page can show one by one.
_MAX_GROUP_CHOICES = 12
#: First words above the headline.
_KICKER = "Fit of"
#: Share of the range of a channel above which an rms error is no noise of a sensor.
_LARGE_ERROR_SHARE = 0.1


def write_fit_report(fit: Fit, path: str | Path, command: str = "pamjax fit") -> Path:
    """Write the report of a fit.

    Args:
        fit: the fit.
        path: the HTML file; its folder must exist.
        command: shell command that repeats the fit.
    """
    estimates = {name: estimate for name, estimate in fit.estimates.items() if not is_length_error(name)}
    return write_page(
        path,
        "fit.html.jinja",
        title=format_headline(fit),
        kicker=f"{_KICKER} {join_words([each.case.name for each in fit.cases])} · {format_model(fit)}",
        answer=(
            format_agreement(fit),
            _format_estimates(estimates),
            *describe_contradicted_values(fit),
            *_describe_starts(fit),
        ),
        cases=[_describe_case(fit, case_fit, k) for k, case_fit in enumerate(fit.cases)],
        groups=_list_groups(fit),
        rows=[
            [
                n,
                format_fitted_value(estimate),
                describe_origin(estimate),
                estimate.meaning.about,
            ]
            for n, estimate in estimates.items()
        ],
        correlations=[capitalise_sentence(line.strip()) for line in format_correlations(fit)],
        prediction_caption=_format_prediction_caption(fit.cases[0]),
        prior=draw_picture(partial(figures.plot_prior, fit), "prior"),
        prior_caption=_format_prior_caption(fit, estimates),
        next_steps=list(_list_next_steps(fit, estimates)),
        assumptions=list(_list_assumptions(fit)),
        command=command,
    )


def is_fit_report(path: Path) -> bool:
    """Return whether a file is the report of a fit."""
    return path.is_file() and f'<p class="kicker">{_KICKER} ' in path.read_text("utf-8", errors="replace")


def _list_next_steps(fit: Fit, estimates: Mapping[str, Estimate]) -> Iterator[str]:
    """Yield the next steps, with commands for the folders of the cases; backticks enclose code."""
    cases = [case_fit.case for case_fit in fit.cases]
    folders = shlex.join(str(case.folder) for case in cases)
    has_misfit = _has_misfit(fit) or _find_large_error(fit)
    if has_misfit:
        reason = (
            "The misfit exceeds the noise." if _has_misfit(fit) else "The error is too large for a sensor."
        )
        yield (
            f"{reason} `pamjax diagnose {folders}` identifies the missing mechanisms."
            " The misfit increases all standard deviations above."
        )
    else:
        undetermined = [
            name
            for name, e in estimates.items()
            if name.startswith(("muscle.", "thread.")) and not e.is_determined
        ]
        if undetermined and len(cases) == 1:
            name = undetermined[0]
            yield (
                describe_weak_information(name, classify_sd_ratio(estimates[name].sd_ratio))
                + f" `pamjax plan {folders} --goal {name}` selects further runs."
            )
    if any(case.recording.measures_length for case in cases):
        if not has_misfit:
            yield f"`pamjax diagnose {folders}` tests whether other mechanisms explain the recording as well."
    else:
        yield (
            "The standard deviations above treat the noise level as exact."
            f" `pamjax sample {folders}` includes its uncertainty."
        )


def _find_large_error(fit: Fit) -> tuple[str, float] | None:
    """Return the channel without known noise whose rms error is a large share of its range, and the share."""
    for case_fit in fit.cases:
        for channel, rmse in case_fit.rmse.items():
            readings = getattr(case_fit.case.recording, channel)
            span = float(np.nanmax(readings) - np.nanmin(readings))
            if not case_fit.noise[channel].is_known and rmse > _LARGE_ERROR_SHARE * span:
                return channel, rmse / span
    return None


def format_model(fit: Fit) -> str:
    """Return the thread law and the mechanisms as text."""
    return f"{fit.law} threads" + (f" with {join_words(list(fit.mechanisms))}" if fit.mechanisms else "")


def draw_picture(plot: Any, name: str) -> Picture | None:
    """Return a figure for a page, wide and narrow."""
    return build_picture(lambda narrow: plot(narrow=narrow), name)


def _list_groups(fit: Fit) -> list[str]:
    """Return the isobars or lengths that the page can show one by one; empty for several cases."""
    names = list(build_layout(fit.cases[0].case).names)
    return names if len(fit.cases) == 1 and 1 < len(names) <= _MAX_GROUP_CHOICES else []


def _find_worst_channel(fit: Fit) -> tuple[CaseFit, str]:
    """Return the case and channel with the largest ratio of misfit to noise."""
    pairs = [(case_fit, channel) for case_fit in fit.cases for channel in case_fit.rmse]
    return max(
        pairs,
        key=lambda pair: pair[0].noise[pair[1]].rms_over_noise if pair[0].noise[pair[1]].is_known else 0.0,
    )


def _has_misfit(fit: Fit) -> bool:
    """Return whether a channel's misfit exceeds its noise."""
    case_fit, channel = _find_worst_channel(fit)
    return exceeds_noise(case_fit.noise[channel])


def format_headline(fit: Fit) -> str:
    """Return the result in one line."""
    case_fit, channel = _find_worst_channel(fit)
    noise = case_fit.noise[channel]
    if not fit.converged:
        return "The fit did not converge"
    if _has_misfit(fit) and noise.neighbour_sd is None:
        rmse = case_fit.rmse[channel]
        return f"The misfit of {channel} is {describe_noise_ratio(rmse, noise).partition(' (')[0]}"
    if _has_misfit(fit):
        return capitalise_sentence(format_misfit(channel, case_fit.rmse[channel], noise).partition(";")[0])
    if noise.is_known:
        return "The fitted model explains the recording within its noise"
    error = f"The RMS error of {channel} is {format_channel_value(case_fit.rmse[channel], channel)}"
    large = _find_large_error(fit)
    return f"{error}, {100 * large[1]:.0f} % of its range" if large and large[0] == channel else error


def _describe_starts(fit: Fit) -> tuple[str, ...]:
    """Return a warning if no second start found the result."""
    if fit.agreeing_starts > 1 or fit.starts == 1:
        return ()
    command = f"`--starts {3 * fit.starts}`"
    return (f"Only one of {fit.starts} starts found this result: repeat the fit with {command}.",)


def format_agreement(fit: Fit) -> str:
    """Return the misfit of every channel in the fit and in held-out blocks."""
    case_fit, _ = _find_worst_channel(fit)
    errors = join_words([_format_with_noise(case_fit, channel) for channel in case_fit.rmse])
    sentence = f"The RMS error of the fit is {errors}."
    if len(fit.cases) > 1:
        sentence = f"{case_fit.case.name}, the worst of {len(fit.cases)} fits, has an RMS error of {errors}."
    if case_fit.held_out_score is None or not case_fit.held_out_score.rmse:
        return f"{sentence} No block could be held out."
    held_out_errors = join_words(
        [
            f"{format_channel_value(rmse, channel)} for {channel}"
            for channel, rmse in case_fit.held_out_score.rmse.items()
        ]
    )
    return f"{sentence} The RMS error of held-out {case_fit.held_out_score.kind} is {held_out_errors}."


def _format_with_noise(case_fit: CaseFit, channel: str) -> str:
    """Return a channel's RMS error and noise."""
    noise_name = "noise" if case_fit.noise[channel].is_stated else "estimated noise"
    return (
        f"{format_channel_value(case_fit.rmse[channel], channel)} for {channel} ({noise_name}"
        f" {format_channel_value(case_fit.noise[channel].sd, channel)})"
    )


def _format_estimates(estimates: dict[str, Estimate]) -> str:
    """Return the parameters that the recording determines, that are at a limit, and the others."""
    names_at_limit = [name for name, estimate in estimates.items() if estimate.at_limit]
    names_by_kind: dict[str, list[str]] = {}
    for name, estimate in estimates.items():
        if name not in names_at_limit:
            names_by_kind.setdefault(classify_sd_ratio(estimate.sd_ratio), []).append(name)
    values = [
        f"{n} ({format_estimate(estimates[n].value, estimates[n].sd, estimates[n].meaning.show)})"
        for n in names_by_kind.get(DETERMINED, [])
    ]
    parts = (
        [f"The recording determines {join_words(_shorten_list(values))}."]
        if values
        else ["The recording determines no single parameter."]
    )
    if names_at_limit:
        parts.append(f"At a limit: {join_words(_shorten_list(names_at_limit))}.")
    parts += [
        f"{capitalise_sentence(kind)}: {join_words(_shorten_list(names_by_kind[kind]))}."
        for kind in (PARTLY_DETERMINED, NOT_DETERMINED)
        if kind in names_by_kind
    ]
    return " ".join(parts)


def _shorten_list(names: list[str]) -> list[str]:
    return names if len(names) <= MAX_NAMED else [*names[:MAX_NAMED], f"{len(names) - MAX_NAMED} more"]


def _describe_case(fit: Fit, case_fit: CaseFit, k: int) -> dict[str, Any]:
    has_several_cases = len(fit.cases) > 1
    return {
        "name": case_fit.case.name,
        "heading": f"{case_fit.case.name}: {case_fit.case.muscle_toml.name}"
        if has_several_cases
        else "Residuals",
        "prediction": draw_picture(partial(figures.plot_prediction, case_fit), f"prediction-{k}"),
        "residual": draw_picture(partial(figures.plot_residual, case_fit), f"residual-{k}"),
        "held_out": draw_picture(partial(figures.plot_held_out, case_fit), f"held-out-{k}")
        if case_fit.held_out_score
        else None,
        "scores": [_build_score_row(case_fit, channel) for channel in case_fit.rmse],
        "form_errors": [capitalise_sentence(line) for line in format_form_errors(case_fit)],
        "range": ", ".join(
            f"{name} {_format_range(low, high, unit)}"
            for (name, (low, high)), unit in zip(
                case_fit.calibrated_range.items(), ("kPa", "mm"), strict=True
            )
        ),
        "checksum": case_fit.case.checksum,
    }


def _format_range(low: float, high: float, unit: str) -> str:
    """Return a range as text, or one value if both ends are equal as text."""
    first, last = format_quantity(low, unit), format_quantity(high, unit)
    return first if first == last else f"{first} to {last}"


def _format_prediction_caption(case_fit: CaseFit) -> str:
    """Return the caption of the figure of the predictions, with the marks that it has."""
    if not build_layout(case_fit.case).is_connected:
        return "Points: measured values. Crosses: fitted model."
    text = "Points: measured values. Lines: fitted model."
    return f"{text} {BRANCHES_SENTENCE}" if case_fit.case.recording.has_time else text


def _format_prior_caption(fit: Fit, estimates: dict[str, Estimate]) -> str:
    """Return the caption of the figure of the priors."""
    names_without_prior = [name for name in estimates if name not in select_with_prior(fit)]
    text = "Each estimate relative to its prior."
    return (
        f"{text} Only limits are stated for {join_words(names_without_prior)}."
        if names_without_prior
        else text
    )


def _format_sentence(line: str, case_name: str = "") -> str:
    """Return a line of the terminal report as a sentence, with its case."""
    line = line.strip().rstrip(".")
    return f"{case_name}: {line}." if case_name else f"{capitalise_sentence(line)}."


def _build_score_row(case_fit: CaseFit, channel: str) -> list[str]:
    noise = case_fit.noise[channel]
    held_out_rmse = (
        case_fit.held_out_score.rmse.get(channel, math.nan) if case_fit.held_out_score else math.nan
    )
    return [
        channel,
        format_channel_value(case_fit.rmse[channel], channel),
        format_channel_value(held_out_rmse, channel) if math.isfinite(held_out_rmse) else "–",
        f"{format_channel_value(noise.sd, channel)}, {_format_noise_source(case_fit, channel)}",
        f"{noise.samples} ({noise.samples / noise.autocorrelation_time:.0f})",
    ]


def _format_noise_source(case_fit: CaseFit, channel: str) -> str:
    """Return the source of a channel's noise. The stated value excludes noise of pressure and length."""
    stated = getattr(case_fit.case.muscle_toml.sensors, channel)
    if not case_fit.noise[channel].is_stated or stated is None:
        return "stated" if case_fit.noise[channel].is_stated else "estimated"
    return (
        "stated"
        if is_stated_noise(case_fit.noise[channel].sd, stated)
        else f"{format_channel_value(stated, channel)} stated"
    )


def _list_assumptions(fit: Fit) -> Iterator[str]:
    yield f"The model is a braid of {format_model(fit)}. It includes no other mechanism of the library."
    yield from map(_format_sentence, format_minimiser_state(fit))
    if shortage := describe_fit_shortage(fit):
        yield _format_sentence(shortage)
    for case_fit in fit.cases:
        name = case_fit.case.name if len(fit.cases) > 1 else ""
        if fit.mechanisms:
            yield _format_sentence(format_history(case_fit.case), name)
        yield from (_format_sentence(line, name) for line in format_case_notes(case_fit))
        stated = [channel for channel in case_fit.rmse if case_fit.noise[channel].is_stated]
        yield from (
            _format_sentence(
                format_noise(case_fit.case, stated_channel, case_fit.noise[stated_channel].sd), name
            )
            for stated_channel in stated
        )
    yield (
        "The standard deviations include the misfit and its autocorrelation. They do not include the bias"
        " of a wrong model."
    )

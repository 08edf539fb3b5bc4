"""Report of a fit: how well the model fits the recording, and the fitted parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from pamjax.infer.fitting.report import (
    describe_origin,
    format_channel_value,
    format_correlations,
    format_estimate,
    format_minimiser_state,
    format_remarks,
)
from pamjax.infer.fitting.result import CaseFit, Estimate, Fit
from pamjax.infer.problem.priors import is_length_error
from pamjax.units import format_quantity
from pamjax.view.figures import fit as figures
from pamjax.view.figures.layout import build_layout
from pamjax.view.reports.page import Picture, build_picture, write_page
from pamjax.view.wording import capitalise_sentence, format_noise, is_stated_noise

#: How many numbers the first screen names.
MAX_NAMED = 3
#: Isobars or lengths, at most, that the page offers to show alone.
MAX_GROUP_CHOICES = 12


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
        kicker=f"Fit of {join_words([case_fit.case.name for case_fit in fit.cases])} · {format_model(fit)}",
        answer=(format_agreement(fit), format_estimates(estimates)),
        cases=[_describe_case(fit, case_fit, k) for k, case_fit in enumerate(fit.cases)],
        groups=_list_groups(fit),
        rows=[
            [
                n,
                format_estimate(estimate.value, estimate.sd, estimate.meaning.show),
                describe_origin(estimate),
                estimate.meaning.about,
            ]
            for n, estimate in estimates.items()
        ],
        together=[capitalise_sentence(line.strip()) for line in format_correlations(fit)],
        prior=draw_picture(partial(figures.plot_prior, fit), "prior"),
        prior_caption=_format_prior_caption(fit, estimates),
        misses=_has_misfit(fit),
        unlearned=[name for name, estimate in estimates.items() if estimate.shrinkage < 0.5],
        assumed=list(_list_assumptions(fit)),
        command=command,
    )


def format_model(fit: Fit) -> str:
    """Return the thread law and the mechanisms as text."""
    return f"{fit.law} threads" + (f" with {join_words(list(fit.mechanisms))}" if fit.mechanisms else "")


def join_words(parts: list[str]) -> str:
    """Return a list as text, with "and" before the last item.

    >>> join_words(["force", "diameter", "time"])
    'force, diameter and time'
    """
    return parts[0] if len(parts) == 1 else ", ".join(parts[:-1]) + " and " + parts[-1] if parts else ""


def draw_picture(plot: Any, name: str) -> Picture | None:
    """Return a figure for a page, wide and narrow."""
    return build_picture(lambda narrow: plot(narrow=narrow), name)


def _list_groups(fit: Fit) -> list[str]:
    """Return the isobars or lengths that a reader can show one by one; empty for several cases."""
    names = list(build_layout(fit.cases[0].case).names)
    return names if len(fit.cases) == 1 and 1 < len(names) <= MAX_GROUP_CHOICES else []


def _find_worst_channel(fit: Fit) -> tuple[CaseFit, str]:
    """Return the case and channel with the largest ratio of misfit to noise."""
    pairs = [(case_fit, channel) for case_fit in fit.cases for channel in case_fit.rmse]
    return max(
        pairs, key=lambda pair: pair[0].noise[pair[1]].excess if pair[0].noise[pair[1]].stated else 0.0
    )


def _has_misfit(fit: Fit) -> bool:
    """Return whether a channel's misfit exceeds its noise."""
    case_fit, channel = _find_worst_channel(fit)
    return case_fit.noise[channel].stated and case_fit.noise[channel].excess > figures.MIN_MISS_RATIO


def format_headline(fit: Fit) -> str:
    """Return the finding in one line."""
    case_fit, channel = _find_worst_channel(fit)
    noise = case_fit.noise[channel]
    if not fit.converged:
        return "The fit did not converge"
    if _has_misfit(fit):
        return f"The model misses {channel} by {noise.excess:.2g} times its noise"
    if noise.stated:
        return "The calibrated muscle meets its recording to the noise"
    return f"Calibrated: {channel} is met to {format_channel_value(case_fit.rmse[channel], channel)}"


def format_agreement(fit: Fit) -> str:
    """Return the misfit of every channel in the fit and in held-out blocks."""
    case_fit, _ = _find_worst_channel(fit)
    first_channel, *other_channels = case_fit.rmse
    parts = [f"{first_channel} is met to {_format_with_noise(case_fit, first_channel)}"]
    text = join_words(
        [*parts, *(f"{channel} to {_format_with_noise(case_fit, channel)}" for channel in other_channels)]
    )
    if len(fit.cases) > 1:
        text = f"In {case_fit.case.name}, the worst of {len(fit.cases)}, {text}"
    if case_fit.held_out is None or not case_fit.held_out.rmse:
        return f"{capitalise_sentence(text)}; nothing could be held out."
    held_out_text = join_words(
        [format_channel_value(rmse, channel) for channel, rmse in case_fit.held_out.rmse.items()]
    )
    return (
        f"{capitalise_sentence(text)}; {case_fit.held_out.kind} that the fit never saw are missed by"
        f" {held_out_text}."
    )


def _format_with_noise(case_fit: CaseFit, channel: str) -> str:
    """Return a channel's misfit and noise."""
    noise_name = "noise" if case_fit.noise[channel].stated else "the residual's own noise"
    return (
        f"{format_channel_value(case_fit.rmse[channel], channel)} ({noise_name}"
        f" {format_channel_value(case_fit.noise[channel].sd, channel)})"
    )


def format_estimates(estimates: dict[str, Estimate]) -> str:
    """Return which parameters the data determine, in one sentence."""
    names_at_limit = [name for name, estimate in estimates.items() if estimate.at_limit]
    determined = [
        f"{n} {format_estimate(estimate.value, estimate.sd, estimate.meaning.show)}"
        for n, estimate in estimates.items()
        if estimate.shrinkage >= 0.5 and n not in names_at_limit
    ]
    undetermined = [
        n for n, estimate in estimates.items() if estimate.shrinkage < 0.5 and n not in names_at_limit
    ]
    parts = (
        [f"It determines {join_words(_shorten_list(determined))}"]
        if determined
        else ["It determines no number by itself"]
    )
    if names_at_limit:
        parts.append(
            f"{join_words(_shorten_list(names_at_limit))} {'sits' if len(names_at_limit) == 1 else 'sit'}"
            f" at a limit"
        )
    if undetermined:
        parts.append(
            f"{join_words(_shorten_list(undetermined))} {'is' if len(undetermined) == 1 else 'are'}"
            f" mostly what was believed before"
        )
    return "; ".join(parts) + "."


def _shorten_list(names: list[str]) -> list[str]:
    return names if len(names) <= MAX_NAMED else [*names[:MAX_NAMED], f"{len(names) - MAX_NAMED} more"]


def _describe_case(fit: Fit, case_fit: CaseFit, k: int) -> dict[str, Any]:
    has_several_cases = len(fit.cases) > 1
    return {
        "name": case_fit.case.name,
        "heading": f"{case_fit.case.name}: {case_fit.case.entry.name}"
        if has_several_cases
        else "Where it misses",
        "prediction": draw_picture(partial(figures.plot_prediction, case_fit), f"prediction-{k}"),
        "residual": draw_picture(partial(figures.plot_residual, case_fit), f"residual-{k}"),
        "held_out": draw_picture(partial(figures.plot_held_out, case_fit), f"held-out-{k}")
        if case_fit.held_out
        else None,
        "scores": [_build_score_row(case_fit, channel) for channel in case_fit.rmse],
        "range": ", ".join(
            f"{name} {format_quantity(low, unit)} to {format_quantity(high, unit)}"
            for (name, (low, high)), unit in zip(
                case_fit.calibrated_range.items(), ("kPa", "mm"), strict=True
            )
        ),
        "checksum": case_fit.case.checksum,
    }


def _format_prior_caption(fit: Fit, estimates: dict[str, Estimate]) -> str:
    """Return the caption of the figure of the priors."""
    names_without_prior = [name for name in estimates if name not in figures.select_with_prior(fit)]
    text = "Each number on the scale of what was believed before."
    return (
        f"{text} Nothing was believed of {join_words(names_without_prior)} but limits."
        if names_without_prior
        else text
    )


def _format_sentence(line: str, case_name: str = "") -> str:
    """Return a line of the terminal report as a sentence, with its case."""
    line = line.strip().rstrip(".")
    return f"{case_name}: {line}." if case_name else f"{capitalise_sentence(line)}."


def _build_score_row(case_fit: CaseFit, channel: str) -> list[str]:
    noise = case_fit.noise[channel]
    held_out_rmse = case_fit.held_out.rmse.get(channel, math.nan) if case_fit.held_out else math.nan
    return [
        channel,
        format_channel_value(case_fit.rmse[channel], channel),
        format_channel_value(held_out_rmse, channel) if math.isfinite(held_out_rmse) else "–",
        f"{format_channel_value(noise.sd, channel)}, {_format_noise_source(case_fit, channel)}",
        f"{noise.samples} ({noise.samples / noise.inflation:.0f})",
    ]


def _format_noise_source(case_fit: CaseFit, channel: str) -> str:
    """Return the source of a channel's noise; the stated value excludes noise of pressure and length."""
    stated = getattr(case_fit.case.entry.sensors, channel)
    if not case_fit.noise[channel].stated or stated is None:
        return "stated" if case_fit.noise[channel].stated else "estimated"
    return (
        "stated"
        if is_stated_noise(case_fit.noise[channel].sd, stated)
        else f"its sensor's {format_channel_value(stated, channel)}"
    )


def _list_assumptions(fit: Fit) -> Iterator[str]:
    yield f"The model is a braid of {format_model(fit)}; the others of the library are left out."
    yield from map(_format_sentence, format_minimiser_state(fit))
    for case_fit in fit.cases:
        name = case_fit.case.name if len(fit.cases) > 1 else ""
        history_text = (
            "was at rest" if case_fit.case.before == "relaxed" else "had been through the same recording once"
        )
        if fit.mechanisms:
            gaps = "goes on" if case_fit.case.gaps == "carry" else "begins anew"
            yield _format_sentence(
                f"before its first sample the muscle {history_text}; memory {gaps} at a jump", name
            )
        yield from (_format_sentence(line, name) for line in format_remarks(case_fit))
        stated = [channel for channel in case_fit.rmse if case_fit.noise[channel].stated]
        yield from (
            _format_sentence(
                format_noise(case_fit.case, stated_channel, case_fit.noise[stated_channel].sd), name
            )
            for stated_channel in stated
        )
    yield (
        "Standard deviations widen with the misfit and with its correlation; a wrong model can still be"
        " surely wrong."
    )

"""The text report of a fit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from pamjax.channels import format_channel_value
from pamjax.infer.fitting.determination import describe_row_shortage, describe_sd_ratio
from pamjax.infer.fitting.impossible_lengths import describe_impossible_lengths
from pamjax.infer.form_errors.parts import MIN_SHOWN_EFFECT
from pamjax.infer.noise.sensor_noise import ChannelNoise
from pamjax.infer.problem.informative_samples import count_informative_samples
from pamjax.infer.problem.priors import is_length_error
from pamjax.infer.problem.row_counts import describe_unused_rows
from pamjax.records.reading.muscle_toml import describe_unused_bladder
from pamjax.units import compute_si_factor, format_estimate, format_number, format_quantity, round_by_sd

if TYPE_CHECKING:
    from pamjax.infer.fitting.result import CaseFit, Estimate, Fit
    from pamjax.records.case import Case

#: The report lists correlations above this.
MIN_REPORTED_CORRELATION = 0.8

#: Ratio of misfit to noise above which a misfit is reported.
MIN_EXCESS = 1.5

#: Largest relative difference between two ratios of misfit and noise that count as the same.
_RATIO_TOLERANCE = 0.1

#: With larger differences of neighbouring samples, relative to the misfit, noise explains most of the misfit.
_MAX_NEIGHBOUR_SHARE = 0.7

#: A parameter that shifts by more prior standard deviations contradicts its stated value.
MAX_PRIOR_SHIFT_SD = 3.0


def format_fit_summary(fit: Fit) -> str:
    """Return the full report as plain text."""
    lines = [_format_title(fit), "", *_format_estimates(fit), "", *format_correlations(fit)]
    for case_fit in fit.cases:
        lines += ["", *_format_case(case_fit, len(fit.cases) > 1)]
        unused_entries = describe_unused_bladder(case_fit.case.muscle_toml, fit.mechanisms)
        lines += [f"  note: {note}" for note in unused_entries]
    lines += [f"  note: {sentence}" for sentence in describe_contradicted_values(fit)]
    if shortage := describe_fit_shortage(fit):
        lines += ["", f"  note: {shortage}"]
    return "\n".join([*lines, "", *format_minimiser_state(fit)])


def describe_fit_shortage(fit: Fit) -> str | None:
    """Return a warning if all cases have fewer samples than parameters that only they determine."""
    samples = sum(count_informative_samples(case_fit.case) for case_fit in fit.cases)
    return describe_row_shortage(samples, [e.prior_sd for e in fit.estimates.values()])


def describe_contradicted_values(fit: Fit) -> list[str]:
    """Return a sentence on each stated value that the fit contradicts: many sd away, or at its limit."""
    return [
        format_contradicted_value(name, e.value, (e.prior, e.prior_sd), e.meaning.show, e.sd)
        for name, e in fit.estimates.items()
        if not is_length_error(name)
        and math.isfinite(e.prior_sd)
        and (e.at_limit or abs(e.value - e.prior) > MAX_PRIOR_SHIFT_SD * e.prior_sd)
    ]


def format_contradicted_value(
    name: str, value: float, stated: tuple[float, float], unit: str, sd: float | None = None
) -> str:
    """Return a sentence on an estimate that contradicts its stated value.

    Args:
        name: name of the parameter.
        value: the estimate, SI.
        stated: the stated value and its standard deviation, SI.
        unit: display unit.
        sd: standard deviation of the estimate, SI; None at a limit.

    >>> format_contradicted_value("muscle.turns", 1.105, (1.09, 0.005), "1")[:53]
    '`muscle.turns` is 1.105, 3.0 sd from the stated value'
    """
    deviation = abs(value - stated[0]) / stated[1]
    return (
        f"`{name}` is {format_estimate(value, sd, unit)}, {deviation:.1f} sd from the stated value"
        f" ({format_estimate(*stated, unit)}). Check this value in muscle.toml."
        " If it is right, the model lacks a mechanism."
    )


def format_fitted_value(e: Estimate) -> str:
    """Return value ± sd; a value at a limit, which has no sd, with the digits of its prior or three."""
    unit = e.meaning.show
    if not e.at_limit or e.sd:
        return format_estimate(e.value, e.sd, unit)
    if not math.isfinite(e.prior_sd):
        return format_quantity(e.value, unit, 3)
    (value,), power = round_by_sd([e.value], e.prior_sd, unit)
    return f"{value}{power}" if unit == "1" else f"{value}{power} {unit}"


def _format_title(fit: Fit) -> str:
    rows = sum(int(case_fit.case.recording.usable.sum()) for case_fit in fit.cases)
    cases = ", ".join(case_fit.case.name for case_fit in fit.cases)
    return f"{cases}: {', '.join((f'{fit.law} threads', *fit.mechanisms))}, {rows} rows"


def _format_estimates(fit: Fit) -> Iterator[str]:
    parameters = {n: e for n, e in fit.estimates.items() if not is_length_error(n)}
    width = max(map(len, parameters), default=0)
    for name, e in parameters.items():
        yield f"  {name:<{width}}  {format_fitted_value(e):<24} {describe_origin(e)}"
    errors = [e for n, e in fit.estimates.items() if is_length_error(n)]
    if errors:
        worst = max(errors, key=lambda e: abs(e.value))
        sd = math.sqrt(np.mean([e.value**2 for e in errors])) * 1e3
        yield (
            f"  {len(errors)} length settings have errors of {sd:.2g} mm rms,"
            f" at most {1e3 * worst.value:+.2g} mm "
            f"(prior ± {1e3 * worst.prior_sd:.2g} mm)"
        )


def describe_origin(e: Estimate) -> str:
    """Return how well a parameter is determined, with its prior, in words."""
    stated = e.prior, e.prior_sd
    if e.at_limit and math.isfinite(e.prior_sd) and e.is_inside_bounds:
        return f"AT ITS {e.limit_name.upper()}; {describe_prior(e.value, stated, e.meaning.show, '')}"
    if e.at_limit:
        low, high = (x / compute_si_factor(e.meaning.show) for x in (e.meaning.low, e.meaning.high))
        unit = "" if e.meaning.show == "1" else f" {e.meaning.show}"
        return f"AT ITS {e.limit_name.upper()} ({low:g} to {high:g}{unit})"
    if not math.isfinite(e.prior_sd):
        return f"{describe_sd_ratio(e.sd_ratio)}; uniform prior"
    kind = describe_sd_ratio(e.sd_ratio, (e.value - e.prior) / e.prior_sd)
    return f"{kind}; {describe_prior(e.value, stated, e.meaning.show)}"


def describe_prior(
    value: float, stated: tuple[float, float], unit: str, warning: str = ", CONTRADICTS ITS PRIOR"
) -> str:
    """Return the prior of a parameter and the shift of its estimate, with a warning if that is large.

    Args:
        value: the estimate, SI.
        stated: mean and standard deviation of the prior, SI.
        unit: display unit.
        warning: the warning.

    >>> describe_prior(22e9, (65e9, 10e9), "GPa")
    'prior 65 ± 10 GPa, shift -4.3 sd, CONTRADICTS ITS PRIOR'
    """
    shift = (value - stated[0]) / stated[1]
    shift_text = f"shift {shift:+.1f} sd" if abs(shift) >= 0.05 else "no shift"
    warning = warning if abs(shift) > MAX_PRIOR_SHIFT_SD else ""
    return f"prior {format_estimate(*stated, unit)}, {shift_text}{warning}"


def format_correlations(fit: Fit) -> Iterator[str]:
    """Return lines with the strongest correlations."""
    names = list(fit.estimates)
    pairs = [
        (abs(fit.correlation[i, j]), names[j], names[i], fit.correlation[i, j])
        for i in range(len(names))
        for j in range(i)
        if abs(fit.correlation[i, j]) > MIN_REPORTED_CORRELATION
        and fit.estimates[names[i]].sd
        and fit.estimates[names[j]].sd
    ]
    for _, first, second, value in sorted(pairs, reverse=True)[:5]:
        yield f"  {first} and {second} are correlated ({value:+.2f})"
    if not pairs:
        yield f"  no correlation is above {MIN_REPORTED_CORRELATION}"


def _format_case(case_fit: CaseFit, several: bool) -> Iterator[str]:
    if several:
        yield f"{case_fit.case.name}"
    for channel, value in case_fit.rmse.items():
        noise = case_fit.noise[channel]
        kind = _describe_noise_source(noise)
        line = (
            f"  {channel}: rmse {format_channel_value(value, channel)}, {kind}"
            f" {format_channel_value(noise.sd, channel)}"
        )
        if case_fit.held_out_score and channel in case_fit.held_out_score.rmse:
            line += (
                f", held-out {case_fit.held_out_score.kind}"
                f" {format_channel_value(case_fit.held_out_score.rmse[channel], channel)}"
            )
        yield line
        if channel == "length":
            yield f"    {_format_contraction_error(case_fit, value)}"
        if noise.autocorrelation_time > 1.5:
            duration = f" over {_format_seconds(noise.correlation_time)}" if noise.correlation_time else ""
            yield (
                f"    residuals are correlated{duration}: {noise.samples} samples,"
                f" effective sample size {noise.samples / noise.autocorrelation_time:.0f}"
            )
        if exceeds_noise(noise):
            yield f"    {format_misfit(channel, value, noise)}"
    yield from (f"  {line}" for line in format_form_errors(case_fit))
    yield from (f"  {line}" for line in format_case_notes(case_fit))


def format_form_errors(case_fit: CaseFit) -> Iterator[str]:
    """Return a line on the form error of each mechanism: its size, and the part of the equation."""
    for id, part in case_fit.form_errors.items():
        effects = select_shown_effects(case_fit, part.effect_rms)
        if not effects:
            continue
        textbook_part = ", ".join(format_channel_value(rms, channel) for channel, rms in effects.items())
        if not part.share:
            yield f"form error of {id}: none, textbook part {textbook_part}"
            continue
        rms_by_channel = zip(case_fit.case.recording.model_channels, part.form_rms, strict=True)
        forms = ", ".join(format_channel_value(rms, c) for c, rms in rms_by_channel if c in effects)
        yield f"form error of {id}: {part.ratio:.0%} (rms {forms}), textbook part {textbook_part}"


def select_shown_effects(case_fit: CaseFit, effect_rms: np.ndarray) -> dict[str, float]:
    """Return the rms effect of a mechanism, (2,), SI, of each channel in which it is not negligible."""
    return {
        channel: float(rms)
        for channel, rms in zip(case_fit.case.recording.model_channels, effect_rms, strict=True)
        if channel in case_fit.noise and rms > MIN_SHOWN_EFFECT * case_fit.noise[channel].sd
    }


def _format_contraction_error(case_fit: CaseFit, rmse: float) -> str:
    """Return the error of a measured length, m, as a share of the rest length.

    Args:
        case_fit: fit of an isotonic recording.
        rmse: rms error of the length, m.
    """
    share = 100 * rmse / case_fit.case.muscle_toml.rest_length.value
    return f"force is set and length is measured: an error of {share:.2g} % contraction"


def _describe_noise_source(noise: ChannelNoise) -> str:
    if noise.is_stated:
        return "noise"
    source = "the residuals" if noise.neighbour_sd is None else "neighbouring samples"
    return f"noise from {source} (no sensor stated)"


def exceeds_noise(noise: ChannelNoise) -> bool:
    """Return whether the misfit of a channel exceeds its noise."""
    return noise.is_known and noise.rms_over_noise > MIN_EXCESS


def format_misfit(channel: str, rmse: float, noise: ChannelNoise) -> str:
    """Return a clause on a misfit above the noise: its size, its probable cause, and what to do.

    Args:
        channel: the channel.
        rmse: rms residual, SI.
        noise: the noise of the channel.
    """
    if noise.neighbour_sd is None:
        return f"misfit is {describe_noise_ratio(rmse, noise)}: the model lacks a mechanism"
    if not noise.is_stated:
        # The line above has the only estimate of the noise; a second one would contradict it.
        return (
            f"the rmse of {channel} is {format_channel_value(rmse, channel)}, {rmse / noise.sd:.1f} times its"
            " noise: the model may lack a mechanism; run `pamjax diagnose`"
        )
    rmse_text, noise_text = (format_channel_value(value, channel) for value in (rmse, noise.neighbour_sd))
    if noise.neighbour_sd > _MAX_NEIGHBOUR_SHARE * rmse:
        return (
            f"the rmse of {channel} is {rmse_text}, and the noise of neighbouring samples is {noise_text}:"
            " check the noise in [sensors]"
        )
    return (
        f"the rmse of {channel} is {rmse_text}, while the noise of neighbouring samples is {noise_text}:"
        " the model may lack a mechanism; run `pamjax diagnose`"
    )


def describe_noise_ratio(rmse: float, noise: ChannelNoise) -> str:
    """Return the ratio of rmse and noise in words, and that row by row if another one decides on a misfit.

    Args:
        rmse: rms residual, SI.
        noise: the noise of the channel; its sd is the rms over the rows.
    """
    ratio, row_ratio = (format_number(x, 2) for x in (rmse / noise.sd, noise.rms_over_noise))
    if abs(rmse / noise.sd / noise.rms_over_noise - 1) < _RATIO_TOLERANCE:
        return f"{ratio} times the noise"
    return f"{ratio} times the noise (rms of residual over noise, row by row: {row_ratio})"


def format_case_notes(case_fit: CaseFit) -> Iterator[str]:
    """Return lines on unused rows, held-out blocks, failed rows, outliers and warnings."""
    yield from describe_unused_rows(case_fit.case)
    yield _format_held_out(case_fit)
    for status, rows in case_fit.failed_rows.items():
        yield f"{len(rows)} rows failed, {status.message} (lines {_format_rows(rows)} of the file)"
    if lengths := describe_impossible_lengths(case_fit):
        yield f"note: {lengths}"
    yield from list_outliers_and_warnings(case_fit.case)


def list_outliers_and_warnings(case: Case) -> Iterator[str]:
    """Return a line on each warning of a case, and on each outlier that is not among them."""
    # The warnings of a case that was read from files include its outliers.
    yield from (str(outlier) for outlier in case.recording.outliers if f"{outlier}." not in case.warnings)
    yield from (f"note: {warning}" for warning in case.warnings)


def _format_seconds(time: float) -> str:
    return f"{time:.0f} s" if time >= 10 else f"{time:.2g} s"


def _format_held_out(case_fit: CaseFit) -> str:
    if case_fit.held_out_score is None:
        return "no cross-validation: the recording has only one block"
    folds = case_fit.held_out_score.folds
    lines = ", by line of the file" if case_fit.held_out_score.kind in ("rows", "parts") else ""
    text = f"cross-validation folds{lines}: " + " | ".join("; ".join(fold) for fold in folds)
    if len(text) < 200:
        return text
    return f"cross-validation: {sum(map(len, folds))} {case_fit.held_out_score.kind} in {len(folds)} folds"


def _format_rows(rows: np.ndarray) -> str:
    head = ", ".join(map(str, rows[:5]))
    return head + (", …" if len(rows) > 5 else "")


def format_minimiser_state(fit: Fit) -> Iterator[str]:
    """Return lines on convergence, the starts and the loss."""
    state = "converged" if fit.converged else "DID NOT CONVERGE"
    yield f"  {state} in {fit.steps} steps; {fit.agreeing_starts} of {fit.starts} starts agree"
    if fit.loss == "soft":
        yield "  soft loss: outliers have less weight"
    if fit.agreeing_starts < fit.starts:
        yield "  the other starts ended with a larger misfit: the best fit is reported"

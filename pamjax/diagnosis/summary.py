"""Summary of a diagnosis on the screen: one group of lines for each of its answers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from pamjax.channels import DISPLAY_UNIT, to_display
from pamjax.diagnosis.estimates import build_parameter_estimate, order_estimates
from pamjax.diagnosis.notes import (
    describe_contradicted_values,
    describe_contradiction,
    describe_untested_effects,
    format_untestable_mechanisms,
)
from pamjax.diagnosis.unexplained import describe_unexplained_probability, describe_unexplained_reason
from pamjax.model.registry import find_mechanism
from pamjax.text import format_p_value, join_words
from pamjax.units import format_number

if TYPE_CHECKING:
    from pamjax.diagnosis.estimates import ParameterEstimate
    from pamjax.diagnosis.result import Diagnosis
    from pamjax.diagnosis.select.rivals import NamedMechanism

#: Largest number of lines of the summary.
MAX_SUMMARY_LINES = 25

#: Largest number of contradicted stated values in the summary.
_MAX_CONTRADICTIONS = 2

#: Largest number of notes in the summary.
_MAX_SUMMARY_NOTES = 3


def format_summary(diagnosis: Diagnosis) -> str:
    """Return the summary: misfit, mechanisms, unexplained part, held-out error, next experiment, notes."""
    lines = [
        f"{diagnosis.problem.case.name}: {diagnosis.problem.case.muscle_toml.name},"
        f" {diagnosis.problem.law} baseline",
        *_format_misfit(diagnosis),
        *(line for m in diagnosis.named_mechanisms for line in _format_mechanism(diagnosis, m)),
        *_format_untested_effects(diagnosis),
        *_format_contradicted_values(diagnosis),
        *_format_unexplained_part(diagnosis),
        *_format_held_out_errors(diagnosis),
        *_format_parameter_shifts(diagnosis),
        *_format_experiments(diagnosis),
        *_format_notes(diagnosis),
    ]
    return "\n".join(lines[:MAX_SUMMARY_LINES])


def _format_misfit(diagnosis: Diagnosis) -> Iterator[str]:
    p_text = format_p_value(diagnosis.baseline_test.p_value)
    if not diagnosis.is_detected:
        yield f"  no systematic misfit detected ({p_text})"
        return
    yield f"  systematic misfit of the baseline ({p_text})"
    for region in diagnosis.misfit_regions[:3]:
        yield f"    {region.description} ({region.share:.0%} of the misfit)"


def _format_mechanism(diagnosis: Diagnosis, mechanism: NamedMechanism) -> Iterator[str]:
    title, form = find_mechanism(mechanism.id).about.title, mechanism.form_error
    form_error = f", form error {form:.0%}" if form is not None and form >= 0.01 else ""
    yield f"  {mechanism.id}: {title}, probability {mechanism.probability:.2f}{form_error}"
    estimates = order_estimates(diagnosis.parameters[mechanism.id])[:3]
    yield "    " + ", ".join(format_named_estimate(name, estimate) for name, estimate in estimates)
    if mechanism.indistinguishable:
        rivals = join_words(mechanism.indistinguishable)
        yield f"    this recording does not distinguish it from {rivals}"


def _format_contradicted_values(diagnosis: Diagnosis) -> Iterator[str]:
    sentences = describe_contradicted_values(diagnosis.problem, diagnosis.model)
    for sentence in sentences[:_MAX_CONTRADICTIONS]:
        yield f"  {sentence}"


def _format_untested_effects(diagnosis: Diagnosis) -> Iterator[str]:
    if effects := describe_untested_effects(diagnosis.problem):
        yield f"  {effects}"


def _format_notes(diagnosis: Diagnosis) -> Iterator[str]:
    # The summary has a line of its own on the effects that were not tested.
    shown_above = format_untestable_mechanisms(diagnosis.problem)
    notes = [note for note in diagnosis.notes if note not in shown_above]
    yield from (f"  note: {note}" for note in notes[:_MAX_SUMMARY_NOTES])


def _format_unexplained_part(diagnosis: Diagnosis) -> Iterator[str]:
    if diagnosis.is_faint:
        rms = math.sqrt(max(diagnosis.baseline_test.mean_square - 1, 0.0))
        yield f"  the misfit is too small to identify a mechanism: its rms is {rms:.2f} times the noise"
    if not diagnosis.unexplained:
        return
    likeness = f"; like {diagnosis.likenesses[0].description}" if diagnosis.likenesses else ""
    share = "below 1%" if diagnosis.residual_share < 0.005 else f"{diagnosis.residual_share:.0%}"
    tested = "" if diagnosis.problem.case.recording.has_time else "tested "
    yield f"  unexplained: {share} of the misfit; no {tested}mechanism of the library explains it{likeness}"
    if reason := describe_unexplained_reason(diagnosis):
        yield f"    {reason}"
    if probability := describe_unexplained_probability(diagnosis):
        yield f"    {probability}"
    for region in diagnosis.residual_regions[:2]:
        yield f"    {region.description}"


def _format_held_out_errors(diagnosis: Diagnosis) -> Iterator[str]:
    errors, channels = diagnosis.held_out_errors, diagnosis.problem.channels
    for channel in errors.baseline_rmse:
        baseline_rmse, model_rmse = (
            to_display(channel, rmse[channel]) for rmse in (errors.baseline_rmse, errors.model_rmse)
        )
        unit, blocks = DISPLAY_UNIT[channel], errors.block_description.split(":")[0]
        noise = to_display(channel, diagnosis.model.noise.compute_rms_sd(channels.index(channel)))
        parts = [f"baseline {format_number(baseline_rmse, 3)} {unit}"]
        if diagnosis.named_mechanisms:
            parts.append(f"with mechanisms {format_number(model_rmse, 3)} {unit}")
        if diagnosis.named_mechanisms and channel in errors.expected_rmse:
            expected = to_display(channel, errors.expected_rmse[channel])
            parts.append(f"expected {format_number(expected, 3)} {unit}")
        parts.append(f"noise {format_number(noise, 3)} {unit}")
        yield f"  held-out rmse of {channel} ({blocks}): {', '.join(parts)}"
    if diagnosis.fails_held_out:
        yield (
            f"  the held-out error is {errors.largest_error_ratio:.1f} times the expected one: physics is"
            " missing, or a named mechanism is wrong"
        )
    if diagnosis.named_mechanisms and errors.is_increased(diagnosis.settings):
        yield "  the mechanisms increase the held-out error: do not use this model to predict"
    elif doubt := describe_unconfirmed(diagnosis):
        yield f"  {doubt}"
    if diagnosis.named_mechanisms and not errors.baseline_rmse:
        yield (
            "  no block was held out (too few blocks): no independent rows confirm these mechanisms."
            " Record at least three pressures."
        )


def describe_unconfirmed(diagnosis: Diagnosis) -> str | None:
    """Return a sentence if held-out errors are larger with the mechanisms, but not more than by chance."""
    errors = diagnosis.held_out_errors
    if not diagnosis.named_mechanisms or errors.is_increased(diagnosis.settings) or not errors.is_larger:
        return None
    return (
        "The held-out error is larger with the mechanisms, but the increase is within the noise."
        " These blocks do not confirm the mechanisms."
    )


def _format_experiments(diagnosis: Diagnosis) -> Iterator[str]:
    for experiment in diagnosis.experiments[:2]:
        separated = join_words(experiment.separates)
        yield (
            f"  next experiment: {experiment.protocol}: separates {separated}"
            f" with probability {experiment.power:.2f}"
        )


def _format_parameter_shifts(diagnosis: Diagnosis) -> Iterator[str]:
    shifts = sorted(diagnosis.parameter_shifts.items(), key=lambda pair: -pair[1].order)
    for name, shift in shifts[:3]:
        if diagnosis.named_mechanisms and shift.order > 1:
            problem = diagnosis.problem
            before, after = (
                build_parameter_estimate(problem, fit, problem.index(name))
                for fit in (diagnosis.baseline, diagnosis.model)
            )
            warning = describe_contradiction(problem, diagnosis.model, name)
            yield f"  {name} changes from {before} to {after}{warning}"


def format_named_estimate(name: str, estimate: ParameterEstimate) -> str:
    """Return an estimate as text, as "coefficient 0.210 ± 0.012", or as "coefficient not determined"."""
    if not estimate.is_determined:
        return f"{name} not determined"
    return f"{name} {estimate}"

"""First screen of a diagnosis report: what is missing, how sure, where, how much better, what to do next."""

from __future__ import annotations

from dataclasses import dataclass

from pamjax.baselines.comparison import MODEL_TITLES, SAROSI_MODEL, ModelComparison
from pamjax.channels import DISPLAY_UNIT, to_display
from pamjax.diagnosis.estimates import order_estimates
from pamjax.diagnosis.next_step import describe_next_step
from pamjax.diagnosis.notes import describe_contradicted_values, describe_untested_effects
from pamjax.diagnosis.result import Diagnosis
from pamjax.diagnosis.select.rivals import NamedMechanism
from pamjax.diagnosis.suggested_commands import MODEL_FILE
from pamjax.diagnosis.summary import describe_unconfirmed, format_named_estimate
from pamjax.diagnosis.unexplained import describe_unexplained_probability, describe_unexplained_reason
from pamjax.model.registry import find_mechanism
from pamjax.text import format_p_value, join_words
from pamjax.units import format_number

#: Probabilities above this limit are shown as "above 0.99".
_MAX_SHOWN_PROBABILITY = 0.995
#: Question beside the bars of the held-out errors.
IMPROVEMENT_QUESTION = "How much better"
_REPORT_FOLDER = "Run this command in the folder of this report."
#: Largest number of regions and of estimates on the first screen; the evidence has all of them.
_MAX_SHOWN_REGIONS, _MAX_SHOWN_ESTIMATES = 2, 3


@dataclass(frozen=True)
class Answer:
    """Answer to one question.

    Attributes:
        question: two or three words.
        sentences: parts between backticks are code.
    """

    question: str
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class HeldOutBar:
    """Held-out errors of one channel.

    Attributes:
        channel: its name.
        rows: label, value with unit, and length of the bar in percent of the largest value.
    """

    channel: str
    rows: tuple[tuple[str, str, float], ...]


def format_headline(diagnosis: Diagnosis) -> str:
    """Return what is missing, in one line."""
    if not diagnosis.is_detected:
        return "The baseline has no misfit beyond the noise"
    if diagnosis.is_faint:
        return "The baseline has a misfit that is too small to identify its cause"
    if not diagnosis.named_mechanisms:
        tested = "" if diagnosis.problem.case.recording.has_time else "tested "
        return f"The baseline has a misfit that no {tested}mechanism of the library explains"
    titles = join_words([_name_with_ties(mechanism) for mechanism in diagnosis.named_mechanisms])
    addition = "; part of the misfit is unexplained" if diagnosis.unexplained else ""
    return f"Missing from the baseline: {titles}{addition}"


def _name_with_ties(mechanism: NamedMechanism) -> str:
    """Return the title of a mechanism, with the one, or the number of those, that cannot be distinguished."""
    title, ties = find_mechanism(mechanism.id).about.title, mechanism.indistinguishable
    if not ties:
        return title
    others = find_mechanism(ties[0]).about.title if len(ties) == 1 else f"one of {len(ties)} other mechanisms"
    return f"{title} (or {others})"


def list_answers(
    diagnosis: Diagnosis, comparison: ModelComparison | None = None, model: str = MODEL_FILE
) -> list[Answer]:
    """Return the answers in the order in which a reader needs them.

    Args:
        diagnosis: the diagnosis.
        comparison: held-out errors of an empirical formula, if computed.
        model: path of model.json, as text for a shell.
    """
    answers = [
        Answer("Missing" if diagnosis.is_detected else "Result", _describe_missing(diagnosis)),
        Answer("How sure", _describe_certainty(diagnosis)),
        Answer("Not tested", _describe_untested_effects(diagnosis)),
        Answer("Where", _describe_location(diagnosis)),
        Answer(
            IMPROVEMENT_QUESTION if diagnosis.named_mechanisms else "Held-out error",
            (*_describe_held_out_errors(diagnosis), *_describe_better_formula(comparison)),
        ),
        Answer("Stated values", tuple(describe_contradicted_values(diagnosis.problem, diagnosis.model))),
        Answer("Next", _describe_next_step(diagnosis, model)),
    ]
    return [answer for answer in answers if answer.sentences]


def _describe_missing(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return each mechanism with the estimates of its parameters."""
    if not diagnosis.is_detected:
        return (f"The {diagnosis.problem.law} baseline explains this recording within its noise.",)
    sentences = []
    for mechanism in diagnosis.named_mechanisms:
        estimates = order_estimates(diagnosis.parameters[mechanism.id])[:_MAX_SHOWN_ESTIMATES]
        listed = ", ".join(format_named_estimate(name, estimate) for name, estimate in estimates)
        sentences.append(f"`{mechanism.id}`: {listed}.")
    if diagnosis.unexplained:
        likeness = f", similar to {diagnosis.likenesses[0].description}" if diagnosis.likenesses else ""
        share = "Below 1 %" if diagnosis.residual_share < 0.005 else format_percent(diagnosis.residual_share)
        sentences.append(f"{share} of the misfit is unexplained{likeness}.")
        if reason := describe_unexplained_reason(diagnosis):
            sentences.append(reason)
    if diagnosis.is_faint:
        sentences.append("The misfit is far below the noise of one row, so pamjax names no mechanism.")
    return tuple(sentences)


def _describe_certainty(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return the probability of each mechanism, its rivals, and the test of the baseline."""
    test = f"global test of the baseline: {format_p_value(diagnosis.baseline_test.p_value)}"
    if not diagnosis.is_detected:
        limit = diagnosis.settings.detection_p_value
        return (
            f"{test[0].upper()}{test[1:]}.",
            f"pamjax reports a misfit only below p = {limit:g}."
            f" Noise alone is below this limit in {100 * limit:g} % of recordings.",
        )
    mechanisms = diagnosis.named_mechanisms
    sentences = [_describe_probability(mechanism, len(mechanisms) > 1) for mechanism in mechanisms]
    sentences.append(f"The misfit is beyond the noise ({test}).")
    if probability := describe_unexplained_probability(diagnosis):
        sentences.append(probability)
    return tuple(sentences)


def _describe_probability(mechanism: NamedMechanism, is_named: bool) -> str:
    name = f"`{mechanism.id}`: " if is_named else ""
    probability = format_probability(mechanism.probability)
    if not mechanism.indistinguishable:
        rivals = "no other mechanism explains this recording as well"
        return f"{name}{probability if is_named else probability.capitalize()}; {rivals}."
    rivals = join_words([f"`{rival}`" for rival in mechanism.indistinguishable])
    return f"{name}This recording cannot distinguish it from {rivals}. Any of them: {probability}."


def _describe_untested_effects(diagnosis: Diagnosis) -> tuple[str, ...]:
    effects = describe_untested_effects(diagnosis.problem)
    return (effects,) if effects else ()


def _describe_location(diagnosis: Diagnosis) -> tuple[str, ...]:
    if not diagnosis.is_detected:
        return ()
    regions = diagnosis.misfit_regions[:_MAX_SHOWN_REGIONS]
    if not regions:
        return ("The misfit has no distinct region.",)
    return tuple(
        f"{region.description.rstrip('.')} ({format_percent(region.share)} of the misfit)."
        for region in regions
    )


def _describe_held_out_errors(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return the held-out error of each channel without and with the mechanisms, with the noise."""
    errors, noise = diagnosis.held_out_errors, diagnosis.as_dict()["noise"]
    if not errors.baseline_rmse:
        independent = "no independent rows confirm this result"
        return (f"No block was held out, because the recording has too few blocks: {independent}.",)
    parts = []
    for channel, baseline_rmse in errors.baseline_rmse.items():
        unit = DISPLAY_UNIT[channel]
        change = format_number(to_display(channel, baseline_rmse), 3)
        if diagnosis.named_mechanisms:
            change += f" → {format_number(to_display(channel, errors.model_rmse[channel]), 3)}"
        parts.append(f"{channel} {change} {unit} (noise {format_number(noise[channel]['sd'], 3)} {unit})")
    sentence = f"RMS error of held-out blocks ({errors.block_description.split(':')[0]}): {'; '.join(parts)}."
    doubt = describe_unconfirmed(diagnosis)
    return (sentence, doubt) if doubt else (sentence,)


def _describe_better_formula(comparison: ModelComparison | None) -> tuple[str, ...]:
    """Return a warning if an empirical formula predicts the held-out force better."""
    rmse = comparison.better_formula_rmse if comparison else None
    if rmse is None:
        return ()
    return (f"Sárosi's formula has the smaller error, {format_number(rmse, 3)} N: interpolate with it.",)


def _describe_next_step(diagnosis: Diagnosis, model: str) -> tuple[str, ...]:
    """Return the next step, and the folder of its command if the path of the model does not show it."""
    sentences = describe_next_step(diagnosis, model)
    has_command = any("`pamjax " in sentence for sentence in sentences)
    return (*sentences, *([_REPORT_FOLDER] if has_command and model == MODEL_FILE else []))


def list_held_out_bars(diagnosis: Diagnosis, comparison: ModelComparison | None = None) -> list[HeldOutBar]:
    """Return the bars of the channels whose held-out error changes by a tenth or more.

    A better empirical formula has a bar too. Arguments as in `list_answers`.
    """
    formula_rmse = comparison.better_formula_rmse if comparison else None
    errors, noise, bars = diagnosis.held_out_errors, diagnosis.as_dict()["noise"], []
    for channel, baseline_rmse in errors.baseline_rmse.items() if diagnosis.named_mechanisms else ():
        model_rmse = errors.model_rmse[channel]
        if 0.9 < model_rmse / baseline_rmse < 1.1:
            continue
        values = {
            "baseline": to_display(channel, baseline_rmse),
            "with mechanisms": to_display(channel, model_rmse),
            **({MODEL_TITLES[SAROSI_MODEL]: formula_rmse} if channel == "force" and formula_rmse else {}),
            "noise": noise[channel]["sd"],
        }
        largest, unit = max(values.values()), DISPLAY_UNIT[channel]
        rows = tuple(
            (n, f"{format_number(value, 3)} {unit}", 100 * value / largest) for n, value in values.items()
        )
        bars.append(HeldOutBar(channel, rows))
    return bars


def format_probability(probability: float) -> str:
    """Return a probability as text.

    >>> format_probability(0.98), format_probability(1.0)
    ('probability 0.98', 'probability above 0.99')
    """
    return (
        "probability above 0.99" if probability > _MAX_SHOWN_PROBABILITY else f"probability {probability:.2f}"
    )


def format_percent(share: float) -> str:
    """Return a share as text.

    >>> format_percent(0.817)
    '82 %'
    """
    return f"{100 * share:.0f} %"

"""Text summary of a plan: runs, duration, expected precision, and simpler protocols."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pamjax.model.parameters import find_meaning
from pamjax.units import format_number, format_quantity

if TYPE_CHECKING:
    from pamjax.planning.plan import ExpectedSd, Plan
    from pamjax.planning.rig_capabilities import RigCapabilities

#: Rms residual of the recording over noise above which the summary reports a misfit.
_MIN_MISFIT_RATIO = 1.5
#: Ratio of two standard deviations below which the summary reports the first as smaller.
_LESS_SD_RATIO = 0.95


def format_plan_summary(plan: Plan) -> str:
    """Return the summary of a plan."""
    lines = [f"{plan.prior.muscle_toml.name}: {format_plan_sentence(plan)}", ""]
    lines += [
        *(f"  {n} × {run.description}" for n, run in plan.chosen_runs),
        *([""] if plan.chosen_runs else []),
    ]
    lines += [
        f"  {name:<24} {_format_expected_sd(name, expected)}" for name, expected in plan.expected_sds.items()
    ]
    capabilities = plan.prior.capabilities
    if plan.chosen_runs:
        lines += ["", *(f"  {line}" for line in format_simpler_protocols(plan))]
    error_text = ", ".join(
        f"{n} {format_quantity(sd, find_meaning(n).show, 2)}" for n, sd in capabilities.assumed_sds.items()
    )
    lines += ["", f"  rig: {_format_rig(capabilities)}; it measures {' and '.join(capabilities.channels)}"]
    lines += [f"  assumed sd of the rig's errors: {error_text}", f"  limits: {format_neglected(plan)}"]
    return "\n".join(lines)


def _format_rig(capabilities: RigCapabilities) -> str:
    """Return the limits, the speed and the sampling rate of the rig."""
    if capabilities.measures_length:
        return (
            f"up to {format_quantity(capabilities.max_pressure, 'kPa', 3)}, set forces of"
            f" {format_loads(capabilities)}, sampling rate {capabilities.rate:.3g} Hz"
        )
    limits = (
        f"up to {format_quantity(capabilities.max_pressure, 'kPa', 3)} and"
        f" {capabilities.max_contraction:.0%} contraction"
    )
    return f"{limits}, {1e3 * capabilities.speed:.3g} mm/s, sampling rate {capabilities.rate:.3g} Hz"


def format_loads(capabilities: RigCapabilities) -> str:
    """Return the set forces of an isotonic rig."""
    return ", ".join(format_number(load, 3) for load in capabilities.loads) + " N"


def format_misfit(plan: Plan) -> str:
    """Return a warning if the model does not fit the existing recording, else an empty string."""
    misfit_ratios = {
        channel: ratio for channel, ratio in plan.prior.misfit_ratios.items() if ratio > _MIN_MISFIT_RATIO
    }
    misfit_text = " and ".join(
        f"{format_number(ratio, 2)} for {channel}" for channel, ratio in misfit_ratios.items()
    )
    return (
        f"the model does not fit its recording (rms of residual over noise, row by row: {misfit_text});"
        " run `pamjax diagnose` first"
        if misfit_ratios
        else ""
    )


def format_neglected(plan: Plan) -> str:
    """Return the effects that a plan neglects."""
    independence = (
        "" if plan.prior.capabilities.correlation_time > 0 else "; samples are treated as independent"
    )
    sentence = "rubber, friction and tapered ends are neglected, and their uncertainty is not included"
    if plan.prior.capabilities.measures_length:
        sentence += "; rubber changes the contraction without a load most"
    if plan.prior.has_residual_noise:
        noise = format_quantity(plan.prior.capabilities.length_sd, "mm", 2)
        sentence += "; the noise of length is not stated, so the residual of the recording counts as noise"
        sentence += f" ({noise})"
    return sentence + independence


def format_plan_sentence(plan: Plan) -> str:
    """Return the duration and the expected precision; with a misfit, the warning first."""
    misfit = format_misfit(plan)
    return (
        f"{misfit}; if the model were correct, {_format_expected_precision(plan, 'would')}"
        if misfit
        else _format_expected_precision(plan, "will")
    )


def _format_expected_precision(plan: Plan, verb: str) -> str:
    cost = f"{format_minutes(plan.minutes)} and {plan.rows} rows"
    if plan.goal == "all":
        return f"{cost} for all parameters together"
    precision = format_precision(plan, plan.sd) if verb == "will" else format_rough_precision(plan)
    if not plan.chosen_runs and plan.reaches_goal:
        return f"no measurement is needed: {plan.goal} is already determined {precision}"
    if plan.reaches_goal:
        return f"{cost} {verb} determine {plan.goal} {precision}"
    return (
        f"no plan of {format_minutes(plan.prior.capabilities.minutes)} reaches the wanted precision of"
        f" {plan.goal}; {cost} {verb} determine it {precision}"
    )


def format_minutes(minutes: float) -> str:
    """Return minutes as text, with one decimal below 10.

    >>> format_minutes(2.53), format_minutes(18.97)
    ('2.5 min', '19 min')
    """
    return f"{minutes:.2g} min" if minutes < 9.95 else f"{minutes:.0f} min"


def format_precision(plan: Plan, sd: float) -> str:
    """Return the precision of the goal for a standard deviation, SI."""
    expected = plan.expected_sds[plan.goal]
    return f"to ± {format_quantity(sd, find_meaning(plan.goal).show, 2)} ({sd / abs(expected.value):.1%})"


def format_rough_precision(plan: Plan) -> str:
    """Return the precision of the goal to one digit, for a model that does not fit its recording."""
    share = plan.sd / abs(plan.expected_sds[plan.goal].value)
    return f"to about {float(f'{100 * share:.1g}'):g}%"


def _format_expected_sd(name: str, expected: ExpectedSd) -> str:
    unit = find_meaning(name).show
    current_text = (
        f"± {format_quantity(expected.current_sd, unit, 2)}"
        if math.isfinite(expected.current_sd)
        else "unknown"
    )
    return (
        f"{format_quantity(expected.value, unit)}, {current_text} before,"
        f" ± {format_quantity(expected.expected_sd, unit, 2)} after"
    )


def format_simpler_protocols(plan: Plan) -> list[str]:
    """Return the precision of simpler protocols; an empty list if no measurement is needed."""
    return [*format_single_channel(plan), format_usual_protocol(plan)] if plan.chosen_runs else []


def format_single_channel(plan: Plan) -> list[str]:
    """Return the precision of the best plan with each channel alone."""
    sentences = []
    for channel, (sd, minutes) in plan.single_channel.items():
        verdict = "sufficient" if sd <= plan.target_sd * (1 + 1e-9) else "not sufficient"
        sentences.append(
            f"{channel} alone determines {plan.goal} {format_precision(plan, sd)}"
            f" in {format_minutes(minutes)}: {verdict}"
        )
    return sentences


def format_usual_protocol(plan: Plan) -> str:
    """Return the precision of the usual protocol in the same time, compared with the plan."""
    capabilities = plan.prior.capabilities
    protocol, condition = "ten isobars in the same time", ", on a rig fast enough for them,"
    if capabilities.measures_length:
        protocol, condition = (
            f"pressure ramps at {format_number(capabilities.loads[0], 3)} N in the same time",
            "",
        )
    first = next(iter(plan.expected_sds))
    unit, plan_sd = find_meaning(first).show, plan.expected_sds[first].expected_sd
    sd_text, sd_ratio = f"± {format_quantity(plan.usual_sd, unit, 2)}", plan.usual_sd / plan_sd
    if sd_ratio < _LESS_SD_RATIO:
        # The isobars may have any duration; a plan has complete runs only.
        is_shortest = plan.target_sd and plan.reaches_goal
        shortest_text = "; of complete runs, this plan is the shortest found" if is_shortest else ""
        return (
            f"{protocol}{condition} would determine {first} to"
            f" {sd_text}, better than this plan (± {format_quantity(plan_sd, unit, 2)}){shortest_text}"
        )
    return f"{protocol} would determine {first} to {sd_text}, {sd_ratio:.1f} times the sd of this plan"

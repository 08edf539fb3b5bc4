"""The note of a plan: what to do, what it costs, what it will settle, and what one channel alone could."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pamjax.model.parameters import find_meaning
from pamjax.units import format_quantity

if TYPE_CHECKING:
    from pamjax.planning.bench import RigCapabilities
    from pamjax.planning.plan import ExpectedSd, Plan

#: Rms of what a recording leaves over, in noise standard deviations, from which it is said.
MIN_MISFIT_RATIO = 1.5
#: Ratio of two standard deviations below which the first is told as the less.
LESS_SD_RATIO = 0.95


def format_plan_note(plan: Plan) -> str:
    """The plan for a lab book."""
    lines = [f"{plan.prior.entry.name}: {format_plan_sentence(plan)}", ""]
    lines += [
        *(f"  {n} × {run.description}" for n, run in plan.chosen_runs),
        *([""] if plan.chosen_runs else []),
    ]
    lines += [
        f"  {name:<24} {_format_expected_sd(name, expected)}" for name, expected in plan.expected_sds.items()
    ]
    capabilities = plan.prior.capabilities
    if plan.chosen_runs:
        lines += ["", *(f"  {line}" for line in format_alternatives(plan))]
    error_text = ", ".join(
        f"{n} {format_quantity(sd, find_meaning(n).show, 2)}" for n, sd in capabilities.assumed.items()
    )
    lines += ["", f"  rig: {format_rig(capabilities)}; {' and '.join(capabilities.channels)} measured"]
    lines += [f"  taken as not better known than: {error_text}", f"  left out: {format_neglected(plan)}"]
    return "\n".join(lines)


def format_rig(capabilities: RigCapabilities) -> str:
    """How far the rig goes, and how fast."""
    limits = (
        f"up to {format_quantity(capabilities.pressure, 'kPa', 3)} and"
        f" {capabilities.contraction:.0%} contraction"
    )
    return f"{limits}, {1e3 * capabilities.speed:.3g} mm/s, {capabilities.rate:.3g} samples a second"


def format_misfit(plan: Plan) -> str:
    """That the recording at hand is not what this muscle would show; nothing where it is."""
    misfit_ratios = {
        channel: ratio for channel, ratio in plan.prior.misfit_ratios.items() if ratio > MIN_MISFIT_RATIO
    }
    misfit_text = " and ".join(f"{channel} by {ratio:.2g}" for channel, ratio in misfit_ratios.items())
    return (
        f"the muscle misses its recording ({misfit_text} times the noise), so `pamjax diagnose` first"
        if misfit_ratios
        else ""
    )


def format_neglected(plan: Plan) -> str:
    """What a plan does not reckon with."""
    independence = "" if plan.prior.capabilities.correlation_time > 0 else "; samples count as independent"
    return f"rubber, friction, tapered ends: what they would mimic is not promised away{independence}"


def format_plan_sentence(plan: Plan) -> str:
    """What to do and what it will settle; where the muscle is not its recording's, what it would."""
    misfit = format_misfit(plan)
    return (
        f"{misfit}; were it right, {_format_promise(plan, 'would')}"
        if misfit
        else _format_promise(plan, "will")
    )


def _format_promise(plan: Plan, verb: str) -> str:
    cost = f"{format_minutes(plan.minutes)} and {plan.rows} rows"
    if plan.goal == "all":
        return f"{cost} for all numbers together"
    precision = format_precision(plan, plan.sd) if verb == "will" else format_rough_precision(plan)
    if not plan.chosen_runs and plan.reaches_goal:
        return f"nothing is to be measured: {plan.goal} is known {precision}"
    if plan.reaches_goal:
        return f"{cost} {verb} tell {plan.goal} {precision}"
    return (
        f"no plan of {format_minutes(plan.prior.capabilities.minutes)} tells {plan.goal} as wanted;"
        f" {cost} {verb}, {precision}"
    )


def format_minutes(minutes: float) -> str:
    """Minutes as every line of a plan tells them: half a minute counts where there are few.

    >>> format_minutes(2.53), format_minutes(18.97)
    ('2.5 min', '19 min')
    """
    return f"{minutes:.2g} min" if minutes < 9.95 else f"{minutes:.0f} min"


def format_precision(plan: Plan, sd: float) -> str:
    """How well the goal is known at a standard deviation, SI."""
    expected = plan.expected_sds[plan.goal]
    return f"to ± {format_quantity(sd, find_meaning(plan.goal).show, 2)} ({sd / abs(expected.value):.1%})"


def format_rough_precision(plan: Plan) -> str:
    """How well the goal would be known, to one digit: what hangs on a wrong muscle has no more."""
    share = plan.sd / abs(plan.expected_sds[plan.goal].value)
    return f"to about {float(f'{100 * share:.1g}'):g}%"


def _format_expected_sd(name: str, expected: ExpectedSd) -> str:
    unit = find_meaning(name).show
    before_text = (
        f"± {format_quantity(expected.sd_before, unit, 2)}"
        if math.isfinite(expected.sd_before)
        else "unknown"
    )
    return (
        f"{format_quantity(expected.value, unit)}, {before_text} now, ±"
        f" {format_quantity(expected.sd_after, unit, 2)} after"
    )


def format_alternatives(plan: Plan) -> list[str]:
    """What less than the plan would do; nothing where nothing is to be measured."""
    return [*format_single_channel(plan), format_isobars(plan)] if plan.chosen_runs else []


def format_single_channel(plan: Plan) -> list[str]:
    """What each channel could do by itself."""
    sentences = []
    for channel, (sd, minutes) in plan.single_channel.items():
        is_enough = sd <= plan.target_sd * (1 + 1e-9)
        verdict = "is enough after" if is_enough else "is not enough, even after"
        sentences.append(f"{channel} alone {verdict} {format_minutes(minutes)}: {format_precision(plan, sd)}")
    return sentences


def format_isobars(plan: Plan) -> str:
    """What the usual protocol would leave; where that is less, that it is."""
    first = next(iter(plan.expected_sds))
    unit, plan_sd = find_meaning(first).show, plan.expected_sds[first].sd_after
    sd_text, sd_ratio = f"± {format_quantity(plan.isobars_sd, unit, 2)}", plan.isobars_sd / plan_sd
    if sd_ratio < LESS_SD_RATIO:
        # Their time is shared out evenly; a plan is made of whole runs.
        shortest = (
            ", which is the shortest found of whole runs" if plan.target_sd and plan.reaches_goal else ""
        )
        return (
            f"ten isobars in the same time, on a rig fast enough for them, would leave {first} at {sd_text},"
            f" less than the ± {format_quantity(plan_sd, unit, 2)} of this plan{shortest}"
        )
    return f"ten isobars in the same time would leave {first} at {sd_text}, {sd_ratio:.1f} times as much"

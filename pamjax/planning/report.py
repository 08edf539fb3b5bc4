"""The note of a plan: what to do, what it costs, what it will settle, and what one channel alone could."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pamjax.model.parameters import meaning
from pamjax.units import show

if TYPE_CHECKING:
    from pamjax.planning.bench import Means
    from pamjax.planning.plan import Plan, Settled

#: Rms of what a recording leaves over, in noise standard deviations, from which it is said.
MISSED = 1.5
#: Ratio of two standard deviations below which the first is told as the less.
LESS = 0.95


def note(plan: Plan) -> str:
    """The plan for a lab book."""
    lines = [f"{plan.known.entry.name}: {sentence(plan)}", ""]
    lines += [*(f"  {n} × {run.says}" for n, run in plan.chosen), *([""] if plan.chosen else [])]
    lines += [f"  {name:<24} {_settled(name, one)}" for name, one in plan.settled.items()]
    means = plan.known.means
    if plan.chosen:
        lines += ["", *(f"  {words}" for words in less_words(plan))]
    off = ", ".join(f"{n} {show(sd, meaning(n).show, 2)}" for n, sd in means.assumed.items())
    lines += ["", f"  rig: {rig_words(means)}; {' and '.join(means.channels)} measured"]
    lines += [f"  taken as not better known than: {off}", f"  left out: {left_out(plan)}"]
    return "\n".join(lines)


def rig_words(means: Means) -> str:
    """How far the rig goes, and how fast."""
    ends = f"up to {show(means.pressure, 'kPa', 3)} and {means.contraction:.0%} contraction"
    return f"{ends}, {1e3 * means.speed:.3g} mm/s, {means.rate:.3g} samples a second"


def missed_words(plan: Plan) -> str:
    """That the recording at hand is not what this muscle would show; nothing where it is."""
    far = {channel: times for channel, times in plan.known.missed.items() if times > MISSED}
    by = " and ".join(f"{channel} by {times:.2g}" for channel, times in far.items())
    return (
        f"the muscle misses its recording ({by} times the noise), so `pamjax diagnose` first" if far else ""
    )


def left_out(plan: Plan) -> str:
    """What a plan does not reckon with."""
    same = "" if plan.known.means.correlation_time > 0 else "; samples count as independent"
    return f"rubber, friction, tapered ends: what they would mimic is not promised away{same}"


def sentence(plan: Plan) -> str:
    """What to do and what it will settle; where the muscle is not its recording's, what it would."""
    missed = missed_words(plan)
    return f"{missed}; were it right, {_promise(plan, 'would')}" if missed else _promise(plan, "will")


def _promise(plan: Plan, will: str) -> str:
    cost = f"{minutes_words(plan.minutes)} and {plan.rows} rows"
    if plan.goal == "all":
        return f"{cost} for all numbers together"
    words = known_to(plan, plan.sd) if will == "will" else roughly(plan)
    if not plan.chosen and plan.reached:
        return f"nothing is to be measured: {plan.goal} is known {words}"
    if plan.reached:
        return f"{cost} {will} tell {plan.goal} {words}"
    return (
        f"no plan of {minutes_words(plan.known.means.minutes)} tells {plan.goal} as wanted;"
        f" {cost} {will}, {words}"
    )


def minutes_words(minutes: float) -> str:
    """Minutes as every line of a plan tells them: half a minute counts where there are few.

    >>> minutes_words(2.53), minutes_words(18.97)
    ('2.5 min', '19 min')
    """
    return f"{minutes:.2g} min" if minutes < 9.95 else f"{minutes:.0f} min"


def known_to(plan: Plan, sd: float) -> str:
    """How well the goal is known at a standard deviation, SI."""
    one = plan.settled[plan.goal]
    return f"to ± {show(sd, meaning(plan.goal).show, 2)} ({sd / abs(one.value):.1%})"


def roughly(plan: Plan) -> str:
    """How well the goal would be known, to one digit: what hangs on a wrong muscle has no more."""
    share = plan.sd / abs(plan.settled[plan.goal].value)
    return f"to about {float(f'{100 * share:.1g}'):g}%"


def _settled(name: str, one: Settled) -> str:
    unit = meaning(name).show
    before = f"± {show(one.before, unit, 2)}" if math.isfinite(one.before) else "unknown"
    return f"{show(one.value, unit)}, {before} now, ± {show(one.after, unit, 2)} after"


def less_words(plan: Plan) -> list[str]:
    """What less than the plan would do; nothing where nothing is to be measured."""
    return [*alone_words(plan), isobars_words(plan)] if plan.chosen else []


def alone_words(plan: Plan) -> list[str]:
    """What each channel could do by itself."""
    said = []
    for channel, (sd, minutes) in plan.alone.items():
        can = sd <= plan.wanted * (1 + 1e-9)
        after = "is enough after" if can else "is not enough, even after"
        said.append(f"{channel} alone {after} {minutes_words(minutes)}: {known_to(plan, sd)}")
    return said


def isobars_words(plan: Plan) -> str:
    """What the usual protocol would leave; where that is less, that it is."""
    first = next(iter(plan.settled))
    unit, after = meaning(first).show, plan.settled[first].after
    words, times = f"± {show(plan.isobars, unit, 2)}", plan.isobars / after
    if times < LESS:
        # Their time is shared out evenly; a plan is made of whole runs.
        shortest = ", which is the shortest found of whole runs" if plan.wanted and plan.reached else ""
        return (
            f"ten isobars in the same time, on a rig fast enough for them, would leave {first} at {words},"
            f" less than the ± {show(after, unit, 2)} of this plan{shortest}"
        )
    return f"ten isobars in the same time would leave {first} at {words}, {times:.1f} times as much"

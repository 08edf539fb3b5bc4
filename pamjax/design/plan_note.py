"""The note of a plan: what to do, what it costs, what it will settle, and what one channel alone could."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pamjax.model.catalogue import meaning
from pamjax.units import show

if TYPE_CHECKING:
    from pamjax.design.plan import Plan, Settled


def note(plan: Plan) -> str:
    """The plan for a lab book."""
    lines = [f"{plan.known.entry.name}: {_sentence(plan)}", ""]
    lines += [*(f"  {n} × {run.says}" for n, run in plan.chosen), *([""] if plan.chosen else [])]
    lines += [f"  {name:<24} {_settled(name, one)}" for name, one in plan.settled.items()]
    means = plan.known.means
    if plan.chosen:
        lines += ["", *(f"  {words}" for words in less_words(plan))]
    off = ", ".join(f"{n} {show(sd, meaning(n).show, 2)}" for n, sd in means.off.items())
    lines += ["", f"  taken as measured: {' and '.join(means.channels)}"]
    lines += [f"  taken as not better known than: {off}", f"  left out: {left_out(plan)}"]
    return "\n".join(lines)


def left_out(plan: Plan) -> str:
    """What a plan does not reckon with."""
    same = "" if plan.known.means.correlation_time > 0 else "; samples count as independent"
    return f"rubber, friction, tapered ends: what they would mimic is not promised away{same}"


def _sentence(plan: Plan) -> str:
    cost = f"{plan.minutes:.0f} min and {plan.rows} rows"
    if plan.goal == "all":
        return f"{cost} for all numbers together"
    words = known_to(plan, plan.sd)
    if not plan.chosen and plan.reached:
        return f"nothing is to be measured: {plan.goal} is known {words}"
    if plan.reached:
        return f"{cost} will tell {plan.goal} {words}"
    return f"no plan of {plan.known.means.minutes:.0f} min tells {plan.goal} as wanted; {cost} will, {words}"


def known_to(plan: Plan, sd: float) -> str:
    """How well the goal is known at a standard deviation, SI."""
    one = plan.settled[plan.goal]
    return f"to ± {show(sd, meaning(plan.goal).show, 2)} ({sd / abs(one.value):.1%})"


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
        said.append(f"{channel} alone {after} {minutes:.0f} min: {known_to(plan, sd)}")
    return said


def isobars_words(plan: Plan) -> str:
    """What the usual protocol would leave."""
    first = next(iter(plan.settled))
    words = f"± {show(plan.isobars, meaning(first).show, 2)}"
    times = plan.isobars / plan.settled[first].after
    return f"ten isobars in the same time would leave {first} at {words}, {times:.1f} times as much"

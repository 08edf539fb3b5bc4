"""A design as a lab note: the muscle, its margins, what is dear and what is doubtful, in a screenful."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pamjax.sizing.infeasible import plain
from pamjax.sizing.problem import UNITS
from pamjax.sizing.requirements import TENTH
from pamjax.units import in_unit, show

if TYPE_CHECKING:
    from pamjax.sizing.result import Design

#: Rows of the parts of a note.
DEAREST, GIVING = 3, 6
#: Room that counts as none.
TIGHT = 1e-4


def note(design: Design) -> str:
    """The note, less than 25 lines."""
    words = design.spec.words
    head = f"{design.spec.name}: {design.choice}"
    if not design.feasible:
        return "\n".join(
            [f"{design.spec.name}: no muscle of this catalogue does all of it", "", *_giving(design)]
        )
    least = f"{words.minimise} {objective(design)}, the least of {len(design.tried)} choices"
    lines = [f"{head}; {least}", "", *_muscle(design), "", *_work(design), ""]
    lines += _dear(design) + _sure(design) + _inelastic(design)
    return "\n".join(lines)


def objective(design: Design) -> str:
    """What was minimised, with its unit."""
    return show(design.objective, UNITS[design.spec.words.minimise], 4)


def _muscle(design: Design) -> list[str]:
    n, many = design.numbers, design.choice.parallel
    angle = math.degrees(n["braid_angle"])
    together = f" ({show(design.output('bundle'), 'mm')} all {many})" if many > 1 else ""
    limits = f" ({', '.join(design.limits)})" if design.limits else ""
    return [
        f"  rest length {show(n['rest_length'], 'mm')}, thread length {show(n['thread_length'], 'mm')},"
        f" {n['turns']:.4g} turns (braid angle {angle:.1f} deg)",
        f"  bladder {show(n['diameter'], 'mm')} outside, wall {show(n['wall'], 'mm', 3)}{limits}",
        f"  {show(n['pressure'], 'kPa')}, at most {show(design.output('widest'), 'mm')} wide{together},"
        f" {show(design.output('mass'), 'g', 3)}, {show(design.output('air'), 'L', 3)} of air a stroke",
    ]


def _work(design: Design) -> list[str]:
    lines = []
    for one in design.asked.requirements:
        if not one.stated or one.key in ("supply",):
            continue
        room = float(one.margins(design.outputs).min())
        lines.append(f"  {one.says:<52} {_room(room, one)}")
    return lines


def _room(room: float, one) -> str:
    return "just" if abs(room) < TIGHT else room_words(room, one)


def room_words(room: float, one) -> str:
    """Room to a requirement, as a share of it, or in its unit where it is measured from nothing."""
    spare = "to spare" if room > 0 else "short"
    if min(one.bounds) <= 0:
        return f"{plain(abs(room) * one.scale, one.unit)} {spare}"
    if room < 0 and one.sense < 0 and not one.factor:
        return f"{plain(100 * math.expm1(-room), '1')} % too much"
    share = share_of(room) if one.sense > 0 else math.exp(room)
    if share > 3:
        return f"{plain(share, '1')} times {spare}"
    return f"{plain(100 * abs(share - 1), '1')} % {spare}"


def share_of(room: float) -> float:
    """Output over lower bound at a room, see `requirements.room`: below a tenth it is its tangent."""
    return math.exp(room) if room > math.log(TENTH) else TENTH * (1 + room - math.log(TENTH))


def _dear(design: Design) -> list[str]:
    if not design.prices:
        return []
    what = design.spec.words.minimise
    parts = [f"{price.requirement.says} ({price.share:.2g} %)" for price in design.prices[:DEAREST]]
    return [f"  what buys most, {what} per 1 % given: " + "; ".join(parts)]


def _sure(design: Design) -> list[str]:
    wanted = design.spec.words.probability
    if design.unsure:
        return [f"  no choice holds with probability {wanted:g}; this one does with {design.probability:.2f}"]
    tail = f", wanted {wanted:g}" if wanted else "; state `probability` and it is sized for that"
    weak = min(design.held, key=lambda key: design.held[key])
    says = next(one.says for one in design.asked.requirements if one.key == weak)
    worst = "" if design.held[weak] > 0.995 else f"; weakest: {says}, {design.held[weak]:.2f}"
    return [f"  all of it holds with probability {design.probability:.2f} over other draws{tail}{worst}"]


def _inelastic(design: Design) -> list[str]:
    lines = []
    for cost in design.costs:
        if cost.choice is None:
            lines.append(f"    {cost.thread}: not even with threads that do not stretch")
            continue
        short = f"{show(cost.shortfall, 'N', 3)} short ({100 * cost.share:.2g} %) {cost.place}"
        wider = f"{show(cost.overrun, 'mm', 2)} ({100 * cost.wider:.2g} %) wider"
        lines.append(f"    {cost.thread:<8} {short}, {wider}")
    return ["  sized as if threads did not stretch, it would have been", *lines] if lines else []


def _giving(design: Design) -> list[str]:
    alone = [give.says for give in design.gives if give.amount is not None]
    others = [give.says for give in design.gives if give.amount is None]
    lines = [f"  nearest: {design.choice}"]
    if alone:
        lines += ["  what is in each other's way, and what would do if it alone gave:"]
        lines += [f"    {says}" for says in alone[:GIVING]]
    if others or not alone:
        lines += [f"  {not_alone(design)}{':' if others else ''}"]
        lines += [f"    {says}" for says in others[:GIVING]]
    return lines


def not_alone(design: Design) -> str:
    """That no requirement, or none but some, is enough if it alone gives."""
    if any(give.amount is not None for give in design.gives):
        return "in the way as well, and not enough alone even if given up"
    return "no one requirement, given up alone, is enough: relax several"


def slope_words(design: Design, slope: float, requirement) -> str:
    """A price as a person reads it: the objective's unit per unit of the requirement."""
    unit = UNITS[design.spec.words.minimise]
    per = 1.0 if requirement.factor else in_unit(requirement.unit)
    tail = "" if requirement.unit == "1" or requirement.factor else f"/{requirement.unit}"
    return f"{slope / in_unit(unit) * per:+.3g} {unit}{tail}"

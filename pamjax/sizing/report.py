"""A design as a lab note: the muscle, its margins, what is dear and what is doubtful, in a screenful."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pamjax.sizing.infeasible import format_amount
from pamjax.sizing.problem import OBJECTIVE_UNITS
from pamjax.sizing.requirements import MIN_LOG_RATIO
from pamjax.units import compute_si_factor, format_quantity

if TYPE_CHECKING:
    from pamjax.sizing.result import Design

#: Rows of the parts of a note.
MAX_PRICES, MAX_RELAXATIONS = 3, 6
#: Room that counts as none.
TIGHT_MARGIN = 1e-4


def format_design_note(design: Design) -> str:
    """The note, less than 25 lines."""
    entries = design.spec.entries
    head = f"{design.spec.name}: {design.choice}"
    if not design.feasible:
        return "\n".join(
            [
                f"{design.spec.name}: no muscle of this catalogue does all of it",
                "",
                *_format_relaxations(design),
            ]
        )
    objective_text = (
        f"{entries.minimise} {format_objective(design)}, the least of {len(design.results)} choices"
    )
    lines = [f"{head}; {objective_text}", "", *_format_muscle(design), "", *_format_requirements(design), ""]
    lines += _format_prices(design) + _format_probability(design) + _format_inelastic_costs(design)
    return "\n".join(lines)


def format_objective(design: Design) -> str:
    """What was minimised, with its unit."""
    return format_quantity(design.objective, OBJECTIVE_UNITS[design.spec.entries.minimise], 4)


def _format_muscle(design: Design) -> list[str]:
    n, muscle_count = design.numbers, design.choice.parallel
    angle = math.degrees(n["braid_angle"])
    bundle = (
        f" ({format_quantity(design.output('bundle'), 'mm')} all {muscle_count})" if muscle_count > 1 else ""
    )
    limits = f" ({', '.join(design.active_limits)})" if design.active_limits else ""
    return [
        f"  rest length {format_quantity(n['rest_length'], 'mm')}, thread length"
        f" {format_quantity(n['thread_length'], 'mm')},"
        f" {n['turns']:.4g} turns (braid angle {angle:.1f} deg)",
        f"  bladder {format_quantity(n['diameter'], 'mm')} outside, wall"
        f" {format_quantity(n['wall'], 'mm', 3)}{limits}",
        f"  {format_quantity(n['pressure'], 'kPa')}, at most"
        f" {format_quantity(design.output('widest'), 'mm')} wide{bundle},"
        f" {format_quantity(design.output('mass'), 'g', 3)},"
        f" {format_quantity(design.output('air'), 'L', 3)} of air a stroke",
    ]


def _format_requirements(design: Design) -> list[str]:
    lines = []
    for requirement in design.task.requirements:
        if not requirement.stated or requirement.key in ("supply",):
            continue
        margin = float(requirement.compute_margins(design.outputs).min())
        lines.append(f"  {requirement.description:<52} {_format_tight_margin(margin, requirement)}")
    return lines


def _format_tight_margin(margin: float, requirement) -> str:
    return "just" if abs(margin) < TIGHT_MARGIN else format_margin(margin, requirement)


def format_margin(margin: float, requirement) -> str:
    """Room to a requirement, as a share of it, or in its unit where it is measured from nothing."""
    tail = "to spare" if margin > 0 else "short"
    if min(requirement.bounds) <= 0:
        return f"{format_amount(abs(margin) * requirement.scale, requirement.unit)} {tail}"
    if margin < 0 and requirement.sense < 0 and not requirement.is_safety_factor:
        return f"{format_amount(100 * math.expm1(-margin), '1')} % too much"
    ratio = compute_output_ratio(margin) if requirement.sense > 0 else math.exp(margin)
    if ratio > 3:
        return f"{format_amount(ratio, '1')} times {tail}"
    return f"{format_amount(100 * abs(ratio - 1), '1')} % {tail}"


def compute_output_ratio(margin: float) -> float:
    """Output over lower bound at a room, see `requirements.compute_margin`: below a tenth it is its
    tangent.
    """
    return (
        math.exp(margin)
        if margin > math.log(MIN_LOG_RATIO)
        else MIN_LOG_RATIO * (1 + margin - math.log(MIN_LOG_RATIO))
    )


def _format_prices(design: Design) -> list[str]:
    if not design.prices:
        return []
    objective = design.spec.entries.minimise
    parts = [
        f"{price.requirement.description} ({price.percent_saved:.2g} %)"
        for price in design.prices[:MAX_PRICES]
    ]
    return [f"  what buys most, {objective} per 1 % given: " + "; ".join(parts)]


def _format_probability(design: Design) -> list[str]:
    target = design.spec.entries.probability
    if design.misses_probability:
        return [f"  no choice holds with probability {target:g}; this one does with {design.probability:.2f}"]
    tail = f", wanted {target:g}" if target else "; state `probability` and it is sized for that"
    weakest_key = min(design.requirement_probabilities, key=lambda key: design.requirement_probabilities[key])
    description = next(
        requirement.description for requirement in design.task.requirements if requirement.key == weakest_key
    )
    weakest = (
        ""
        if design.requirement_probabilities[weakest_key] > 0.995
        else f"; weakest: {description}, {design.requirement_probabilities[weakest_key]:.2f}"
    )
    return [f"  all of it holds with probability {design.probability:.2f} over other draws{tail}{weakest}"]


def _format_inelastic_costs(design: Design) -> list[str]:
    lines = []
    for cost in design.inelastic_costs:
        if cost.choice is None:
            lines.append(f"    {cost.thread}: not even with threads that do not stretch")
            continue
        shortfall = f"{format_quantity(cost.shortfall, 'N', 3)} short ({100 * cost.share:.2g} %) {cost.place}"
        wider = f"{format_quantity(cost.overrun, 'mm', 2)} ({100 * cost.wider:.2g} %) wider"
        lines.append(f"    {cost.thread:<8} {shortfall}, {wider}")
    return ["  sized as if threads did not stretch, it would have been", *lines] if lines else []


def _format_relaxations(design: Design) -> list[str]:
    sufficient = [
        relaxation.description for relaxation in design.relaxations if relaxation.relaxed_bound is not None
    ]
    insufficient = [
        relaxation.description for relaxation in design.relaxations if relaxation.relaxed_bound is None
    ]
    lines = [f"  nearest: {design.choice}"]
    if sufficient:
        lines += ["  what is in each other's way, and what would do if it alone gave:"]
        lines += [f"    {description}" for description in sufficient[:MAX_RELAXATIONS]]
    if insufficient or not sufficient:
        lines += [f"  {format_joint_conflict(design)}{':' if insufficient else ''}"]
        lines += [f"    {description}" for description in insufficient[:MAX_RELAXATIONS]]
    return lines


def format_joint_conflict(design: Design) -> str:
    """That no requirement, or none but some, is enough if it alone gives."""
    if any(relaxation.relaxed_bound is not None for relaxation in design.relaxations):
        return "in the way as well, and not enough alone even if given up"
    return "no one requirement, given up alone, is enough: relax several"


def format_slope(design: Design, slope: float, requirement) -> str:
    """A price as a person reads it: the objective's unit per unit of the requirement."""
    unit = OBJECTIVE_UNITS[design.spec.entries.minimise]
    per = 1.0 if requirement.is_safety_factor else compute_si_factor(requirement.unit)
    tail = "" if requirement.unit == "1" or requirement.is_safety_factor else f"/{requirement.unit}"
    return f"{slope / compute_si_factor(unit) * per:+.3g} {unit}{tail}"

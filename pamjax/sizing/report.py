"""Text report of a design: the muscle, its margins, sensitivities and probabilities, in one screen."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pamjax.sizing.infeasible import format_amount
from pamjax.sizing.problem import OBJECTIVE_UNITS
from pamjax.sizing.requirements import MIN_LOG_RATIO
from pamjax.units import compute_si_factor, format_quantity

if TYPE_CHECKING:
    from pamjax.sizing.result import Design

#: Maximum number of listed sensitivities and of listed relaxations.
MAX_PRICES, MAX_RELAXATIONS = 3, 6
#: Margin below which a requirement counts as exactly met.
TIGHT_MARGIN = 1e-4


def format_design_note(design: Design) -> str:
    """Return the report as text with fewer than 25 lines."""
    entries = design.spec.entries
    head = f"{design.spec.name}: {design.choice}"
    if not design.feasible:
        return "\n".join(
            [
                f"{design.spec.name}: no muscle of this catalogue meets all requirements",
                "",
                *_format_relaxations(design),
            ]
        )
    objective_text = f"{entries.minimise} {format_objective(design)}, lowest of {len(design.results)} choices"
    lines = [f"{head}; {objective_text}", "", *_format_muscle(design), "", *_format_requirements(design), ""]
    lines += _format_prices(design) + _format_probability(design) + _format_inelastic_costs(design)
    return "\n".join(lines)


def format_objective(design: Design) -> str:
    """Return the minimised quantity with its unit."""
    return format_quantity(design.objective, OBJECTIVE_UNITS[design.spec.entries.minimise], 4)


def _format_muscle(design: Design) -> list[str]:
    n, muscle_count = design.numbers, design.choice.parallel
    angle = math.degrees(n["braid_angle"])
    bundle = (
        f" (bundle of {muscle_count}: {format_quantity(design.output('bundle'), 'mm')})"
        if muscle_count > 1
        else ""
    )
    limits = f" ({', '.join(design.active_limits)})" if design.active_limits else ""
    return [
        f"  rest length {format_quantity(n['rest_length'], 'mm')}, thread length"
        f" {format_quantity(n['thread_length'], 'mm')},"
        f" {n['turns']:.4g} turns (braid angle {angle:.1f} deg)",
        f"  bladder: outer diameter {format_quantity(n['diameter'], 'mm')}, wall"
        f" {format_quantity(n['wall'], 'mm', 3)}{limits}",
        f"  working pressure {format_quantity(n['pressure'], 'kPa')}, largest diameter"
        f" {format_quantity(design.output('widest'), 'mm')}{bundle},"
        f" mass {format_quantity(design.output('mass'), 'g', 3)},"
        f" air per stroke {format_quantity(design.output('air'), 'L', 3)}",
    ]


def _format_requirements(design: Design) -> list[str]:
    lines = []
    for requirement in design.task.requirements:
        if not requirement.stated or requirement.key in ("supply",):
            continue
        margin = float(requirement.compute_margins(design.outputs).min())
        lines.append(f"  {requirement.description:<54} {_format_tight_margin(margin, requirement)}")
    return lines


def _format_tight_margin(margin: float, requirement) -> str:
    return "exactly met" if abs(margin) < TIGHT_MARGIN else format_margin(margin, requirement)


def format_margin(margin: float, requirement) -> str:
    """Return the margin to a requirement as text: relative to its bound, or absolute if the bound is 0."""
    if min(requirement.bounds) <= 0:
        amount = format_amount(abs(margin) * requirement.scale, requirement.unit)
    elif margin < 0 and requirement.sense < 0 and not requirement.is_safety_factor:
        return f"{format_amount(100 * math.expm1(-margin), '1')} % too high"
    else:
        ratio = compute_output_ratio(margin) if requirement.sense > 0 else math.exp(margin)
        if ratio > 3:
            return f"margin factor {format_amount(ratio, '1')}"
        amount = f"{format_amount(100 * abs(ratio - 1), '1')} %"
    return f"margin {amount}" if margin > 0 else f"{amount} too low"


def compute_output_ratio(margin: float) -> float:
    """Return output / lower bound at a margin: the inverse of `requirements.compute_margin`.

    It is linear for ratios below a tenth.
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
    return [f"  reduction of {objective} if one requirement is relaxed by 1 %: " + "; ".join(parts)]


def _format_probability(design: Design) -> list[str]:
    target = design.spec.entries.probability
    if design.misses_probability:
        return [
            f"  no choice reaches the required probability {target:g}; this one reaches"
            f" {design.probability:.2f}"
        ]
    advice = "" if target else "; set `probability` in the spec to require a value"
    required_text = f", required: {target:g}" if target else ""
    weakest_key = min(design.requirement_probabilities, key=lambda key: design.requirement_probabilities[key])
    description = next(
        requirement.description for requirement in design.task.requirements if requirement.key == weakest_key
    )
    weakest = (
        ""
        if design.requirement_probabilities[weakest_key] > 0.995
        else f"; least probable: {description} ({design.requirement_probabilities[weakest_key]:.2f})"
    )
    return [
        f"  all requirements hold with probability {design.probability:.2f}"
        f" (independent draws{required_text}){weakest}{advice}"
    ]


def _format_inelastic_costs(design: Design) -> list[str]:
    lines = []
    for cost in design.inelastic_costs:
        if cost.choice is None:
            lines.append(f"    {cost.thread}: no solution, even with inelastic threads")
            continue
        force_error = (
            f"force {format_quantity(cost.shortfall, 'N', 3)} ({100 * cost.share:.2g} %) too low {cost.place}"
        )
        diameter_error = (
            f"diameter {format_quantity(cost.overrun, 'mm', 2)} ({100 * cost.wider:.2g} %) too large"
        )
        lines.append(f"    {cost.thread:<8} {force_error}, {diameter_error}")
    return ["  errors of a design that assumes inelastic threads:", *lines] if lines else []


def _format_relaxations(design: Design) -> list[str]:
    sufficient = [
        relaxation.description for relaxation in design.relaxations if relaxation.relaxed_bound is not None
    ]
    insufficient = [
        relaxation.description for relaxation in design.relaxations if relaxation.relaxed_bound is None
    ]
    lines = [f"  nearest choice: {design.choice}"]
    if sufficient:
        lines += ["  conflicting requirements, of which relaxing one is sufficient:"]
        lines += [f"    {description}" for description in sufficient[:MAX_RELAXATIONS]]
    if insufficient or not sufficient:
        lines += [f"  {format_joint_conflict(design)}{':' if insufficient else ''}"]
        lines += [f"    {description}" for description in insufficient[:MAX_RELAXATIONS]]
    return lines


def format_joint_conflict(design: Design) -> str:
    """Return the sentence on the requirements that are not sufficient if they alone are removed."""
    if any(relaxation.relaxed_bound is not None for relaxation in design.relaxations):
        return "also in conflict, but removing one of these alone is not sufficient"
    return "removing one requirement alone is not sufficient: relax several"


def format_slope(design: Design, slope: float, requirement) -> str:
    """Return a slope as text, in the objective's unit per unit of the requirement."""
    unit = OBJECTIVE_UNITS[design.spec.entries.minimise]
    per = 1.0 if requirement.is_safety_factor else compute_si_factor(requirement.unit)
    tail = "" if requirement.unit == "1" or requirement.is_safety_factor else f"/{requirement.unit}"
    return f"{slope / compute_si_factor(unit) * per:+.3g} {unit}{tail}"

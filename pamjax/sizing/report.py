"""Text report of a design: the muscle, its margins, sensitivities and probabilities, in one screen."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pamjax.sizing.infeasible import format_amount
from pamjax.sizing.problem import OBJECTIVE_UNITS
from pamjax.sizing.requirements import MIN_LOG_RATIO
from pamjax.sizing.shopping import list_parts
from pamjax.units import compute_si_factor, format_quantity

if TYPE_CHECKING:
    from pamjax.sizing.requirements import Requirement
    from pamjax.sizing.result import Design

#: Maximum number of listed sensitivities and of listed relaxations.
_MAX_SENSITIVITIES, _MAX_RELAXATIONS = 3, 6
#: Probability above which a requirement of pamjax is not listed.
_CERTAIN = 0.995
#: Margin below which a requirement counts as exactly met.
_TIGHT_MARGIN = 1e-4


def format_design_summary(design: Design) -> str:
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
    objective_text = f"{entries.minimise} {format_objective(design)}, lowest of {design.choice_count} choices"
    lines = [f"{head}; {objective_text}", "", *_format_muscle(design), "", *_format_requirements(design), ""]
    lines += [f"  {sentence}" for sentence in format_probability(design)]
    lines += (
        _format_requirement_sensitivities(design) + _format_inelastic_errors(design) + _format_parts(design)
    )
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
        probability = design.requirement_probabilities.get(requirement.key, 1.0)
        is_listed = requirement.stated and requirement.key != "supply"
        if not is_listed and probability > _CERTAIN:
            continue
        margin_text = format_requirement_margin(design, requirement)
        value = format_probability_value(probability)
        lines.append(f"  {requirement.description:<54} {margin_text}, probability {value}")
    return lines


def format_requirement_margin(design: Design, requirement: Requirement) -> str:
    """Return the smallest margin of a requirement as text; of a free contraction in % contraction."""
    margin = float(requirement.compute_margins(design.outputs).min())
    if abs(margin) < _TIGHT_MARGIN:
        return "exactly met"
    stated = design.spec.entries.free_contraction
    if requirement.key == "free contraction" and stated is not None and margin > 0:
        return f"margin {100 * (design.free_contraction - stated):.2g} % contraction"
    return format_margin(margin, requirement)


def format_probability_value(probability: float) -> str:
    """Return a probability with two digits, rounded down: a required value that is missed stays missed.

    >>> format_probability_value(0.8999), format_probability_value(0.9)
    ('0.89', '0.90')
    """
    return f"{math.floor(100 * probability + 1e-9) / 100:.2f}"


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


def _format_requirement_sensitivities(design: Design) -> list[str]:
    if not design.requirement_sensitivities:
        return []
    objective = design.spec.entries.minimise
    parts = [
        f"{sensitivity.requirement.description} ({sensitivity.percent_saved:.2g} %)"
        for sensitivity in design.requirement_sensitivities[:_MAX_SENSITIVITIES]
    ]
    return [f"  reduction of {objective} if one requirement is relaxed by 1 %: " + "; ".join(parts)]


def format_probability(design: Design) -> list[str]:
    """Return the sentences on the probability of the design and on what it costs."""
    target, reached = design.spec.entries.probability, format_probability_value(design.probability)
    if not target:
        first = (
            f"all requirements hold together with probability {reached}: `probability = 0` gives no margin"
        )
        return [first, *_format_cost(design)]
    if design.misses_probability:
        limit, limit_probability = _find_weakest(design)
        # The draws that select a choice are others than those of its reported probability.
        other_reaches = any(finalist.reaches(target) for finalist in design.finalists)
        subject = "the chosen muscle does not reach" if other_reaches else "no choice reaches"
        return [
            f"{subject} the probability {target:g}: this one reaches {reached};"
            f" the limit is “{limit}” ({format_probability_value(limit_probability)})",
            *_format_cost(design),
        ]
    return [
        f"all requirements hold together with probability {reached} ({target:g} required)",
        *_format_cost(design),
    ]


def _find_weakest(design: Design) -> tuple[str, float]:
    """Return the requirement with the smallest probability, as text, and its probability."""
    weakest_key = min(design.requirement_probabilities, key=lambda key: design.requirement_probabilities[key])
    description = next(
        requirement.description for requirement in design.task.requirements if requirement.key == weakest_key
    )
    return description, design.requirement_probabilities[weakest_key]


def _format_cost(design: Design) -> list[str]:
    """Return the sentence that compares the objective with that of the nominal design."""
    if design.nominal is None or design.nominal.optimum is None:
        return []
    name = design.spec.entries.minimise
    unit = OBJECTIVE_UNITS[name]
    nominal = math.exp(design.nominal.optimum.log_objective)
    steps = [(nominal, "for the nominal design (typical properties, any size)")]
    if design.nominal_stock is not None and design.nominal_stock.optimum is not None:
        sold = math.exp(design.nominal_stock.optimum.log_objective)
        steps.append((sold, f"with parts that are sold ({_format_change(sold, nominal)})"))
    if design.spec.entries.probability:
        last = steps[-1][0]
        steps.append((design.objective, f"with this probability ({_format_change(design.objective, last)})"))
    if len(steps) == 1:
        return []
    texts = [f"{format_quantity(value, unit, 4)} {text}" for value, text in steps]
    return [f"{name}: {', '.join(texts)}"]


def _format_change(value: float, reference: float) -> str:
    change = 100 * (value / reference - 1)
    return "no change" if abs(change) < 0.05 else f"{change:+.2g} %"


def _format_inelastic_errors(design: Design) -> list[str]:
    parts = []
    for error in design.inelastic_errors:
        if error.choice is None:
            parts.append(f"{error.thread} no solution")
            continue
        share, missing_force = 100 * error.missing_force_share, format_quantity(error.missing_force, "N", 2)
        diameter = f"diameter {100 * error.excess_diameter_share:.2g} % too large"
        parts.append(f"{error.thread} force {missing_force} ({share:.2g} %) too low, {diameter}")
    return ["  error of inelastic threads: " + "; ".join(parts)] if parts else []


def _format_parts(design: Design) -> list[str]:
    return [f"  to buy: {part.quantity} {part.name}" for part in list_parts(design)]


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
        lines += [f"    {description}" for description in sufficient[:_MAX_RELAXATIONS]]
    if insufficient or not sufficient:
        lines += [f"  {format_joint_conflict(design)}{':' if insufficient else ''}"]
        lines += [f"    {description}" for description in insufficient[:_MAX_RELAXATIONS]]
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

"""Report of a sizing: one offline HTML file, the muscle and its chart first, its sources at the end."""

from __future__ import annotations

import hashlib
import math
from functools import partial
from pathlib import Path

from pamjax.sizing.problem import OBJECTIVE_UNITS
from pamjax.sizing.report import (
    TIGHT_MARGIN,
    format_joint_conflict,
    format_margin,
    format_objective,
    format_slope,
)
from pamjax.sizing.result import Design
from pamjax.units import format_quantity
from pamjax.view.figures import sizing as figures
from pamjax.view.reports.page import build_picture, write_page
from pamjax.view.reports.sizing_receipt import build_page_receipt
from pamjax.view.wording import capitalise_sentence

#: Rows of the table of choices.
MAX_CHOICE_ROWS = 8


def write_design_report(design: Design, path: str | Path, command: str = "") -> Path:
    """Write the report of a design.

    Args:
        design: the design.
        path: the HTML file; its folder must exist.
        command: shell command that repeats the sizing.
    """
    return write_page(
        path,
        "design.html.jinja",
        title=format_headline(design),
        kicker=f"Sizing of {design.spec.name} · least {design.spec.entries.minimise}",
        answer=format_answer(design),
        feasible=design.feasible,
        chart=build_picture(partial(figures.plot_chart, design), "chart"),
        prices=build_picture(partial(figures.plot_prices, design), "prices"),
        front=build_picture(partial(figures.plot_front, design), "front"),
        front_words=_format_front(design),
        muscle=_list_muscle_rows(design),
        margins_caption=_format_margins_caption(design),
        margins_head=[
            "requirement",
            "room",
            *(["probability"] if design.requirement_probabilities else []),
            "asked by",
        ],
        margins=[_build_margin_row(design, item) for item in design.task.requirements],
        gives=[
            relaxation.description
            for relaxation in design.relaxations
            if relaxation.relaxed_bound is not None
        ],
        not_alone=f"{capitalise_sentence(format_joint_conflict(design))}:",
        lacks=[
            relaxation.description for relaxation in design.relaxations if relaxation.relaxed_bound is None
        ],
        slopes=[_build_price_row(design, price) for price in design.prices],
        costs=[_build_cost_row(cost, design) for cost in design.inelastic_costs],
        runners_caption=_format_choices_caption(design),
        runners=[_build_choice_row(item, design) for item in design.results[:MAX_CHOICE_ROWS]],
        receipt=build_page_receipt(design),
        spec=design.spec.text,
        checksum=hashlib.sha256(design.spec.text.encode()).hexdigest() if design.spec.text else "",
        command=command or "pamjax.size(...)",
    )


def format_headline(design: Design) -> str:
    """Return the finding in one line."""
    if not design.feasible:
        return "No muscle of this catalogue does all of it"
    choice = str(design.choice)
    under = " under pressure" if design.spec.entries.minimise == "diameter" else ""
    return f"{capitalise_sentence(choice)}: {design.spec.entries.minimise} {format_objective(design)}{under}"


def format_answer(design: Design) -> list[str]:
    """Return the dimensions of the muscle and the probability that it meets the spec."""
    if not design.feasible:
        sufficient = [
            relaxation.description
            for relaxation in design.relaxations
            if relaxation.relaxed_bound is not None
        ][:3]
        return [
            f"The nearest choice is {design.choice}.",
            f"Any one of these would do: {'; '.join(sufficient)}."
            if sufficient
            else f"No one requirement, given up alone, is enough. {figures.format_shortfall_title(design)}.",
        ]
    n = design.numbers
    first_sentence = (
        f"At rest {format_quantity(n['rest_length'], 'mm')} long, threads of"
        f" {format_quantity(n['thread_length'], 'mm')} in"
        f" {n['turns']:.3g} turns ({math.degrees(n['braid_angle']):.1f}° from the circumference) over a"
        f" bladder of {format_quantity(n['diameter'], 'mm')} outside and"
        f" {format_quantity(n['wall'], 'mm', 3)} wall; at"
        f" {format_quantity(n['pressure'], 'kPa')} it widens to"
        f" {format_quantity(design.output('widest'), 'mm')} at most."
    )
    target = design.spec.entries.probability
    probability_text = f"{design.probability:.2f}"
    if design.misses_probability:
        certainty = (
            f"No choice holds with the probability of {target:g} that is wanted; this does with"
            f" {probability_text}."
        )
    else:
        certainty = (
            f"Everything holds together with probability {probability_text} over other draws of"
            f" all that is not known"
        )
        no_target_text = (
            "; none was wanted, so it sits on its bounds: `probability = 0.9` in the spec buys room."
        )
        certainty += f", where {target:g} is wanted." if target else no_target_text
    return [first_sentence, certainty]


def _format_front(design: Design) -> str:
    if design.front is None:
        return ""
    if len(design.front.values) < 2:
        return f"The least {design.front.first} is also the least {design.front.second}."
    return ""


def _list_muscle_rows(design: Design) -> list[list[str]]:
    n, choice = design.numbers, design.choice
    rows = [
        ["rest length", format_quantity(n["rest_length"], "mm"), "between the fittings"],
        ["thread length", format_quantity(n["thread_length"], "mm"), "of one unloaded thread"],
        ["turns", f"{n['turns']:.4g}", "of one thread"],
        ["braid angle", f"{math.degrees(n['braid_angle']):.2f} deg", "from the circumference, at rest"],
        ["threads", f"{choice.threads} of {format_quantity(choice.diameter, 'mm')}", choice.thread.about],
        ["bladder outside", format_quantity(n["diameter"], "mm"), f"at rest; {choice.bladder.about}"],
        ["wall", format_quantity(n["wall"], "mm", 3), "of the unstretched bladder"],
        [
            "working pressure",
            format_quantity(n["pressure"], "kPa"),
            f"supply {format_quantity(design.spec.supply, 'kPa')}",
        ],
        ["muscles in parallel", str(choice.parallel), ""],
        ["widest", format_quantity(design.output("widest"), "mm"), "outside of one, under pressure"],
        [
            "mass",
            format_quantity(design.output("mass"), "g", 3),
            "threads and rubber of all, without fittings",
        ],
        ["air", format_quantity(design.output("air"), "L", 3), "a stroke of all, at ambient pressure"],
    ]
    if any(kind.price for kind in (choice.thread, choice.bladder)):
        rows.append(["material", f"{design.output('cost'):.3g}", "in the currency of the spec's prices"])
    return rows


def _build_margin_row(design: Design, requirement) -> list[str]:
    margin = float(requirement.compute_margins(design.outputs).min())
    probability = design.requirement_probabilities.get(requirement.key)
    margin_text = "binds" if abs(margin) < TIGHT_MARGIN else format_margin(margin, requirement)
    probability_cell = [] if probability is None else [f"{probability:.2f}"]
    return [
        requirement.description,
        margin_text,
        *probability_cell,
        "the spec" if requirement.stated else "pamjax",
    ]


def _format_margins_caption(design: Design) -> str:
    """Return the caption of the table of requirements."""
    if not design.requirement_probabilities:
        return "Room that the nearest muscle has to each requirement"
    return "Room to each requirement, and the probability that it holds over what is not known"


def _build_price_row(design: Design, price) -> list[str]:
    requirement = price.requirement
    return [
        requirement.description,
        f"{price.percent_saved:.3g} %",
        format_slope(design, price.slope, requirement),
    ]


def _build_cost_row(cost, design: Design) -> list[str]:
    if cost.choice is None:
        return [cost.thread, "cannot meet the spec", "", "", "", ""]
    unit = OBJECTIVE_UNITS[design.spec.entries.minimise]
    elastic_text = "cannot meet the spec" if cost.elastic is None else format_quantity(cost.elastic, unit)
    return [
        cost.thread,
        f"{format_quantity(cost.shortfall, 'N', 3)} ({100 * cost.share:.2g} %)",
        f"{format_quantity(cost.overrun, 'mm', 2)} ({100 * cost.wider:.2g} %)",
        f"{100 * cost.strain:.2g} %",
        format_quantity(cost.inelastic, unit),
        elastic_text,
    ]


def _format_choices_caption(design: Design) -> str:
    """Return the caption of the table of choices."""
    shown_value = (
        f"the least {design.spec.entries.minimise} of each" if design.feasible else "how far each is short"
    )
    head = f"The best choices of the catalogue, all properties at their typical values: {shown_value}"
    target = design.spec.entries.probability
    if not design.feasible or not target or design.misses_probability:
        return head
    return (
        f"{head}. To hold with probability {target:g} a muscle takes more: of those that do, the chosen one"
        f" has the least, {format_objective(design)}"
    )


def _build_choice_row(result, design: Design) -> list[str]:
    unit = OBJECTIVE_UNITS[design.spec.entries.minimise]
    is_chosen = result.problem.choice == design.choice
    mark = ("chosen" if design.feasible else "nearest") if is_chosen else ""
    if result.optimum is None:
        return [str(result.problem.choice), f"short by {100 * (1 - math.exp(-result.violation)):.2g} %", mark]
    return [str(result.problem.choice), format_quantity(math.exp(result.optimum.log_objective), unit), mark]

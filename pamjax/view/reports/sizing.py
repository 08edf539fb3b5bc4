"""Report of a sizing: one offline HTML file with the muscle and its chart first, and its sources last."""

from __future__ import annotations

import hashlib
import math
from functools import partial
from pathlib import Path

from pamjax.sizing.problem import OBJECTIVE_UNITS
from pamjax.sizing.report import (
    format_joint_conflict,
    format_objective,
    format_probability,
    format_probability_value,
    format_requirement_margin,
    format_slope,
)
from pamjax.sizing.result import Design
from pamjax.sizing.shopping import format_sleeve, list_checks, list_parts
from pamjax.units import format_quantity
from pamjax.view.figures import sizing as figures
from pamjax.view.reports.page import build_picture, write_page
from pamjax.view.reports.sizing_receipt import build_page_receipt
from pamjax.view.wording import capitalise_sentence

#: Largest number of rows in the table of choices.
_MAX_CHOICE_ROWS = 8


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
        kicker=f"Sizing of {design.spec.name} · minimum {design.spec.entries.minimise}",
        objective=design.spec.entries.minimise,
        answer=format_answer(design),
        feasible=design.feasible,
        chart=build_picture(partial(figures.plot_chart, design), "chart"),
        sensitivities=build_picture(partial(figures.plot_sensitivities, design), "sensitivities"),
        front=build_picture(partial(figures.plot_front, design), "front"),
        front_sentence=_format_front(design),
        muscle=_list_muscle_rows(design),
        margins_caption=_format_margins_caption(design),
        margins_head=[
            "requirement",
            "margin",
            *(["probability"] if design.requirement_probabilities else []),
            "source",
        ],
        margins=[_build_margin_row(design, item) for item in design.task.requirements],
        sufficient_relaxations=[
            relaxation.description
            for relaxation in design.relaxations
            if relaxation.relaxed_bound is not None
        ],
        joint_conflict=f"{capitalise_sentence(format_joint_conflict(design))}.",
        insufficient_relaxations=[
            relaxation.description for relaxation in design.relaxations if relaxation.relaxed_bound is None
        ],
        slopes=[
            _build_sensitivity_row(design, sensitivity) for sensitivity in design.requirement_sensitivities
        ],
        inelastic_errors=[_build_error_row(error, design) for error in design.inelastic_errors],
        choices_caption=_format_choices_caption(design),
        choices_head=["choice", f"minimum {design.spec.entries.minimise}", "probability", "status"]
        if design.feasible
        else ["choice", "at typical properties", "status"],
        choices=_build_choice_rows(design),
        parts=[[part.name, part.quantity, part.remark] for part in list_parts(design)]
        if design.feasible
        else [],
        checks=list_checks(design) if design.feasible else [],
        sleeve=format_sleeve(design) if design.feasible else "",
        receipt=build_page_receipt(design),
        spec=design.spec.text,
        checksum=hashlib.sha256(design.spec.text.encode()).hexdigest() if design.spec.text else "",
        command=command or "pamjax.size(...)",
    )


def format_headline(design: Design) -> str:
    """Return the result in one line."""
    if not design.feasible:
        return "No muscle of this catalogue meets all requirements"
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
            f"Relaxing one of these requirements is sufficient: {'; '.join(sufficient)}."
            if sufficient
            else f"{capitalise_sentence(format_joint_conflict(design))}."
            f" {figures.format_shortfall_title(design)}.",
        ]
    dimensions, angle = design.numbers, math.degrees(design.numbers["braid_angle"])
    lengths = {name: format_quantity(dimensions[name], "mm") for name in ("rest_length", "thread_length")}
    sentences = [
        f"The rest length is {lengths['rest_length']}.",
        f"Each thread has a length of {lengths['thread_length']} and {dimensions['turns']:.3g} turns"
        f" (braid angle {angle:.1f}° from the circumference).",
        f"The bladder has an outer diameter of {format_quantity(dimensions['diameter'], 'mm')}"
        f" and a wall of {format_quantity(dimensions['wall'], 'mm', 3)}.",
        f"At {format_quantity(dimensions['pressure'], 'kPa')} the largest outer diameter is"
        f" {format_quantity(design.output('widest'), 'mm')}.",
    ]
    texts = [" ".join(sentences), *(f"{capitalise_sentence(text)}." for text in format_probability(design))]
    if design.misses_stock:
        texts.append("No tube of the table fits, so the bladder must be made to these dimensions.")
    return texts


def _format_front(design: Design) -> str:
    if design.front is None:
        return ""
    if len(design.front.values) < 2:
        return f"The muscle of minimum {design.front.first} also has the minimum {design.front.second}."
    return ""


def _list_muscle_rows(design: Design) -> list[list[str]]:
    dimensions, choice = design.numbers, design.choice
    rows = [
        ["rest length", format_quantity(dimensions["rest_length"], "mm"), "between the fittings"],
        ["thread length", format_quantity(dimensions["thread_length"], "mm"), "of one unloaded thread"],
        ["turns", f"{dimensions['turns']:.4g}", "of one thread"],
        [
            "braid angle",
            f"{math.degrees(dimensions['braid_angle']):.2f} deg",
            "from the circumference, at rest",
        ],
        ["threads", f"{choice.threads} of {choice.describe_thread()}", choice.thread.about],
        [
            "bladder outer diameter",
            format_quantity(dimensions["diameter"], "mm"),
            f"at rest; {choice.bladder.about}",
        ],
        [
            "bladder wall",
            format_quantity(dimensions["wall"], "mm", 3),
            f"unstretched; {choice.describe_bladder()}",
        ],
        [
            "working pressure",
            format_quantity(dimensions["pressure"], "kPa"),
            f"supply pressure {format_quantity(design.spec.supply, 'kPa')}",
        ],
        ["muscles in parallel", str(choice.parallel), ""],
        [
            "largest diameter",
            format_quantity(design.output("widest"), "mm"),
            "outer, of one muscle, under pressure",
        ],
        [
            "mass",
            format_quantity(design.output("mass"), "g", 3),
            "threads and rubber of all muscles, without fittings",
        ],
        [
            "air",
            format_quantity(design.output("air"), "L", 3),
            "per stroke of all muscles, at ambient pressure",
        ],
    ]
    if any(kind.price for kind in (choice.thread, choice.bladder)):
        rows.append(["material cost", f"{design.output('cost'):.3g}", "in the currency of the spec's prices"])
    return rows


def _build_margin_row(design: Design, requirement) -> list[str]:
    probability = design.requirement_probabilities.get(requirement.key)
    margin_text = format_requirement_margin(design, requirement).removeprefix("margin ")
    probability_cell = [] if probability is None else [format_probability_value(probability)]
    return [
        requirement.description,
        margin_text,
        *probability_cell,
        "the spec" if requirement.stated else "pamjax",
    ]


def _format_margins_caption(design: Design) -> str:
    """Return the caption of the table of requirements."""
    if not design.requirement_probabilities:
        return "Margin of the nearest muscle to each requirement"
    return "Margin to each requirement, and the probability that it holds under all uncertainties"


def _build_sensitivity_row(design: Design, sensitivity) -> list[str]:
    requirement = sensitivity.requirement
    return [
        requirement.description,
        f"{sensitivity.percent_saved:.3g} %",
        format_slope(design, sensitivity.slope, requirement),
    ]


def _build_error_row(error, design: Design) -> list[str]:
    if error.choice is None:
        return [error.thread, "cannot meet the spec", "", "", "", ""]
    unit = OBJECTIVE_UNITS[design.spec.entries.minimise]
    elastic_text = (
        "cannot meet the spec"
        if error.elastic_objective is None
        else format_quantity(error.elastic_objective, unit)
    )
    return [
        error.thread,
        f"{format_quantity(error.missing_force, 'N', 3)} ({100 * error.missing_force_share:.2g} %)",
        f"{format_quantity(error.excess_diameter, 'mm', 2)} ({100 * error.excess_diameter_share:.2g} %)",
        f"{100 * error.max_strain:.2g} %",
        format_quantity(error.inelastic_objective, unit),
        elastic_text,
    ]


def _format_choices_caption(design: Design) -> str:
    """Return the caption of the table of choices."""
    if not design.feasible:
        return "Best choices of the catalogue at typical material properties: shortfall of the requirements"
    target = design.spec.entries.probability
    if not target:
        return f"Best choices at typical properties, without a margin: minimum {design.spec.entries.minimise}"
    return (
        f"Choices that were optimised for the probability of {target:g}. Those that reach it come first,"
        f" sorted by {design.spec.entries.minimise}"
    )


def _build_choice_rows(design: Design) -> list[list[str]]:
    if not design.feasible:
        return [
            [
                str(result.problem.choice),
                f"{100 * (1 - math.exp(-result.violation)):.2g} % short",
                "nearest" if result.problem.choice == design.choice else "",
            ]
            for result in design.results[:_MAX_CHOICE_ROWS]
        ]
    unit = OBJECTIVE_UNITS[design.spec.entries.minimise]
    return [
        [
            str(finalist.result.problem.choice),
            format_quantity(math.exp(finalist.log_objective), unit),
            "" if math.isnan(finalist.probability) else format_probability_value(finalist.probability),
            "chosen" if finalist.result.problem.choice == design.choice else "",
        ]
        for finalist in design.finalists[:_MAX_CHOICE_ROWS]
    ]

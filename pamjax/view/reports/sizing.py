"""The report of a sizing: one offline HTML file, the muscle and its chart first, the receipt at the end."""

from __future__ import annotations

import hashlib
import math
from functools import partial
from pathlib import Path

from pamjax.sizing.report import TIGHT, not_alone, objective, room_words, slope_words
from pamjax.sizing.result import Design
from pamjax.units import show
from pamjax.view.figures import sizing as figures
from pamjax.view.reports.page import picture, write_page
from pamjax.view.reports.sizing_receipt import page_receipt
from pamjax.view.wording import upper

#: Rows of the table of choices.
RUNNERS = 8


def save_report(design: Design, path: str | Path, command: str = "") -> Path:
    """Write the report of a design.

    Args:
        design: the design.
        path: the HTML file; its folder must exist.
        command: what repeats it, in a shell.
    """
    return write_page(
        path,
        "design.html.jinja",
        title=headline(design),
        kicker=f"Sizing of {design.spec.name} · least {design.spec.words.minimise}",
        answer=answer(design),
        feasible=design.feasible,
        chart=picture(partial(figures.chart_figure, design), "chart"),
        prices=picture(partial(figures.price_figure, design), "prices"),
        front=picture(partial(figures.front_figure, design), "front"),
        front_words=_front_words(design),
        muscle=_muscle(design),
        margins_caption=_margins_caption(design),
        margins_head=["requirement", "room", *(["probability"] if design.held else []), "asked by"],
        margins=[_margin(design, one) for one in design.asked.requirements],
        gives=[give.says for give in design.gives if give.amount is not None],
        not_alone=f"{upper(not_alone(design))}:",
        lacks=[give.says for give in design.gives if give.amount is None],
        slopes=[_slope(design, price) for price in design.prices],
        costs=[_cost(cost, design) for cost in design.costs],
        runners_caption=_runners_caption(design),
        runners=[_runner(one, design) for one in design.tried[:RUNNERS]],
        receipt=page_receipt(design),
        spec=design.spec.text,
        checksum=hashlib.sha256(design.spec.text.encode()).hexdigest() if design.spec.text else "",
        command=command or "pamjax.size(...)",
    )


def headline(design: Design) -> str:
    """The answer in a line."""
    if not design.feasible:
        return "No muscle of this catalogue does all of it"
    choice = str(design.choice)
    under = " under pressure" if design.spec.words.minimise == "diameter" else ""
    return f"{upper(choice)}: {design.spec.words.minimise} {objective(design)}{under}"


def answer(design: Design) -> list[str]:
    """The answer in two sentences."""
    if not design.feasible:
        keys = [give.says for give in design.gives if give.amount is not None][:3]
        return [
            f"The nearest choice is {design.choice}.",
            f"Any one of these would do: {'; '.join(keys)}."
            if keys
            else f"No one requirement, given up alone, is enough. {figures.short_says(design)}.",
        ]
    n = design.numbers
    first = (
        f"At rest {show(n['rest_length'], 'mm')} long, threads of {show(n['thread_length'], 'mm')} in"
        f" {n['turns']:.3g} turns ({math.degrees(n['braid_angle']):.1f}° from the circumference) over a"
        f" bladder of {show(n['diameter'], 'mm')} outside and {show(n['wall'], 'mm', 3)} wall; at"
        f" {show(n['pressure'], 'kPa')} it widens to {show(design.output('widest'), 'mm')} at most."
    )
    wanted = design.spec.words.probability
    held = f"{design.probability:.2f}"
    if design.unsure:
        sure = f"No choice holds with the probability of {wanted:g} that is wanted; this does with {held}."
    else:
        sure = f"Everything holds together with probability {held} over other draws of all that is not known"
        bare = "; none was wanted, so it sits on its bounds: `probability = 0.9` in the spec buys room."
        sure += f", where {wanted:g} is wanted." if wanted else bare
    return [first, sure]


def _front_words(design: Design) -> str:
    if design.front is None:
        return ""
    if len(design.front.values) < 2:
        return f"The least {design.front.first} is also the least {design.front.second}."
    return ""


def _muscle(design: Design) -> list[list[str]]:
    n, choice = design.numbers, design.choice
    rows = [
        ["rest length", show(n["rest_length"], "mm"), "between the fittings"],
        ["thread length", show(n["thread_length"], "mm"), "of one unloaded thread"],
        ["turns", f"{n['turns']:.4g}", "of one thread"],
        ["braid angle", f"{math.degrees(n['braid_angle']):.2f} deg", "from the circumference, at rest"],
        ["threads", f"{choice.threads} of {show(choice.diameter, 'mm')}", choice.thread.about],
        ["bladder outside", show(n["diameter"], "mm"), f"at rest; {choice.bladder.about}"],
        ["wall", show(n["wall"], "mm", 3), "of the unstretched bladder"],
        ["working pressure", show(n["pressure"], "kPa"), f"supply {show(design.spec.supply, 'kPa')}"],
        ["muscles in parallel", str(choice.parallel), ""],
        ["widest", show(design.output("widest"), "mm"), "outside of one, under pressure"],
        ["mass", show(design.output("mass"), "g", 3), "threads and rubber of all, without fittings"],
        ["air", show(design.output("air"), "L", 3), "a stroke of all, at ambient pressure"],
    ]
    if any(kind.price for kind in (choice.thread, choice.bladder)):
        rows.append(["material", f"{design.output('cost'):.3g}", "in the currency of the spec's prices"])
    return rows


def _margin(design: Design, one) -> list[str]:
    room = float(one.margins(design.outputs).min())
    held = design.held.get(one.key)
    kept = "binds" if abs(room) < TIGHT else room_words(room, one)
    told = [] if held is None else [f"{held:.2f}"]
    return [one.says, kept, *told, "the spec" if one.stated else "pamjax"]


def _margins_caption(design: Design) -> str:
    """What the table of requirements shows."""
    if not design.held:
        return "Room that the nearest muscle has to each requirement"
    return "Room to each requirement, and the probability that it holds over what is not known"


def _slope(design: Design, price) -> list[str]:
    one = price.requirement
    return [one.says, f"{price.share:.3g} %", slope_words(design, price.slope, one)]


def _cost(cost, design: Design) -> list[str]:
    if cost.choice is None:
        return [cost.thread, "cannot meet the spec", "", "", "", ""]
    unit = figures.UNITS[design.spec.words.minimise]
    own = "cannot meet the spec" if cost.elastic is None else show(cost.elastic, unit)
    return [
        cost.thread,
        f"{show(cost.shortfall, 'N', 3)} ({100 * cost.share:.2g} %)",
        f"{show(cost.overrun, 'mm', 2)} ({100 * cost.wider:.2g} %)",
        f"{100 * cost.strain:.2g} %",
        show(cost.inelastic, unit),
        own,
    ]


def _runners_caption(design: Design) -> str:
    """What the table of choices shows, and why the chosen one may not have the least of it."""
    least = f"the least {design.spec.words.minimise} of each" if design.feasible else "how far each is short"
    head = f"The best choices of the catalogue, all properties at their typical values: {least}"
    wanted = design.spec.words.probability
    if not design.feasible or not wanted or design.unsure:
        return head
    return (
        f"{head}. To hold with probability {wanted:g} a muscle takes more: of those that do, the chosen one"
        f" has the least, {objective(design)}"
    )


def _runner(one, design: Design) -> list[str]:
    unit = figures.UNITS[design.spec.words.minimise]
    same = one.problem.choice == design.choice
    mark = ("chosen" if design.feasible else "nearest") if same else ""
    if one.answer is None:
        return [str(one.problem.choice), f"short by {100 * (1 - math.exp(-one.broken)):.2g} %", mark]
    return [str(one.problem.choice), show(math.exp(one.answer.value), unit), mark]

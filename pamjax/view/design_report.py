"""The report of a sizing: one offline HTML file, the muscle and its chart first, the receipt at the end."""

from __future__ import annotations

import hashlib
import math
from functools import partial
from pathlib import Path

from pamjax.design.note import TIGHT, objective, room_words, slope_words
from pamjax.design.result import Design
from pamjax.design.save import receipt
from pamjax.units import show
from pamjax.view import design_figures as figures
from pamjax.view.page import picture, write_page


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
        margins=[_margin(design, one) for one in design.asked.requirements],
        gives=[give.says for give in design.gives],
        slopes=[_slope(design, price) for price in design.prices],
        costs=[_cost(cost, design) for cost in design.costs],
        runners=[_runner(one, design) for one in design.tried[:8]],
        receipt={name: lines for name, lines in receipt(design).items() if lines},
        spec=design.spec.text,
        checksum=hashlib.sha256(design.spec.text.encode()).hexdigest() if design.spec.text else "",
        command=command or "pamjax.size(...)",
    )


def headline(design: Design) -> str:
    """The answer in a line."""
    if not design.feasible:
        return "No muscle of this catalogue does all of it"
    choice = str(design.choice)
    return f"{choice[:1].upper()}{choice[1:]}: {design.spec.words.minimise} {objective(design)}"


def answer(design: Design) -> list[str]:
    """The answer in two sentences."""
    if not design.feasible:
        keys = [give.says for give in design.gives if give.amount is not None][:3]
        return [
            f"The nearest choice is {design.choice}.",
            f"Any one of these would do: {'; '.join(keys)}."
            if keys
            else "No single requirement would do alone.",
        ]
    n = design.numbers
    first = (
        f"{show(n['rest_length'], 'mm')} long at rest, {show(n['diameter'], 'mm')} wide, threads of"
        f" {show(n['thread_length'], 'mm')} in {n['turns']:.3g} turns"
        f" ({math.degrees(n['braid_angle']):.1f}° from the circumference), a wall of"
        f" {show(n['wall'], 'mm', 3)}, at {show(n['pressure'], 'kPa')}."
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
        ["bladder outside", show(n["diameter"], "mm"), choice.bladder.about],
        ["wall", show(n["wall"], "mm", 3), "of the unstretched bladder"],
        ["working pressure", show(n["pressure"], "kPa"), f"supply {show(design.spec.supply, 'kPa')}"],
        ["muscles in parallel", str(choice.parallel), ""],
        ["widest", show(design.output("widest"), "mm"), "outside, at the working points"],
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
    told = "" if held is None else f"{held:.2f}"
    return [one.says, kept, told, "stated" if one.stated else "assumed"]


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


def _runner(one, design: Design) -> list[str]:
    unit = figures.UNITS[design.spec.words.minimise]
    if one.answer is None:
        return [str(one.problem.choice), f"short by {100 * (1 - math.exp(-one.broken)):.2g} %"]
    return [str(one.problem.choice), show(math.exp(one.answer.value), unit)]

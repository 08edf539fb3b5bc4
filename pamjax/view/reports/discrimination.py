"""The report of a contest: the protocol that tells two mechanisms apart first, then the whole menu."""

from __future__ import annotations

import math
import textwrap
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from pamjax.diagnosis.next_experiment.experiment import ENOUGH, Experiment
from pamjax.diagnosis.next_experiment.power import FALSE_ALARM
from pamjax.model.registry import mechanism
from pamjax.planning.discriminate import Contest
from pamjax.units import show
from pamjax.view.reports.page import picture, write_page
from pamjax.view.theme import DOUBLE, OKABE_ITO, QUIET, SINGLE, figure, theme

#: Protocols that are drawn.
DRAWN = 8


def power_figure(contest: Contest, narrow: bool = False) -> Figure:
    """The power of the most powerful protocols, with what is enough."""
    rows = contest.best[:DRAWN]
    folded = ["\n".join(textwrap.wrap(_doing(e), 26 if narrow else 62)) for e in rows]
    lines = sum(name.count("\n") + 1 for name in folded)
    with theme():
        made = figure(SINGLE if narrow else DOUBLE, 0.8 + 0.14 * lines + 0.12 * len(rows))
        panel = made.subplots()
        colours = [OKABE_ITO["blue"] if e is contest.chosen else QUIET for e in rows]
        panel.barh(range(len(rows)), [e.power for e in rows], color=colours, height=0.55)
        for k, e in enumerate(rows):
            panel.annotate(f"  {_duration(e)}", (e.power, k), va="center", fontsize=7)
        panel.axvline(ENOUGH, color=QUIET, ls=":", lw=0.9, gid="enough")
        panel.set_yticks(range(len(rows)), folded)
        panel.invert_yaxis()
        panel.set(xlim=(0, 1.15), xticks=(0, 0.5, ENOUGH, 1), xlabel="power")
        tells = "would tell" if contest.neither else "tells"
        panel.set_title(f"{contest.chosen.id} {tells} them apart with power {_share(contest.chosen)}")
    return made


def _doing(one: Experiment) -> str:
    """What is done, without its duration."""
    return f"{one.id}: {one.protocol.rpartition(' (')[0]}"


def _share(one: Experiment) -> str:
    return "above 0.99" if one.power > 0.99 else f"{one.power:.2f}"


def _duration(one: Experiment) -> str:
    return f"{one.minutes:.0f} min" if one.minutes < 90 else f"{one.minutes / 60:.0f} h"


def save_report(contest: Contest, path: str | Path, command: str = "") -> Path:
    """Write the report of a contest.

    Args:
        contest: the contest.
        path: the HTML file; its folder must exist.
        command: what repeats it, in a shell.
    """
    return write_page(
        path,
        "contest.html.jinja",
        title=headline(contest),
        kicker=f"What to measure next with {contest.case.name}: {' or '.join(contest.ids)}",
        answer=answer(contest),
        power=picture(partial(power_figure, contest), "power"),
        menu=[_row(e) for e in contest.best],
        alarm=f"{FALSE_ALARM:.0%}",
        ids=contest.ids,
        about=[f"{id}: {mechanism(id).about.title}" for id in contest.ids],
        rig=_rig(contest),
        checksum=contest.case.checksum,
        command=command or "pamjax.tell(...)",
    )


def headline(contest: Contest) -> str:
    """The answer in a line."""
    if contest.neither:
        return f"Neither {' nor '.join(contest.ids)} explains this recording"
    if contest.chosen.power < ENOUGH:
        return "No protocol of the menu surely tells them apart"
    return f"{_duration(contest.chosen)} tell {' from '.join(contest.ids)}"


def answer(contest: Contest) -> tuple[str, str]:
    """What to do and how sure that is; how it stands now, first where neither explains the recording."""
    best = "" if contest.chosen.power >= ENOUGH else " The best there is:"
    first = f"{best} {_doing(contest.chosen).partition(': ')[2]} ({_duration(contest.chosen)})".strip()
    sure = f"where {contest.ids[0]} is true, that settles it with probability {_share(contest.chosen)}"
    if not contest.neither:
        return f"{first}: {sure}.", f"So far: {contest.standing}."
    told = f"{contest.leaves[:1].upper()}{contest.leaves[1:]}: there is no choice between the two before."
    return told, f"Were one of them true all the same: {first[:1].lower()}{first[1:]}; {sure}."


def _row(one: Experiment) -> list[str]:
    limit = f"{one.limit:.1f}" if math.isfinite(one.limit) else "never"
    return [one.id, _doing(one).partition(": ")[2], f"{one.power:.2f}", _duration(one), limit]


def _rig(contest: Contest) -> list[list[str]]:
    rig = contest.stage.rig
    rows = [
        ["highest pressure", show(rig.pressure, "kPa", 3)],
        ["largest contraction", f"{rig.contraction:.0%}"],
        ["speed of a stroke", f"{1e3 * rig.speed:.3g} mm/s"],
        ["between samples", f"{rig.step:.3g} s"],
        ["noise of force, a sample", show(rig.force, "N", 2)],
        ["noise of diameter, a sample", show(rig.diameter, "mm", 2)],
        ["noise of pressure, a sample", show(rig.gauge, "kPa", 2)],
        ["noise of length, a sample", show(rig.ruler, "mm", 2)],
    ]
    wider = contest.stage.wider
    return rows + ([["what the models leave widens noise by", f"{wider:.2f}"]] if wider > 1 else [])

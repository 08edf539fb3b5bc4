"""`pamjax plan`: which runs to make next, what they cost, what they will settle."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from pamjax.cli.screen import REPORT, command, say, say_json, say_written, working, writable


def plan(
    muscle: Path,
    /,
    rig: Path | None = None,
    *,
    goal: str | None = None,
    to: str | None = None,
    tell: Annotated[list[str] | None, Parameter(consume_multiple=True, negative="")] = None,
    minutes: float | None = None,
    law: str | None = None,
    out: Path = Path("out"),
    figures: bool = True,
    report: bool = True,
    seed: int = 0,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Choose the next runs of a muscle on a rig: for a number, or to tell two mechanisms apart.

    Writes plan.json, schedule.csv (what to command), figures and report.html; with `--tell` contest.json and
    report.html. Needs no recording, but for `--tell`: a muscle.toml will do.

    Args:
        muscle: a case folder, or a muscle.toml.
        rig: a TOML file with a table [rig]: pressure, contraction, speed, rate, minutes, noise of force and
            diameter ("none" where there is no sensor), what zeros and gains may be off by.
        goal: the number to be known, as thread.modulus, or "all"; the threads' stiffness if left out.
        to: its wanted standard deviation, as "5 %" or "4 GPa".
        tell: two mechanisms to tell apart, as braid_friction viscous_damping; the rig is the recording's.
        minutes: time that there is for all runs; the rig's if left out, or 60.
        law: thread law; the baseline's if left out.
        out: folder to write to.
        figures: whether to draw.
        report: whether to write report.html, which opens in any browser.
        seed: of the truths over which a promise is averaged.
        json: print the plan as JSON.
    """
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.errors import refuse
    from pamjax.records.case import MUSCLE, RECORDING

    writable(out)
    recorded = muscle.is_dir() and (muscle / RECORDING).exists()
    if tell is not None:
        if len(tell) != 2:
            raise refuse(
                "`--tell` takes two mechanisms", f"{len(tell)}", remedy="Name both, one after another."
            )
        if not recorded:
            remedy = f"Name {muscle.parent}." if (muscle.parent / RECORDING).exists() else ""
            raise refuse("`--tell` takes a case folder with a recording", f"{muscle}", remedy=remedy)
        if other := [f"`--{n}`" for n, v in (("goal", goal), ("to", to), ("minutes", minutes)) if v]:
            raise refuse("`--tell` plans for a tie, not for a number", ", ".join(other))
        if rig is not None:
            raise refuse("`--tell` takes the rig that made the recording", f"{rig.name} besides")
        keep_compiled()
        _tell(muscle, tell[0], tell[1], out, report, json)
        return
    keep_compiled()
    from pamjax.planning.plan import plan as choose
    from pamjax.planning.plan import save_plan
    from pamjax.records.files import read_bytes

    with working(quiet=json) as progress:
        progress("choosing runs", 0.0)
        found = choose(muscle, rig, goal, to, minutes=minutes, law=law, seed=seed)
    files = save_plan(found, out)
    if figures or report:
        from hashlib import sha256

        from pamjax.view.figures.plan import Course, save_figures
        from pamjax.view.reports.plan import save_report

        course = Course.of(found)
        if figures:
            files += save_figures(found, course, out)
        if report:
            file = muscle / MUSCLE if muscle.is_dir() else muscle
            checksum = sha256(read_bytes(muscle / RECORDING if recorded else file))
            if recorded:
                checksum.update(read_bytes(file))
            files.append(save_report(found, course, out / REPORT, command(), checksum.hexdigest()))
    say_json(found.as_dict()) if json else say(str(found))
    say_written(files)


def _tell(muscle: Path, first: str, second: str, out: Path, report: bool, json: bool) -> None:
    from pamjax.planning.discriminate import save_contest
    from pamjax.planning.discriminate import tell as settle

    with working(quiet=json) as progress:
        contest = settle(muscle, first, second, progress)
    files = save_contest(contest, out)
    if report:
        from pamjax.view.reports.discrimination import save_report

        files.append(save_report(contest, out / REPORT, command()))
    say_json(contest.as_dict()) if json else say(str(contest))
    say_written(files)

"""`pamjax plan`: which runs to make next, what they cost, what they will settle."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from pamjax.cli.screen import (
    REPORT_FILE,
    check_writable,
    format_command,
    print_json,
    print_text,
    print_written_files,
    show_progress,
)


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
    from pamjax.records.case import MUSCLE_FILE, RECORDING_FILE

    check_writable(out)
    recorded = muscle.is_dir() and (muscle / RECORDING_FILE).exists()
    if tell is not None:
        if len(tell) != 2:
            raise refuse(
                "`--tell` takes two mechanisms", f"{len(tell)}", remedy="Name both, one after another."
            )
        if not recorded:
            remedy = f"Name {muscle.parent}." if (muscle.parent / RECORDING_FILE).exists() else ""
            raise refuse("`--tell` takes a case folder with a recording", f"{muscle}", remedy=remedy)
        if extra_options := [
            f"`--{option}`" for option, value in (("goal", goal), ("to", to), ("minutes", minutes)) if value
        ]:
            raise refuse("`--tell` plans for a tie, not for a number", ", ".join(extra_options))
        if rig is not None:
            raise refuse("`--tell` takes the rig that made the recording", f"{rig.name} besides")
        keep_compiled()
        _discriminate(muscle, tell[0], tell[1], out, report, json)
        return
    keep_compiled()
    from pamjax.planning.plan import plan as choose
    from pamjax.planning.plan import save_plan
    from pamjax.records.files import read_bytes

    with show_progress(quiet=json) as progress:
        progress("choosing runs", 0.0)
        result = choose(muscle, rig, goal, to, minutes=minutes, law=law, seed=seed)
    files = save_plan(result, out)
    if figures or report:
        from hashlib import sha256

        from pamjax.view.figures.plan import PrecisionCourse, save_plan_figures
        from pamjax.view.reports.plan import write_plan_report

        course = PrecisionCourse.from_plan(result)
        if figures:
            files += save_plan_figures(result, course, out)
        if report:
            file = muscle / MUSCLE_FILE if muscle.is_dir() else muscle
            checksum = sha256(read_bytes(muscle / RECORDING_FILE if recorded else file))
            if recorded:
                checksum.update(read_bytes(file))
            files.append(
                write_plan_report(result, course, out / REPORT_FILE, format_command(), checksum.hexdigest())
            )
    print_json(result.as_dict()) if json else print_text(str(result))
    print_written_files(files)


def _discriminate(muscle: Path, first: str, second: str, out: Path, report: bool, json: bool) -> None:
    from pamjax.planning.discriminate import discriminate as settle
    from pamjax.planning.discriminate import save_discrimination

    with show_progress(quiet=json) as progress:
        discrimination = settle(muscle, first, second, progress)
    files = save_discrimination(discrimination, out)
    if report:
        from pamjax.view.reports.discrimination import write_discrimination_report

        files.append(write_discrimination_report(discrimination, out / REPORT_FILE, format_command()))
    print_json(discrimination.as_dict()) if json else print_text(str(discrimination))
    print_written_files(files)

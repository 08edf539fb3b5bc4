"""`pamjax plan`: choose the next runs of a muscle on a test rig."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.options import Json, MechanismList, MechanismPair
from pamjax.cli.overwrite import check_replaceable
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
    distinguish: MechanismPair = None,
    with_: MechanismList = None,
    minutes: float | None = None,
    law: str | None = None,
    out: Path = Path("out"),
    figures: bool = True,
    report: bool = True,
    seed: int = 0,
    json: Json = False,
) -> None:
    """Choose the next runs on a test rig: to determine a parameter, or to distinguish two mechanisms.

    Writes plan.json, schedule.csv (pressure and length to command), figures and report.html. With
    `--distinguish` it writes discrimination.json and report.html. Only `--distinguish` needs a recording;
    otherwise a muscle.toml is sufficient.

    Args:
        muscle: case folder or muscle.toml.
        rig: TOML file with a table [rig]: pressure, contraction, speed, rate, minutes, and noise of force and
            diameter ("none" without this sensor). It can also have the uncertainty of sensor zeros and gains.
        goal: parameter to determine, such as thread.modulus, or "all"; by default the stiffness of the
            threads.
        to: wanted standard deviation of the goal, such as "5 %" or "4 GPa"; by default "5 %".
        distinguish: two mechanisms to distinguish, such as braid_friction viscous_damping, on the rig of the
            recording.
        with_: with `--distinguish`: mechanisms in both models, such as the others that a diagnosis names.
        minutes: available time for all runs; by default that of the rig file, or 60.
        law: thread law; by default that of the baseline model.
        out: output folder.
        figures: write the figures.
        report: write report.html for a web browser.
        seed: random seed for the parameter values over which the expected precision is averaged.
        json: print one JSON document.
    """
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.errors import BadInput
    from pamjax.records.case import MUSCLE_FILE, RECORDING_FILE

    check_writable(out)
    recorded = muscle.is_dir() and (muscle / RECORDING_FILE).exists()
    if distinguish is not None:
        if len(distinguish) != 2:
            raise BadInput.from_rule(
                "`--distinguish` needs two mechanisms",
                f"{len(distinguish)}",
                remedy="Name both, one after the other.",
            )
        if not recorded:
            remedy = f"Name {muscle.parent}." if (muscle.parent / RECORDING_FILE).exists() else ""
            raise BadInput.from_rule(
                "`--distinguish` needs a case folder with a recording", f"{muscle}", remedy=remedy
            )
        if extra_options := [
            f"`--{option}`" for option, value in (("goal", goal), ("to", to), ("minutes", minutes)) if value
        ]:
            raise BadInput.from_rule(
                "`--distinguish` cannot be combined with `--goal`, `--to` or `--minutes`",
                ", ".join(extra_options),
                remedy="Omit them.",
            )
        if rig is not None:
            raise BadInput.from_rule(
                "`--distinguish` uses the rig of the recording", f"{rig.name}", remedy="Remove the rig file."
            )
        check_replaceable(out, ["discrimination.json", *([REPORT_FILE] if report else [])])
        keep_compiled()
        _discriminate(muscle, (distinguish[0], distinguish[1]), with_ or [], out, report, json)
        return
    if with_:
        raise BadInput.from_rule("`--with` needs `--distinguish`", " ".join(with_), remedy="Remove `--with`.")
    figure_names = ["plan.png", "schedule.png"] if figures else []
    check_replaceable(out, ["plan.json", "schedule.csv", *figure_names, *([REPORT_FILE] if report else [])])
    keep_compiled()
    from pamjax.planning.plan import plan as choose_runs
    from pamjax.planning.plan import save_plan
    from pamjax.records.files import read_bytes

    with show_progress(quiet=json) as progress:
        progress("choosing runs", 0.0)
        result = choose_runs(muscle, rig, goal, to, minutes=minutes, law=law, seed=seed)
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


def _discriminate(
    muscle: Path, ids: tuple[str, str], mechanisms: list[str], out: Path, report: bool, json: bool
) -> None:
    from pamjax.planning.discriminate import discriminate, save_discrimination

    with show_progress(quiet=json) as progress:
        discrimination = discriminate(muscle, *ids, progress, mechanisms=mechanisms)
    files = save_discrimination(discrimination, out)
    if report:
        from pamjax.view.reports.discrimination import write_discrimination_report

        files.append(write_discrimination_report(discrimination, out / REPORT_FILE, format_command()))
    print_json(discrimination.as_dict()) if json else print_text(str(discrimination))
    print_written_files(files)

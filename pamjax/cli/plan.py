"""`pamjax plan`: which runs to make next, what they cost, what they will settle."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from pamjax.cli.screen import say, say_json, say_written, working, writable


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
    figure: bool = True,
    seed: int = 0,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Choose the next runs of a muscle on a rig: for a number, or to tell two mechanisms apart.

    Writes plan.json, schedule.csv (what to command) and a figure. Needs no recording: a muscle.toml will do.

    Args:
        muscle: a case folder, or a muscle.toml.
        rig: a TOML file with a table [rig]: pressure, contraction, speed, rate, minutes, noise of force and
            diameter ("none" where there is no sensor), what zeros and gains may be off by.
        goal: the number to be known, as thread.modulus, or "all"; the threads' stiffness if left out.
        to: its wanted standard deviation, as "5 %" or "4 GPa".
        tell: two mechanisms to tell apart, as braid_friction viscous_damping; needs a recording.
        minutes: that there are.
        law: thread law; the baseline's if left out.
        out: folder to write to.
        figure: whether to draw it.
        seed: of the truths over which a promise is averaged.
        json: print the plan as JSON.
    """
    from pamjax.check import refuse
    from pamjax.infer.cache import keep_compiled
    from pamjax.records.case import RECORDING, read_case

    writable(out)
    recorded = muscle.is_dir() and (muscle / RECORDING).exists()
    keep_compiled()
    if tell is not None:
        if len(tell) != 2 or not recorded:
            got = f"{len(tell)} and {'a' if recorded else 'no'} recording"
            raise refuse("`--tell` takes two mechanisms and a case folder with a recording", got)
        from pamjax.design.tell import tell as settle

        contest = settle(read_case(muscle), *tell)
        say_json(contest.as_dict()) if json else say(str(contest))
        return
    from pamjax.design.plan import plan as choose
    from pamjax.design.plan import save_plan
    from pamjax.records.entry import read_entry
    from pamjax.records.files import read_bytes

    file = muscle / "muscle.toml" if muscle.is_dir() else muscle
    said = read_case(muscle) if recorded else read_entry(read_bytes(file), file.name)
    with working(quiet=json) as progress:
        progress("choosing runs", 0.0)
        found = choose(said, rig, goal, to, minutes=minutes, law=law, seed=seed)
    files = save_plan(found, out)
    if figure:
        from pamjax.view.plan_figure import plan_figure
        from pamjax.view.theme import save_png

        files.append(save_png(plan_figure(found), out / "plan"))
    say_json(found.as_dict()) if json else say(str(found))
    say_written(files)

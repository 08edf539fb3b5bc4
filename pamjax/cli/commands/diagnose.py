"""`pamjax diagnose`: what a recording's model leaves out, where it shows, and what naming it gains."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from pamjax.cli.options import Json
from pamjax.cli.screen import REPORT, say, say_json, say_written, working, writable
from pamjax.errors import BadInput, at_least, refuse

if TYPE_CHECKING:
    from pamjax.baselines.comparison import Contest
    from pamjax.diagnosis.result import Diagnosis


def diagnose(
    cases: list[Path],
    /,
    *,
    out: Path = Path("out"),
    seed: int = 0,
    report: bool = True,
    beside: bool = True,
    json: Json = False,
) -> None:
    """Locate the mismatch of a recording, name the missing physics, model it, show the gain.

    Writes diagnosis.json, prediction.csv, model.json, gain.json and report.html for each case, in a folder of
    its name; prints the verdict. A bad case is told in one sentence; the good ones are still answered.

    Args:
        cases: case folders, each with recording.csv and muscle.toml.
        out: folder to write to.
        seed: of the draws behind the p-values.
        report: whether to write the report, which opens in any browser.
        beside: whether to score Sárosi's formula and a Gaussian process on the same held-out rows, and all of
            them beyond what was fitted: a few seconds a case.
        json: print the verdicts as JSON, one document a case in a list.
    """
    from pamjax.records.case import read_case

    at_least("seed", seed, 0)
    writable(out)
    read, bad = [], []
    for folder in cases:
        try:
            read.append(read_case(folder))
        except BadInput as error:
            bad.append(_of(folder, error) if len(cases) > 1 else error)
    names = [case.name for case in read]
    for name in names:
        if names.count(name) > 1:
            raise refuse("cases of one call need names of their own", f"{name!r} twice", "", "Rename one.")
    answered, told, early = [], [], 0
    if read:
        _tell(bad)  # before the long work, not after it
        early = len(bad)
        from pamjax.baselines.comparison import contest, save_contest
        from pamjax.compile.jax_cache import keep_compiled
        from pamjax.diagnosis.batch import diagnose_all
        from pamjax.diagnosis.result import save

        keep_compiled()
        with working(quiet=json) as progress:
            for case, found in diagnose_all(read, seed=seed, progress=progress):
                if isinstance(found, BadInput):
                    bad.append(_of(case.folder, found) if len(cases) > 1 else found)
                    continue
                save(found, out / case.name)
                held = contest(found, seed) if beside else None
                if held:
                    save_contest(held, out / case.name)
                if report:
                    _report(found, held, out, seed)
                answered.append(found)
                told.append(_told(found, held))
    if json:
        say_json([found.as_dict() for found in answered])
    else:
        say("\n\n".join(told))
    more = [*(["gain.json"] if beside else []), *([REPORT] if report else [])]
    files = ["diagnosis.json", "prediction.csv", "model.json", *more]
    say_written([out / found.found.case.name / name for found in answered for name in files])
    if bad:
        _tell(bad[early:-1])
        raise bad[-1]  # the command ends with it, told before or not


def _tell(errors: list[BadInput]) -> None:
    for error in errors:
        print(f"pamjax: {error}", file=sys.stderr)


def _of(folder: Path, error: BadInput) -> BadInput:
    """The sentence with the case it is about."""
    return BadInput(f"{folder}: {error}")


def _told(found: Diagnosis, held: Contest | None) -> str:
    """The verdict, with the rivals' scores, in no more lines than the verdict alone may have."""
    from pamjax.diagnosis.result import LINES

    beside = str(held).splitlines() if held else []
    return "\n".join([*str(found).splitlines()[: LINES - len(beside)], *beside])


def _report(found: Diagnosis, held: Contest | None, out: Path, seed: int) -> None:
    from pamjax.view.reports.diagnosis import save_report

    case = found.found.case
    words = ["pamjax", "diagnose", str(case.folder), "--out", str(out), "--seed", str(seed)]
    save_report(found, out / case.name / REPORT, shlex.join(words), held)

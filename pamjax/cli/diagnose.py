"""`pamjax diagnose`: what a recording's model leaves out, where it shows, and what naming it gains."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from pamjax.check import BadInput, refuse
from pamjax.cli.screen import say, say_json, say_written, working, writable

if TYPE_CHECKING:
    from pamjax.study.diagnosis import Diagnosis


def diagnose(
    cases: list[Path],
    /,
    *,
    out: Path = Path("out"),
    seed: int = 0,
    report: bool = True,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Locate the mismatch of a recording, name the missing physics, model it, show the gain.

    Writes diagnosis.json, prediction.csv, model.json and report.html for each case, in a folder of its name;
    prints the verdict. A bad case is told in one sentence; the good ones are still answered.

    Args:
        cases: case folders, each with recording.csv and muscle.toml.
        out: folder to write to.
        seed: of the draws behind the p-values.
        report: whether to write the report, which opens in any browser.
        json: print the verdicts as JSON, one document a case in a list.
    """
    from pamjax.records.case import read_case

    writable(out)
    read, bad = [], []
    for folder in cases:
        try:
            read.append(read_case(folder))
        except BadInput as error:
            bad.append(error)
    names = [case.name for case in read]
    for name in names:
        if names.count(name) > 1:
            raise refuse("cases of one call need names of their own", f"{name!r} twice", "", "Rename one.")
    answered = []
    if read:
        from pamjax.infer.cache import keep_compiled
        from pamjax.study.batch import diagnose_all
        from pamjax.study.diagnosis import save

        keep_compiled()
        with working(quiet=json) as progress:
            for case, found in diagnose_all(read, seed=seed, progress=progress):
                if isinstance(found, BadInput):
                    bad.append(found)
                    continue
                save(found, out / case.name)
                if report:
                    _report(found, out, seed)
                answered.append(found)
    if json:
        say_json([found.as_dict() for found in answered])
    else:
        say("\n\n".join(str(found) for found in answered))
    files = ["diagnosis.json", "prediction.csv", "model.json", *(["report.html"] if report else [])]
    say_written([out / found.found.case.name / name for found in answered for name in files])
    if bad:
        for error in bad[:-1]:
            print(f"pamjax: {error}", file=sys.stderr)
        raise bad[-1]


def _report(found: Diagnosis, out: Path, seed: int) -> None:
    from pamjax.view.diagnosis_report import save_report

    case = found.found.case
    words = ["pamjax", "diagnose", str(case.folder), "--out", str(out), "--seed", str(seed)]
    save_report(found, out / case.name / "report.html", shlex.join(words))

"""`pamjax diagnose`: what a recording's model leaves out, where it shows, and what naming it gains."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from pamjax.cli.options import Json
from pamjax.cli.screen import (
    REPORT_FILE,
    check_writable,
    print_json,
    print_text,
    print_written_files,
    show_progress,
)
from pamjax.errors import BadInput, check_minimum, refuse

if TYPE_CHECKING:
    from pamjax.baselines.comparison import ModelComparison
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

    check_minimum("seed", seed, 0)
    check_writable(out)
    parsed_cases, errors = [], []
    for folder in cases:
        try:
            parsed_cases.append(read_case(folder))
        except BadInput as error:
            errors.append(_name_case(folder, error) if len(cases) > 1 else error)
    names = [case.name for case in parsed_cases]
    for name in names:
        if names.count(name) > 1:
            raise refuse("cases of one call need names of their own", f"{name!r} twice", "", "Rename one.")
    diagnoses, notes, reported_count = [], [], 0
    if parsed_cases:
        _print_errors(errors)  # before the long work, not after it
        reported_count = len(errors)
        from pamjax.baselines.comparison import compare_models, save_comparison
        from pamjax.compile.jax_cache import keep_compiled
        from pamjax.diagnosis.batch import diagnose_all
        from pamjax.diagnosis.result import save_diagnosis

        keep_compiled()
        with show_progress(quiet=json) as progress:
            for case, outcome in diagnose_all(parsed_cases, seed=seed, progress=progress):
                if isinstance(outcome, BadInput):
                    errors.append(_name_case(case.folder, outcome) if len(cases) > 1 else outcome)
                    continue
                save_diagnosis(outcome, out / case.name)
                comparison = compare_models(outcome, seed) if beside else None
                if comparison:
                    save_comparison(comparison, out / case.name)
                if report:
                    _write_report(outcome, comparison, out, seed)
                diagnoses.append(outcome)
                notes.append(_format_note(outcome, comparison))
    if json:
        print_json([outcome.as_dict() for outcome in diagnoses])
    else:
        print_text("\n\n".join(notes))
    optional_files = [*(["gain.json"] if beside else []), *([REPORT_FILE] if report else [])]
    files = ["diagnosis.json", "prediction.csv", "model.json", *optional_files]
    print_written_files([out / outcome.problem.case.name / name for outcome in diagnoses for name in files])
    if errors:
        _print_errors(errors[reported_count:-1])
        raise errors[-1]  # the command ends with it, told before or not


def _print_errors(errors: list[BadInput]) -> None:
    for error in errors:
        print(f"pamjax: {error}", file=sys.stderr)


def _name_case(folder: Path, error: BadInput) -> BadInput:
    """The sentence with the case it is about."""
    return BadInput(f"{folder}: {error}")


def _format_note(diagnosis: Diagnosis, comparison: ModelComparison | None) -> str:
    """The verdict, with the rivals' scores, in no more lines than the verdict alone may have."""
    from pamjax.diagnosis.result import MAX_VERDICT_LINES

    comparison_lines = str(comparison).splitlines() if comparison else []
    return "\n".join(
        [*str(diagnosis).splitlines()[: MAX_VERDICT_LINES - len(comparison_lines)], *comparison_lines]
    )


def _write_report(diagnosis: Diagnosis, comparison: ModelComparison | None, out: Path, seed: int) -> None:
    from pamjax.view.reports.diagnosis import write_diagnosis_report

    case = diagnosis.problem.case
    words = ["pamjax", "diagnose", str(case.folder), "--out", str(out), "--seed", str(seed)]
    write_diagnosis_report(diagnosis, out / case.name / REPORT_FILE, shlex.join(words), comparison)

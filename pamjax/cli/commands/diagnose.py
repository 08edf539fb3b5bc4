"""`pamjax diagnose`: identify the mechanisms that the model of a recording lacks."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from pamjax.cli.options import Json
from pamjax.cli.overwrite import check_replaceable
from pamjax.cli.screen import (
    REPORT_FILE,
    announce_compilation,
    check_writable,
    format_command,
    print_json,
    print_text,
    print_written_files,
    show_progress,
)
from pamjax.errors import BadInput, check_minimum

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
    compare: Annotated[bool, Parameter(name=("--compare", "--beside"))] = True,
    json: Json = False,
) -> None:
    """Test the baseline model of a recording and identify missing mechanisms.

    For each case the command writes diagnosis.json, prediction.csv, model.json, gain.json and report.html to
    a folder with the name of the case. It prints a summary. If a case cannot be used, the command prints an
    error message and continues with the other cases.

    Args:
        cases: case folders, each with recording.csv and muscle.toml.
        out: output folder.
        seed: random seed for the p-values.
        report: write report.html for a web browser.
        compare: also evaluate Sárosi's formula and a Gaussian process on the held-out rows and in
            extrapolation; takes a few seconds for each case.
        json: print a JSON list with one diagnosis for each case.
    """
    from pamjax.records.case import read_case
    from pamjax.records.long_recording import advise_reduction

    check_minimum("seed", seed, 0)
    check_writable(out)
    parsed_cases, errors = [], []
    for folder in cases:
        try:
            case = read_case(folder)
            check_replaceable(out / case.name, _list_names(compare, report))
            parsed_cases.append(case)
        except BadInput as error:
            errors.append(_name_case(folder, error) if len(cases) > 1 else error)
    names = [case.name for case in parsed_cases]
    for name in names:
        if names.count(name) > 1:
            _print_errors(errors)
            rule = "cases of one command must have different names"
            raise BadInput.from_rule(rule, f"{name!r} twice", remedy="Rename one folder.")
    diagnoses, summaries, paths, reported_count = [], [], [], 0
    if parsed_cases:
        _print_errors(errors)  # before the long computation
        reported_count = len(errors)
        from pamjax.baselines.comparison import compare_models, save_comparison
        from pamjax.compile.jax_cache import keep_compiled
        from pamjax.diagnosis.batch import diagnose_all
        from pamjax.diagnosis.result import save_diagnosis
        from pamjax.records.files import write_results_together

        for case in parsed_cases:
            for advice in advise_reduction(case.recording):
                print(f"{case.name}: {advice}", file=sys.stderr)
        announce_compilation(keep_compiled(), quiet=json)
        with show_progress(quiet=json) as progress:
            for case, outcome in diagnose_all(parsed_cases, seed=seed, progress=progress):
                if isinstance(outcome, BadInput):
                    errors.append(_name_case(case.folder, outcome) if len(cases) > 1 else outcome)
                    continue
                comparison = compare_models(outcome, seed) if compare else None
                with write_results_together(out / case.name) as folder:
                    save_diagnosis(outcome, folder)
                    if comparison is not None:
                        save_comparison(comparison, folder)
                    if report:
                        from pamjax.view.reports.diagnosis import write_diagnosis_report

                        file = folder / REPORT_FILE
                        write_diagnosis_report(outcome, file, format_command(), comparison, out / case.name)
                diagnoses.append(outcome)
                closing_lines = _format_closing_lines(outcome, out / case.name, report)
                summaries.append("\n".join([_format_summary(outcome, comparison), *closing_lines]))
                paths += _list_files(outcome, out, comparison is not None, report)
    if json:
        print_json([outcome.as_dict() for outcome in diagnoses])
    else:
        print_text("\n\n".join(summaries))
    print_written_files(paths)
    if len(errors) > reported_count:
        _print_errors(errors[reported_count:-1])
        raise errors[-1]  # `main` prints this one
    if errors:
        raise BadInput(f"{len(errors)} of {len(cases)} cases not diagnosed: see the messages above")


def _list_files(diagnosis: Diagnosis, out: Path, compared: bool, report: bool) -> list[Path]:
    """Return the files that the command wrote for a case."""
    folder = out / diagnosis.problem.case.name
    return [folder / name for name in _list_names(compared, report)]


def _list_names(compared: bool, report: bool) -> list[str]:
    """Return the names of the files for each case."""
    optional_files = [*(["gain.json"] if compared else []), *([REPORT_FILE] if report else [])]
    return ["diagnosis.json", "prediction.csv", "model.json", *optional_files]


def _print_errors(errors: list[BadInput]) -> None:
    for error in errors:
        print(f"pamjax: {error}", file=sys.stderr)


def _name_case(folder: Path, error: BadInput) -> BadInput:
    """Return the error with the folder of its case."""
    return BadInput(f"{folder}: {error}")


def _format_closing_lines(diagnosis: Diagnosis, folder: Path, report: bool) -> list[str]:
    """Return a line with the first file to open, and a line with the next step."""
    from pamjax.diagnosis.next_step import describe_next_step

    if diagnosis.experiments:
        # The summary has its protocol.
        step = "run the experiment above, and diagnose its recording"
    else:
        step = " ".join(describe_next_step(diagnosis, shlex.quote(str(folder / "model.json"))))
    return [f"results: {folder / (REPORT_FILE if report else 'diagnosis.json')}", f"next: {step}"]


def _format_summary(diagnosis: Diagnosis, comparison: ModelComparison | None) -> str:
    """Return the summary with the comparison, within the line limit of a summary."""
    from pamjax.diagnosis.summary import MAX_SUMMARY_LINES

    comparison_lines = str(comparison).splitlines() if comparison else []
    return "\n".join(
        [*str(diagnosis).splitlines()[: MAX_SUMMARY_LINES - len(comparison_lines)], *comparison_lines]
    )

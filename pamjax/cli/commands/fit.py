"""`pamjax fit`: calibrate a muscle model on its recording."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from pamjax.cli.earlier_fit import describe_earlier_fit, list_earlier_files
from pamjax.cli.options import DEFAULT_MODEL, Json, ModelOptions
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

if TYPE_CHECKING:
    from pamjax.infer.fitting.result import Fit


def fit(
    cases: list[Path],
    /,
    *,
    out: Path = Path("out"),
    model: ModelOptions = DEFAULT_MODEL,
    form_error: Annotated[bool, Parameter(negative="")] = False,
    loss: Literal["square", "soft"] = "square",
    starts: int = 4,
    folds: int = 5,
    seed: int = 0,
    figures: bool = True,
    report: bool = True,
    json: Json = False,
) -> None:
    """Calibrate a muscle model on its recording, or several muscles together.

    Writes fit.json, fit.nc (netCDF with predictions and residuals), figures and report.html. Prints a
    summary with every parameter, its standard deviation and the held-out error.

    Args:
        cases: case folders, each with recording.csv and muscle.toml.
        out: output folder. Files of an earlier fit in it are replaced, and the command states which fit this
            was. Other files are unchanged: if one has the name of a result, the command stops before the fit.
        form_error: allow for differences between effects and the equations of the mechanisms.
        loss: square (least squares) or soft (robust: limits the influence of outliers).
        starts: number of starting points of the minimiser.
        folds: number of folds of the cross-validation; the blocks are distributed over them.
        seed: random seed for the starting points and the cross-validation.
        figures: write the figures.
        report: write report.html for a web browser.
        json: print fit.json instead of the summary.
    """
    # Check the output folder before the long computation.
    check_writable(out)
    parsed_cases = model.read_cases(cases)
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.infer.fitting.fit import fit as calibrate
    from pamjax.infer.fitting.io import build_fit_document, list_result_names, save
    from pamjax.records.files import write_results_together

    names = list_result_names([case.name for case in parsed_cases]) + ([REPORT_FILE] if report else [])
    if figures:
        from pamjax.view.figures.fit import list_figure_names

        names += list_figure_names([case.name for case in parsed_cases])
    check_replaceable(out, names)
    keep_compiled()
    with show_progress(quiet=json) as progress:
        result = calibrate(
            parsed_cases,
            *model.fit_arguments,
            form_error=form_error,
            loss=loss,
            starts=starts,
            fold_count=folds,
            seed=seed,
            progress=progress,
        )
    earlier_fit, earlier_names = describe_earlier_fit(out), list_earlier_files(out)
    with write_results_together(out, earlier_names) as folder:
        paths = save(result, folder)
        if figures:
            from pamjax.view.figures.fit import save_fit_figures

            paths += save_fit_figures(result, folder)
        if report:
            from pamjax.view.reports.fit import write_fit_report

            paths.append(write_fit_report(result, folder / REPORT_FILE, format_command()))
    paths = [out / path.name for path in paths]
    if json:
        print_json(build_fit_document(result))
    else:
        print_text(str(result))
        print_text(f"results: {out / REPORT_FILE if report else out / 'fit.json'}")
        print_text(f"next: pamjax {_suggest_command(result, cases)}")
    print_written_files(paths)
    if earlier_fit:
        print(f"replaced the earlier fit in {out}/: {earlier_fit}", file=sys.stderr)
        print("To keep several fits, write --out with another folder for each.", file=sys.stderr)
    removed = [name for name in earlier_names if not (out / name).exists()]
    if removed:
        print(f"removed files of an earlier fit from {out}/: {', '.join(removed)}", file=sys.stderr)


def _suggest_command(result: Fit, folders: list[Path]) -> str:
    """Return the next command: a fit with rubber if the model misfits without the stated tubes."""
    from pamjax.infer.fitting.report import exceeds_noise
    from pamjax.records.reading.muscle_toml import describe_unused_bladder

    paths = shlex.join(map(str, folders))
    has_misfit = any(
        exceeds_noise(noise) or not noise.is_known
        for case_fit in result.cases
        for noise in case_fit.noise.values()
    )
    lacks_rubber = has_misfit and all(
        describe_unused_bladder(case_fit.case.muscle_toml, result.mechanisms) for case_fit in result.cases
    )
    return f"fit {paths} --with bladder_elasticity" if lacks_rubber else f"diagnose {paths}"

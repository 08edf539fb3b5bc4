"""`pamjax fit`: calibrate a muscle on its recording."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Literal

from pamjax.cli.options import DEFAULT_MODEL, Json, ModelOptions
from pamjax.cli.screen import (
    REPORT_FILE,
    check_writable,
    format_command,
    print_json,
    print_text,
    print_written_files,
    show_progress,
)


def fit(
    cases: list[Path],
    /,
    *,
    out: Path = Path("out"),
    model: ModelOptions = DEFAULT_MODEL,
    loss: Literal["square", "soft"] = "square",
    starts: int = 4,
    folds: int = 5,
    seed: int = 0,
    figures: bool = True,
    report: bool = True,
    json: Json = False,
) -> None:
    """Calibrate a muscle on its recording, or several muscles together.

    Writes fit.json, a netCDF of prediction and residual, figures and report.html; prints a lab note.

    Args:
        cases: case folders, each with recording.csv and muscle.toml.
        out: folder to write to.
        loss: "soft" bounds the pull of a sample that is far off.
        starts: from how many places the minimiser starts.
        folds: into how many parts the blocks are dealt for the held-out score.
        seed: of the starts and the deal.
        figures: whether to draw.
        report: whether to write report.html, which opens in any browser.
        json: print fit.json instead of the note.
    """
    # A fit whose answer cannot be written is not begun.
    check_writable(out)
    parsed_cases = model.read_cases(cases)
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.infer.fitting.fit import fit as calibrate
    from pamjax.infer.fitting.io import build_fit_document, save

    keep_compiled()
    with show_progress(quiet=json) as progress:
        result = calibrate(
            parsed_cases,
            *model.fit_arguments,
            loss=loss,
            starts=starts,
            fold_count=folds,
            seed=seed,
            progress=progress,
        )
    written = save(result, out)
    if figures:
        from pamjax.view.figures.fit import save_fit_figures

        written += save_fit_figures(result, out)
    if report:
        from pamjax.view.reports.fit import write_fit_report

        written.append(write_fit_report(result, out / REPORT_FILE, format_command()))
    if json:
        print_json(build_fit_document(result))
    else:
        print_text(str(result))
        print_text(f"then: pamjax diagnose {shlex.join(map(str, cases))}")
    print_written_files(written)

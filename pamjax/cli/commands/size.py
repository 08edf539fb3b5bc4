"""`pamjax size`: design a muscle that satisfies a specification."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pamjax.cli.options import Json
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


def size(
    spec: Path,
    /,
    *,
    out: Path = Path("out"),
    starts: int = 8,
    method: Literal["slsqp", "trust-constr"] = "slsqp",
    seed: int = 0,
    stock: bool = True,
    report: bool = True,
    json: Json = False,
) -> None:
    """Design a muscle that satisfies a specification and has the smallest objective, for example mass.

    All requirements hold together with the probability of the specification, by default 0.9. The tube and the
    yarn have sizes that are sold; the report has a shopping list.
    Writes design.json, report.html and figures. If a muscle satisfies the specification, the command also
    writes model.json, an input of `pamjax simulate` and `pamjax inverse`, and muscle/muscle.toml, which
    excludes the rubber. Prints a summary. If no muscle satisfies the specification, the summary names the
    limiting requirements and by how much each must be relaxed.

    Args:
        spec: TOML file with requirements, space, supply, catalogue and objective.
        out: output folder.
        starts: number of starting points for each of the best combinations of threads and bladder.
        method: optimisation method; trust-constr also uses exact second derivatives and compiles longer.
        seed: random seed for the starting points and the probability draws.
        stock: use tubes and yarns of sizes that are sold; with --no-stock any diameter and wall.
        report: write report.html for a web browser, and the figures.
        json: print design.json instead of the summary.
    """
    check_writable(out)
    from pamjax.compile.jax_cache import keep_compiled

    keep_compiled()
    from pamjax.records.case import MUSCLE_FILE
    from pamjax.records.files import write_results_together
    from pamjax.sizing.io import build_design_document, save_design
    from pamjax.sizing.size import size as choose

    muscle_names = ["model.json", f"muscle/{MUSCLE_FILE}"]
    report_names = ["chart.png", "sensitivities.png", "front.png", REPORT_FILE]
    check_replaceable(out, ["design.json", *muscle_names, *(report_names if report else [])])
    with show_progress(quiet=json) as progress:
        design = choose(spec, starts=starts, method=method, seed=seed, stock=stock, progress=progress)
    with write_results_together(out) as folder:
        paths = save_design(design, folder)
        if report:
            from pamjax.view.figures.sizing import save_design_figures
            from pamjax.view.reports.sizing import write_design_report

            paths += save_design_figures(design, folder)
            paths.append(write_design_report(design, folder / REPORT_FILE, format_command()))
    paths = [out / path.relative_to(folder) for path in paths]
    if not design.feasible:
        # The muscle of an earlier, feasible spec does not belong to this design.
        for name in muscle_names:
            (out / name).unlink(missing_ok=True)
    print_json(build_design_document(design)) if json else print_text(str(design))
    print_written_files(paths)

"""`pamjax size`: the muscle that does what a spec wants."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pamjax.cli.options import Json
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
    report: bool = True,
    json: Json = False,
) -> None:
    """Choose a muscle: geometry and material that do what a spec wants, at the least of what it says.

    Writes design.json, report.html and figures, and of a muscle that was found model.json, which `pamjax
    simulate` and `inverse` take, and muscle/muscle.toml, what it is without its rubber; prints a lab note. A
    spec that cannot be met is an answer: what binds, and by how much it would have to give.

    Args:
        spec: a TOML file: what the muscle must do, the room, the supply, the catalogue, what to minimise.
        out: folder to write to.
        starts: searches of each of the best choices of threads and bladder.
        method: of the search; trust-constr also takes exact curvature, and compiles longer.
        seed: of the first look, and of the draws.
        report: whether to write the report and the figures.
        json: print design.json instead of the note.
    """
    check_writable(out)
    from pamjax.compile.jax_cache import keep_compiled

    keep_compiled()
    from pamjax.sizing.io import build_design_document, save_design
    from pamjax.sizing.size import size as choose

    with show_progress(quiet=json) as progress:
        design = choose(spec, starts=starts, method=method, seed=seed, progress=progress)
    written = save_design(design, out)
    if report:
        from pamjax.view.figures.sizing import save_design_figures
        from pamjax.view.reports.sizing import write_design_report

        written += save_design_figures(design, out)
        written.append(write_design_report(design, out / REPORT_FILE, format_command()))
    print_json(build_design_document(design)) if json else print_text(str(design))
    print_written_files(written)

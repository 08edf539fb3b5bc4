"""`pamjax fit`: calibrate a muscle on its recording."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Literal

from pamjax.cli.options import PLAIN, Json, Model
from pamjax.cli.screen import REPORT, command, say, say_json, say_written, working, writable


def fit(
    cases: list[Path],
    /,
    *,
    out: Path = Path("out"),
    model: Model = PLAIN,
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
    writable(out)
    read = model.read(cases)
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.infer.fitting.fit import fit as calibrate
    from pamjax.infer.fitting.io import as_dict, save

    keep_compiled()
    with working(quiet=json) as progress:
        found = calibrate(
            read,
            *model.asked,
            loss=loss,
            starts=starts,
            fold_count=folds,
            seed=seed,
            progress=progress,
        )
    written = save(found, out)
    if figures:
        from pamjax.view.figures.fit import save_figures

        written += save_figures(found, out)
    if report:
        from pamjax.view.reports.fit import save_report

        written.append(save_report(found, out / REPORT, command()))
    if json:
        say_json(as_dict(found))
    else:
        say(str(found))
        say(f"then: pamjax diagnose {shlex.join(map(str, cases))}")
    say_written(written)

"""Files of an earlier fit in the output folder of `pamjax fit`."""

from __future__ import annotations

import json
from pathlib import Path

from pamjax.cli.screen import REPORT_FILE


def list_earlier_files(folder: Path) -> list[str]:
    """Return the names of the files of an earlier fit in a folder; other files are not listed.

    Its fit.json has the names of its cases, which are parts of the names of its files. A report.html of
    another command is not listed.

    Args:
        folder: the output folder, which may not exist.
    """
    cases = _read_case_names(folder)
    if not cases:
        return []
    from pamjax.infer.fitting.io import list_result_names
    from pamjax.view.figures.fit import list_figure_names
    from pamjax.view.reports.fit import is_fit_report

    names = [*list_result_names(cases), *list_figure_names(cases)]
    reports = [REPORT_FILE] if is_fit_report(folder / REPORT_FILE) else []
    return [name for name in names if Path(name).name == name and (folder / name).is_file()] + reports


def _read_case_names(folder: Path) -> list[str]:
    """Return the names of the cases of the fit.json in a folder; empty if it has none."""
    from pamjax.infer.fitting.io import FIT_SCHEMA

    try:
        document = json.loads((folder / "fit.json").read_text("utf-8"))
    except (OSError, ValueError):
        return []
    is_fit = isinstance(document, dict) and document.get("schema") == FIT_SCHEMA
    cases = document.get("cases") if is_fit else None
    return list(cases) if isinstance(cases, dict) else []

"""Files of an earlier fit in the output folder of `pamjax fit`."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import Any

from pamjax.cli.screen import REPORT_FILE
from pamjax.errors import format_printable


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


def describe_earlier_fit(folder: Path) -> str:
    """Return the cases, the model and the time of the fit in a folder, in words; "" if it has none.

    Args:
        folder: the output folder, which may not exist.
    """
    document = _read_document(folder)
    if not document:
        return ""
    cases, mechanisms = ", ".join(document["cases"]), document.get("mechanisms")
    options = [f"--law {document['law']}"] if isinstance(document.get("law"), str) else []
    if isinstance(mechanisms, list) and mechanisms:
        options.append(f"--with {' '.join(map(str, mechanisms))}")
    if document.get("loss") == "soft":
        options.append("--loss soft")
    if any(case.get("form_errors") for case in document["cases"].values() if isinstance(case, dict)):
        options.append("--form-error")
    time = datetime.fromtimestamp((folder / "fit.json").stat().st_mtime)
    return format_printable(f"{' '.join([cases, *options])}, written {time:%Y-%m-%d %H:%M}")


def _read_case_names(folder: Path) -> list[str]:
    """Return the names of the cases of the fit.json in a folder; empty if it has none."""
    return list(_read_document(folder).get("cases", {}))


def _read_document(folder: Path) -> dict[str, Any]:
    """Return the fit.json in a folder if it has cases; else an empty dictionary."""
    from pamjax.infer.fitting.io import FIT_SCHEMA

    try:
        document = json.loads((folder / "fit.json").read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    is_fit = isinstance(document, dict) and document.get("schema") == FIT_SCHEMA
    return document if is_fit and isinstance(document.get("cases"), dict) else {}

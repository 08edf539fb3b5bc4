"""Protection of the user's files in an output folder: a command replaces only files that pamjax wrote."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Sequence
from pathlib import Path

from pamjax.errors import BadInput

#: First characters of the trials of `pamjax prove`, a part of each report, and an array of each table for a
#: controller.
_TRIALS_START, _REPORT_PART, _TABLE_ARRAY = '{"stage": "', '<p class="kicker">', "error_force.npy"


def check_replaceable(folder: Path, names: Sequence[str], label: str = "`--out`") -> None:
    """Refuse an output folder in which a command would replace a file that pamjax did not write.

    Call it before the computation. If the folder has the first file as pamjax writes it, figures and tables
    are from an earlier run. A page shows itself whether pamjax wrote it.

    Args:
        folder: the output folder, which need not exist.
        names: names of the files that the command can write; the first one identifies its results.
        label: the option that sets the folder.

    Raises:
        BadInput: with the first of these files.
    """
    has_results = _is_own(folder / names[0])
    for file in (folder / name for name in names):
        if has_results and file.suffix != ".html":
            continue
        if file.exists() and not _is_own(file):
            rule = "a command must replace only files that pamjax wrote"
            remedy = f"Write {label} with another folder, or rename the file."
            raise BadInput.from_rule(rule, f"{file}, which is another file", remedy=remedy)


def _is_own(file: Path) -> bool:
    """Return whether a file has the form in which pamjax writes it; False for figures and tables of text."""
    try:
        if file.suffix == ".npz":
            with zipfile.ZipFile(file) as archive:
                return _TABLE_ARRAY in archive.namelist()
        if not file.stat().st_size:
            # A run that was killed can leave an empty list of trials.
            return file.suffix == ".jsonl"
        text = file.read_text("utf-8") if file.suffix in (".json", ".jsonl", ".html") else ""
        if file.suffix == ".json":
            document = json.loads(text)
            schema = document.get("schema") if isinstance(document, dict) else None
            return isinstance(schema, str) and schema.startswith("pamjax.")
    except (OSError, ValueError, zipfile.BadZipFile):
        return False
    return text.startswith(_TRIALS_START) if file.suffix == ".jsonl" else _REPORT_PART in text

"""A table of readings of another laboratory: its reader, and the command line of the scripts that use it."""

from __future__ import annotations

import argparse
import hashlib
import io
from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from pamjax.errors import BadInput
from pamjax.records.files import read_bytes


def read_source_table(file: Path, columns: Sequence[str], text: str, rule: str) -> tuple[pd.DataFrame, str]:
    """Return the table of a source and its SHA-256.

    Args:
        file: the CSV file.
        columns: names of its columns.
        text: name of the column of text; the others are numbers.
        rule: what each row needs, for the message.

    Raises:
        BadInput: if it cannot be read, has other columns, or a value is missing or no number.
    """
    raw = read_bytes(file)
    remedy = f"Use the table of the source, with the columns {', '.join(columns)}."
    try:
        table = pd.read_csv(io.BytesIO(raw), encoding_errors="replace")
    except (pd.errors.EmptyDataError, pd.errors.ParserError) as error:
        raise BadInput.from_rule("no table with columns", str(error).strip(), file.name, remedy) from error
    if list(table.columns) != list(columns):
        raise BadInput.from_rule("unknown columns", ", ".join(map(str, table.columns)), file.name, remedy)
    numbers = table.drop(columns=text).apply(pd.to_numeric, errors="coerce")
    if wrong := [f"line {row + 2}" for row in table.index[numbers.isna().any(axis=1)]]:
        raise BadInput.from_rule(rule, ", ".join(wrong), file.name, "Correct these lines.")
    return numbers.assign(**{text: table[text].astype(object).fillna("").astype(str)}), hashlib.sha256(
        raw
    ).hexdigest()


def write_case_files(case: Path, recording: pd.DataFrame, muscle: str) -> Path:
    """Write recording.csv and muscle.toml to a case folder, and return the folder."""
    case.mkdir(parents=True, exist_ok=True)
    recording.to_csv(case / "recording.csv", index=False, lineterminator="\n")
    (case / "muscle.toml").write_text(muscle, encoding="utf-8", newline="\n")
    return case


def build_parser(description: str | None, out: str) -> argparse.ArgumentParser:
    """Return a parser for the table and the folder of the results, `out` unless stated."""
    style = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=description, formatter_class=style)
    parser.add_argument("table", type=Path, help="the table of the source")
    parser.add_argument("--out", type=Path, default=Path(out), help="folder for the results")
    return parser


def run_build(
    parser: argparse.ArgumentParser,
    build_cases: Callable[[Path, Path], list[Path]],
    arguments: list[str] | None,
) -> argparse.Namespace:
    """Write the case folders of the table that the arguments name, and return the options.

    The options get `folders`, the case folders. A wrong table ends the program with one message.
    """
    options = parser.parse_args(arguments)
    try:
        options.folders = build_cases(options.table, options.out)
    except BadInput as error:
        parser.error(str(error))
    return options

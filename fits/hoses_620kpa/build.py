"""Case folders of the hand readings of force against length at 620 kPa.

python fits/hoses_620kpa/build.py TABLE.csv --out out/hoses_620kpa

TABLE.csv has the columns `lrest_mm`, `length_mm`, `force_N`, `pressure_kPa` and `note` (README: its source).
Each rest length, with and without a tendon in series, is one case. `muscle.toml` states the assumed
dimensions, the source and the checksum of the table.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import re
from pathlib import Path

import pandas as pd

from pamjax.errors import BadInput
from pamjax.records.files import read_bytes

#: Columns of the table.
COLUMNS = ["lrest_mm", "length_mm", "force_N", "pressure_kPa", "note"]

#: Bore, wall, mm, and angle of the threads to the axis, deg: Martens & Boblan 2017, same hose.
BORE, WALL, ANGLE_TO_AXIS = 10.0, 1.8, 28.6

MUSCLE = """\
# Source: github.com/Agile-and-Adaptive-Robotics/Muscle_Sensory, straight force test at 620 kPa.
# Hand readings. No licence is stated. Table: {file}, SHA-256 {checksum}.
# Measured: rest length, length, force and pressure. The dimensions are assumed.

[muscle]
name = "{name}"
rest_length = {{value = "{length:g} mm", sd = "1 mm"}}
diameter = {{value = "{diameter:g} mm", sd = "0.9 mm"}}        # mid-wall: the threads lie inside the rubber
braid_angle = {{value = "{angle:g} deg", sd = "1 deg"}}     # from the circumference
fitting_diameter = {{value = "{diameter:g} mm", sd = "1.2 mm"}}

[bladder]
inner_diameter = {{value = "{inner:g} mm", sd = "0.9 mm"}}   # a tube of 10 mm does not fit inside its threads
thickness = "{wall:g} mm"

[sensors]
length = "1 mm"

[baseline]
model = "inelastic"
"""


def read_table(file: Path) -> tuple[pd.DataFrame, str]:
    """Return the table of the source and its SHA-256.

    Raises:
        BadInput: if it cannot be read, has other columns, or a value is missing or no number.
    """
    raw = read_bytes(file)
    remedy = f"Use the table of the source, with the columns {', '.join(COLUMNS)}."
    try:
        table = pd.read_csv(io.BytesIO(raw), encoding_errors="replace")
    except (pd.errors.EmptyDataError, pd.errors.ParserError) as error:
        raise BadInput.from_rule("no table with columns", str(error).strip(), file.name, remedy) from error
    if list(table.columns) != COLUMNS:
        raise BadInput.from_rule("unknown columns", ", ".join(map(str, table.columns)), file.name, remedy)
    numbers = table[COLUMNS[:-1]].apply(pd.to_numeric, errors="coerce")
    if wrong := [f"line {row + 2}" for row in table.index[numbers.isna().any(axis=1)]]:
        rule = "each row needs rest length, length, force and pressure"
        raise BadInput.from_rule(rule, ", ".join(wrong), file.name, "Correct these lines.")
    notes = table["note"].fillna("").astype(str)
    return numbers.assign(note=notes), hashlib.sha256(raw).hexdigest()


def write_cases(table: pd.DataFrame, folder: Path, file: str = "", checksum: str = "") -> list[Path]:
    """Write a case folder for each rest length and tendon, and return the folders.

    Args:
        table: the columns of the source.
        folder: folder of the case folders.
        file, checksum: name and SHA-256 of the table.
    """
    folders = []
    for (length, note), rows in table.groupby(["lrest_mm", "note"], sort=True):
        tendon = note.partition(" tendon")[0]
        suffix = re.sub(r"\W+", "-", f"-{tendon}").rstrip("-")
        case = folder / f"hose-{length:g}{suffix}"
        case.mkdir(parents=True, exist_ok=True)
        recording = rows[["pressure_kPa", "length_mm", "force_N"]]
        recording.columns = ["pressure [kPa]", "length [mm]", "force [N]"]
        recording.to_csv(case / "recording.csv", index=False, lineterminator="\n")
        muscle = MUSCLE.format(
            file=file,
            checksum=checksum,
            name=f"fluidic muscle hose, {length:g} mm, " + (f"{tendon} tendon" if tendon else "no tendon"),
            length=length,
            diameter=BORE + WALL,
            angle=90 - ANGLE_TO_AXIS,
            inner=BORE - WALL,
            wall=WALL,
        )
        (case / "muscle.toml").write_text(muscle, encoding="utf-8", newline="\n")
        folders.append(case)
    return folders


def build_cases(file: Path, folder: Path) -> list[Path]:
    """Write the case folders of a table, and return them.

    Raises:
        BadInput: for a wrong table.
    """
    table, checksum = read_table(file)
    return write_cases(table, folder, file.name, checksum)


def build_parser(description: str | None) -> argparse.ArgumentParser:
    """Return a parser for the table and the folder of the results."""
    style = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=description, formatter_class=style)
    parser.add_argument("table", type=Path, help="the table of the source")
    parser.add_argument("--out", type=Path, default=Path("out/hoses_620kpa"), help="folder for the results")
    return parser


def main(arguments: list[str] | None = None) -> None:
    parser = build_parser(__doc__)
    options = parser.parse_args(arguments)
    try:
        folders = build_cases(options.table, options.out)
    except BadInput as error:
        parser.error(str(error))
    for folder in folders:
        print(f"wrote {folder}")


if __name__ == "__main__":
    main()

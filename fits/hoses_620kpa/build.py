"""Case folders of the hand readings of force against length at 620 kPa.

python fits/hoses_620kpa/build.py TABLE.csv --out out/hoses_620kpa

TABLE.csv has the columns `lrest_mm`, `length_mm`, `force_N`, `pressure_kPa` and `note` (README: its source).
Each rest length, with and without a tendon in series, is one case. `muscle.toml` states the assumed
dimensions, the source and the checksum of the table.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pandas as pd

# The checkout, in which `fits` is a package.
sys.path.insert(0, str(Path(__file__).parents[2]))
from fits.source_table import build_parser, read_source_table, run_build, write_case_files

#: Folder of the results.
DEFAULT_OUT = "out/hoses_620kpa"

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
        recording = rows[["pressure_kPa", "length_mm", "force_N"]]
        recording.columns = ["pressure [kPa]", "length [mm]", "force [N]"]
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
        folders.append(write_case_files(folder / f"hose-{length:g}{suffix}", recording, muscle))
    return folders


def build_cases(file: Path, folder: Path) -> list[Path]:
    """Write the case folders of a table, and return them.

    Raises:
        BadInput: for a wrong table.
    """
    table, checksum = read_source_table(
        file, COLUMNS, text="note", rule="each row needs rest length, length, force and pressure"
    )
    return write_cases(table, folder, file.name, checksum)


def main(arguments: list[str] | None = None) -> None:
    parser = build_parser(__doc__, DEFAULT_OUT)
    for folder in run_build(parser, build_cases, arguments).folders:
        print(f"wrote {folder}")


if __name__ == "__main__":
    main()

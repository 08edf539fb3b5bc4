"""Case folders of free contractions of hand-made muscles: length against pressure without load.

python fits/free_contraction/build.py TABLE.csv --out out/free_contraction

TABLE.csv has the columns `set`, `pressure_psi`, `pressure_kPa` and `length_m` (README: its source). Each set
is one case. `muscle.toml` states the assumed dimensions, the source and the checksum of the table.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from pamjax.errors import BadInput

# The checkout, in which `fits` is a package.
sys.path.insert(0, str(Path(__file__).parents[2]))
from fits.source_table import build_parser, read_source_table, run_build, write_case_files

#: Folder of the results.
DEFAULT_OUT = "out/free_contraction"

#: Columns of the table.
COLUMNS = ["set", "pressure_psi", "pressure_kPa", "length_m"]

MUSCLE = """\
# Source: github.com/wfan19/continuum_mocap, free contraction of hand-made muscles.
# No licence is stated. Table: {file}, SHA-256 {checksum}.
# Measured: length and pressure. The dimensions are assumed.

[muscle]
name = "{name}"
rest_length = {{value = "{length:.1f} mm", sd = "2 mm"}}     # the length without pressure
diameter = {{value = "15 mm", sd = "3 mm"}}
fitting_diameter = {{value = "15 mm", sd = "3 mm"}}
braid_angle = {{value = "62 deg", sd = "5 deg"}}       # from the circumference

[bladder]
inner_diameter = {{value = "10 mm", sd = "2 mm"}}
thickness = {{value = "1.6 mm", sd = "0.4 mm"}}

[test]
measured = "length"                                  # no load
load = "0 N"

[sensors]
length = "1 mm"

[baseline]
model = "inelastic"
"""


def write_cases(table: pd.DataFrame, folder: Path, file: str = "", checksum: str = "") -> list[Path]:
    """Write a case folder for each set, and return the folders.

    Args:
        table: the columns of the source.
        folder: folder of the case folders.
        file, checksum: name and SHA-256 of the table.
    """
    folders = []
    for name, rows in table.groupby("set", sort=False):
        recording = pd.DataFrame(
            {"pressure [kPa]": rows["pressure_kPa"], "length [mm]": (1e3 * rows["length_m"]).round(3)}
        )
        muscle = MUSCLE.format(
            file=file,
            checksum=checksum,
            name=f"hand-made muscle, set {name}",
            length=1e3 * rows.loc[rows["pressure_kPa"].idxmin(), "length_m"],
        )
        folders.append(write_case_files(folder / str(name), recording, muscle))
    return folders


def build_cases(file: Path, folder: Path) -> list[Path]:
    """Write the case folders of a table, and return them.

    Raises:
        BadInput: for a wrong table.
    """
    table, checksum = read_source_table(
        file, COLUMNS, text="set", rule="each row needs a set, pressures and a length"
    )
    if unnamed := [f"line {row + 2}" for row in table.index[table["set"] == ""]]:
        rule = "each row needs the name of its set"
        raise BadInput.from_rule(rule, ", ".join(unnamed), file.name, "Correct these lines.")
    return write_cases(table, folder, file.name, checksum)


def main(arguments: list[str] | None = None) -> None:
    parser = build_parser(__doc__, DEFAULT_OUT)
    for folder in run_build(parser, build_cases, arguments).folders:
        print(f"wrote {folder}")


if __name__ == "__main__":
    main()

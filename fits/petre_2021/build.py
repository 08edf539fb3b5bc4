"""Build the case folder of the free contraction of Petre (2021) from the shipped table.

Run `python fits/petre_2021/build.py` after a change here or in the table. A test compares the committed
folder with the output of this script.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pamjax.records.shipped_tables import read_shipped

HERE = Path(__file__).parent

#: Assumed length at rest, mm, and nominal time between two readings, s.
REST_LENGTH, STEP = 70.0, 10.0

MUSCLE = """\
[muscle]
name = "small fluidic muscle, Petre (2021)"
rest_length = "70 mm"                                 # assumed; only the contraction was measured
diameter = {value = "11.8 mm", sd = "1.5 mm"}         # assumed: bore 10 mm, threads mid-wall
braid_angle = {value = "61.4 deg", sd = "1.5 deg"}    # assumed, from the circumference

[bladder]
inner_diameter = {value = "10 mm", sd = "1 mm"}       # assumed
thickness = {value = "1.8 mm", sd = "0.3 mm"}         # assumed

[test]
measured = "length"                                   # no load: the force is set to zero
load = "0 N"

[baseline]
model = "inelastic"
"""


def format_recording(table: pd.DataFrame) -> str:
    """Return the five runs as one recording; the times are nominal."""
    n = len(table)
    recording = pd.DataFrame(
        {
            "time [s]": STEP * np.arange(n),
            "pressure [bar]": table["pressure [bar]"],
            "length [mm]": (REST_LENGTH - table["contraction [mm]"]).round(2),
            "cycle": table["run [1]"].astype(int),
        }
    )
    return recording.to_csv(index=False, lineterminator="\n")


def build_files() -> dict[str, str]:
    """Return the text of every file of the case folder, by its path below this folder."""
    return {
        "zero-load/recording.csv": format_recording(read_shipped("petre_2021/zero-load")),
        "zero-load/muscle.toml": MUSCLE,
    }


if __name__ == "__main__":
    for path, text in build_files().items():
        (HERE / path).parent.mkdir(exist_ok=True)
        (HERE / path).write_text(text, encoding="utf-8", newline="\n")

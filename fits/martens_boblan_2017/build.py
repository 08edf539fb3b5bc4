"""Build the case folders of the two force maps of Martens & Boblan (2017) from the shipped tables.

Run `python fits/martens_boblan_2017/build.py` after a change here or in the tables. A test compares the
committed folders with the output of this script.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from pamjax.records.shipped_tables import read_shipped

HERE = Path(__file__).parent

#: Wall of the hose, mm, and angle of its threads to the axis, deg: Martens & Boblan, same article.
WALL, ANGLE_TO_AXIS = 1.8, 28.6

#: Bore and length at rest of each muscle, mm. The rest lengths are inferred, see the README.
MUSCLES = {"dmsp-10-250": (10, 250), "dmsp-20-300": (20, 296)}

MUSCLE = """\
[muscle]
name = "{name}"
rest_length = {{value = "{length} mm", sd = "1 mm"}}
diameter = {{value = "{diameter:.1f} mm", sd = "0.9 mm"}}        # mid-wall: the threads lie inside the rubber
braid_angle = {{value = "{angle:.1f} deg", sd = "1 deg"}}     # from the circumference

[bladder]
inner_diameter = "{bore} mm"
thickness = "{wall} mm"

[baseline]
model = "inelastic"
"""


def format_recording(table: pd.DataFrame) -> str:
    """Return the map as a recording; a force of 0 means a slack muscle, so its cell is blank."""
    force = table["force [N]"]
    return table.assign(**{"force [N]": force.where(force > 0)}).to_csv(index=False, lineterminator="\n")


def format_muscle(name: str) -> str:
    """Return the text of muscle.toml, from bore, wall and thread angle."""
    bore, length = MUSCLES[name]
    return MUSCLE.format(
        name=f"Festo {name.upper()}",
        length=length,
        bore=bore,
        wall=WALL,
        diameter=bore + WALL,
        angle=90 - ANGLE_TO_AXIS,
    )


def build_files() -> dict[str, str]:
    """Return the text of every file of the case folders, by its path below this folder."""
    files = {}
    for name in MUSCLES:
        files[f"{name}/recording.csv"] = format_recording(read_shipped(f"martens_boblan_2017/{name}"))
        files[f"{name}/muscle.toml"] = format_muscle(name)
    return files


if __name__ == "__main__":
    for path, text in build_files().items():
        (HERE / path).parent.mkdir(exist_ok=True)
        (HERE / path).write_text(text, encoding="utf-8", newline="\n")

"""Build the case folder of the Kevlar muscle of Chambers & Wereley (2022) from the shipped tables.

Run `python fits/chambers_wereley_2022/build.py` after a change here or in the tables. A test compares the
committed files with the output of this script.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from pamjax.records.shipped_tables import read_shipped

HERE = Path(__file__).parent
ARTICLE = "chambers_wereley_2022"

MUSCLE = """\
[muscle]
name = "22.2 mm Kevlar"
rest_length = "{rest_length}"
length = "{rest_length}"          # every diameter was read at rest length
threads = {threads}                  # both families together
thread_area = "{thread_area}"
thread_length = {{value = "{thread_length}", sd = "{thread_length_sd}"}}     # ruler, 1/32 in
turns = {{value = {turns}, sd = {turns_sd}}}

[thread]
modulus = {{value = "{modulus_cited}", sd = "20 GPa"}}     # maker's guide; sd assumed

[baseline]
model = "elastic"
"""


def format_recording() -> str:
    """Return the measured rows of Table 1, without the extrapolated row at 0 kPa."""
    table = read_shipped(f"{ARTICLE}/table1")
    measured = table.loc[table["read"] == "measured", ["pressure [kPa]", "diameter [mm]"]]
    return measured.to_csv(index=False, lineterminator="\n")


def format_muscle() -> str:
    """Return the text of muscle.toml, with each number in its printed unit."""
    stated = read_shipped(f"{ARTICLE}/materials").set_index("quantity")
    words = {}
    for name, row in stated.iterrows():
        unit = "" if row["unit"] == "1" else f" {row['unit']}"
        words[name] = _format_number(row["value"]) + unit
        if pd.notna(row["tolerance"]):
            words[f"{name}_sd"] = _format_number(row["tolerance"]) + unit
    return MUSCLE.format(**words)


def _format_number(value: float) -> str:
    return f"{value:.10g}"


def build_files() -> dict[str, str]:
    """Return the text of every file of the case folder, by name."""
    return {"recording.csv": format_recording(), "muscle.toml": format_muscle()}


if __name__ == "__main__":
    for name, text in build_files().items():
        (HERE / name).write_text(text, encoding="utf-8", newline="\n")

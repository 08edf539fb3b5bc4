"""The article reproduced: Tables 1 and 2, five figures, and the threads calibrated on Table 1.

python fits/chambers_wereley_2022/case.py --out out/chambers_wereley_2022
"""

from __future__ import annotations

import argparse
from pathlib import Path

import figures
import pandas as pd
import tables as t
from rich.console import Console
from rich.table import Table

from pamjax.infer.fit import fit
from pamjax.records.case import read_case
from pamjax.view.theme import theme

HERE = Path(__file__).parent


def lines(title: str, frame: pd.DataFrame, note: str = "") -> Table:
    """A table for the terminal, with a column's unit on its own line."""
    shown = Table(title=title, title_justify="left", caption=note, caption_justify="left")
    for name in frame.columns:
        shown.add_column(name.replace("_", " ").replace(" [", "\n\\["), justify="right")
    for row in frame.itertuples(index=False):
        shown.add_row(*(f"{value:.2f}" if isinstance(value, float) else str(value) for value in row))
    return shown


def calibrated(show: Console, laws: tuple[str, ...] = ("elastic", "toe", "exponential-toe")):
    """Fit each law to the case folder and print its note and its moduli; returns the first muscle."""
    case = read_case(HERE)
    results = [fit(case, law=law) for law in laws]
    for result in results:
        low, high = t.law_slopes(result.muscle).items()
        show.print(
            f"{result}\n  modulus {low[1]:.0f} GPa at {low[0]}, {high[1]:.0f} GPa at {high[0]}\n",
            highlight=False,
        )
    return results[0].muscle


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/chambers_wereley_2022"), help="folder for the figures"
    )
    out = parser.parse_args(arguments).out
    show = Console()
    if not show.is_terminal:
        show.width = 170
    force, reference = t.found()[0]
    note = f"found from the cells: blocked force {force:.1f} N, reference thread {1e3 * reference:.3f} mm"
    show.print(lines("Table 1, printed and computed", t.table1()))
    show.print(lines("Straight lines through Table 1", t.slopes().rename_axis("rows").reset_index()))
    show.print(lines("Cells of Table 2, of 36, by how it may have been computed", t.counts()))
    show.print(lines("Table 2 as the article computed it: printed | computed", t.side_by_side(), note))
    show.print(lines("Table 2 in balance: each material under its own force", t.table2()))
    muscle = calibrated(show)
    with theme():
        for path in figures.draw(out, muscle):
            show.print(path, highlight=False)


if __name__ == "__main__":
    main()

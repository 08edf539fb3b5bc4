"""The article reproduced: Tables 1 and 2, five figures, and the threads calibrated on Table 1.

python fits/chambers_wereley_2022/case.py --out out/chambers_wereley_2022
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import figures
import pandas as pd
import tables as t
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pamjax.infer.fitting.fit import fit
from pamjax.records.case import read_case
from pamjax.view.theme import theme

HERE = Path(__file__).parent
#: Share of a terminal that the names of the rows may take.
NAMES = 0.4


def lines(title: str, frame: pd.DataFrame, width: int, note: str = "") -> list[Table]:
    """A table for the terminal, in as many parts as keep every number whole; each begins with the names.

    Args:
        width: of the terminal, letters.
    """
    cells = frame.map(lambda value: f"{value:.2f}" if isinstance(value, float) else str(value))
    heads = [name.replace("_", " ").replace(" [", "\n[") for name in frame.columns]
    wide = [_least(head, cells.iloc[:, k]) for k, head in enumerate(heads)]
    # Names may take a second line; numbers may not.
    wide[0] = min(wide[0], int(NAMES * width))
    parts = list(_parts(wide, width))
    return [
        _table(
            title if k == 0 else f"{title} (continued)",
            cells.iloc[:, part],
            [(heads[j], wide[j]) for j in part],
            note if k == len(parts) - 1 else "",
        )
        for k, part in enumerate(parts)
    ]


def _least(head: str, cells: pd.Series) -> int:
    """Letters without which a column would cut a number, or a word of its head."""
    return max(len(text) for text in [*head.split(), *cells])


def _parts(wide: list[int], width: int) -> Iterator[list[int]]:
    """Columns that fit side by side, the first in each; a column has two blanks and a line besides."""
    part, used = [0], wide[0] + 4
    for k in range(1, len(wide)):
        if used + wide[k] + 3 > width and len(part) > 1:
            yield part
            part, used = [0], wide[0] + 4
        part.append(k)
        used += wide[k] + 3
    yield part


def _table(title: str, cells: pd.DataFrame, heads: list[tuple[str, int]], note: str) -> Table:
    """One part, with a column's unit on its own line."""
    shown = Table(title=title, title_justify="left", caption=note, caption_justify="left")
    for head, wide in heads:
        shown.add_column(escape(head), justify="right", width=wide)
    for row in cells.itertuples(index=False):
        shown.add_row(*map(escape, row))
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
    for title, frame, below in (
        ("Table 1, printed and computed", t.table1(), ""),
        ("Straight lines through Table 1", t.slopes().rename_axis("rows").reset_index(), ""),
        ("Cells of Table 2, of 36, by how it may have been computed", t.counts(), ""),
        ("Table 2 as the article computed it: printed | computed", t.side_by_side(), note),
        ("Table 2 in balance: each material under its own force", t.table2(), ""),
    ):
        show.print(*lines(title, frame, show.width, below), sep="\n")
    muscle = calibrated(show)
    with theme():
        for path in figures.draw(out, muscle):
            show.print(path, highlight=False)


if __name__ == "__main__":
    main()

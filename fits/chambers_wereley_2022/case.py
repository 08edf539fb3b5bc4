"""Reproduction of the article: Tables 1 and 2, five figures, and the threads fitted to Table 1.

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
from pamjax.view.theme import apply_theme

HERE = Path(__file__).parent
#: Largest share of the terminal width for the names of the rows.
NAMES = 0.4


def split_table(title: str, frame: pd.DataFrame, width: int, note: str = "") -> list[Table]:
    """Return a table for the terminal, split into parts so that no number is cut.

    Each part begins with the names of the rows.

    Args:
        width: of the terminal, characters.
    """
    cells = frame.map(lambda value: f"{value:.2f}" if isinstance(value, float) else str(value))
    heads = [name.replace("_", " ").replace(" [", "\n[") for name in frame.columns]
    wide = [_minimum_width(head, cells.iloc[:, k]) for k, head in enumerate(heads)]
    # Names may be wrapped; numbers may not.
    wide[0] = min(wide[0], int(NAMES * width))
    parts = list(_split_columns(wide, width))
    return [
        _build_part(
            title if k == 0 else f"{title} (continued)",
            cells.iloc[:, part],
            [(heads[j], wide[j]) for j in part],
            note if k == len(parts) - 1 else "",
        )
        for k, part in enumerate(parts)
    ]


def _minimum_width(head: str, cells: pd.Series) -> int:
    """Return the characters that a column needs for its longest number or word of its head."""
    return max(len(text) for text in [*head.split(), *cells])


def _split_columns(wide: list[int], width: int) -> Iterator[list[int]]:
    """Yield the columns of each part; the first column is in every part, a column adds 3 characters."""
    part, used = [0], wide[0] + 4
    for k in range(1, len(wide)):
        if used + wide[k] + 3 > width and len(part) > 1:
            yield part
            part, used = [0], wide[0] + 4
        part.append(k)
        used += wide[k] + 3
    yield part


def _build_part(title: str, cells: pd.DataFrame, heads: list[tuple[str, int]], note: str) -> Table:
    """Return one part, with the unit of a column on its own line."""
    shown = Table(title=title, title_justify="left", caption=note, caption_justify="left")
    for head, wide in heads:
        shown.add_column(escape(head), justify="right", width=wide)
    for row in cells.itertuples(index=False):
        shown.add_row(*map(escape, row))
    return shown


def fit_laws(show: Console, laws: tuple[str, ...] = ("elastic", "toe", "exponential-toe")):
    """Fit each thread law to the case, print the report and the moduli, and return the first muscle."""
    case = read_case(HERE)
    results = [fit(case, law=law) for law in laws]
    for result in results:
        low, high = t.compute_law_slopes(result.muscle).items()
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
    force, reference = t.fit_force_and_reference()[0]
    note = f"fitted to the cells: blocked force {force:.1f} N, reference thread {1e3 * reference:.3f} mm"
    for title, frame, below in (
        ("Table 1, printed and computed", t.compute_table1(), ""),
        ("Straight lines through Table 1", t.fit_slopes().rename_axis("rows").reset_index(), ""),
        ("Cells of Table 2, of 36, by how it may have been computed", t.tabulate_agreement(), ""),
        ("Table 2 as the article computed it: printed | computed", t.tabulate_side_by_side(), note),
        ("Table 2 in balance: each material under its own force", t.compute_table2(), ""),
    ):
        show.print(*split_table(title, frame, show.width, below), sep="\n")
    muscle = fit_laws(show)
    with apply_theme():
        for path in figures.draw_figures(out, muscle):
            show.print(path, highlight=False)


if __name__ == "__main__":
    main()

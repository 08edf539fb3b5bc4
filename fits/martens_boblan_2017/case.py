"""Two factory fluidic muscles: the bare braid fitted, and beside Gaylord and Sárosi with lengths held out.

python fits/martens_boblan_2017/case.py --out out/martens_boblan_2017

prints the fits and the comparison of both maps and draws the figures. `--write` renews expected.json, against
which a test holds the comparison.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from build import MUSCLES

from fits.comparison import THREADS, Comparison, compare
from pamjax.compile.jax_cache import keep_compiled
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.result import Fit
from pamjax.records.case import read_case
from pamjax.view.figures.fit import save_figures

HERE = Path(__file__).parent


def compared(name: str) -> tuple[list[Fit], Comparison]:
    """Both kinds of threads fitted to a map, and their scores beside the rivals'."""
    case = read_case(HERE / name)
    fits = [fit(case, law) for law in THREADS]
    return fits, compare(case, fits)


def main(arguments: list[str] | None = None) -> None:
    style = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=style)
    parser.add_argument(
        "--out", type=Path, default=Path("out/martens_boblan_2017"), help="folder for the figures"
    )
    parser.add_argument("--write", action="store_true", help="renew expected.json")
    asked = parser.parse_args(arguments)
    keep_compiled()
    expected = {}
    for name in MUSCLES:
        fits, found = compared(name)
        for one in fits:
            print(one, end="\n\n")
            save_figures(one, asked.out / name / one.law)
        print(found, end="\n\n")
        expected[name] = found.as_dict()["rmse_N"]
    if asked.write:
        rounded = json.loads(json.dumps(expected), parse_float=lambda number: float(f"{float(number):.4g}"))
        text = json.dumps(rounded, indent=2, ensure_ascii=False, allow_nan=False)
        (HERE / "expected.json").write_text(text + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()

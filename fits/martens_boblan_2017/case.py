"""Two factory muscles: the bare braid compared with the formulas of Gaylord and Sárosi, lengths held out.

python fits/martens_boblan_2017/case.py --out out/martens_boblan_2017

prints the fits and the comparison of both maps and draws the figures. `--write` writes the scores to
expected.json, with which a test compares them.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from build import MUSCLES

from pamjax.compile.jax_cache import keep_compiled
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.result import Fit
from pamjax.records.case import read_case
from pamjax.view.figures.fit import save_fit_figures

# The checkout, in which `fits` is a package.
sys.path.insert(0, str(Path(__file__).parents[2]))
from fits.comparison import THREADS, Comparison, compare

HERE = Path(__file__).parent


def compare_map(name: str) -> tuple[list[Fit], Comparison]:
    """Return the fits of a map with each thread law, and their comparison with the formulas."""
    case = read_case(HERE / name)
    fits = [fit(case, law) for law in THREADS]
    return fits, compare(case, fits)


def main(arguments: list[str] | None = None) -> None:
    style = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=style)
    parser.add_argument(
        "--out", type=Path, default=Path("out/martens_boblan_2017"), help="folder for the figures"
    )
    parser.add_argument("--write", action="store_true", help="write the scores to expected.json")
    options = parser.parse_args(arguments)
    keep_compiled()
    expected = {}
    for name in MUSCLES:
        fits, comparison = compare_map(name)
        for result in fits:
            print(result, end="\n\n")
            save_fit_figures(result, options.out / name / result.law)
        print(comparison, end="\n\n")
        expected[name] = comparison.as_dict()["rmse_N"]
    if options.write:
        rounded = json.loads(json.dumps(expected), parse_float=lambda number: float(f"{float(number):.4g}"))
        text = json.dumps(rounded, indent=2, ensure_ascii=False, allow_nan=False)
        (HERE / "expected.json").write_text(text + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()

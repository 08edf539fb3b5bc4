"""Hoses: the bare braid compared with the formulas of Gaylord and Sárosi, with whole lengths held out.

python fits/portland_hose/compare_models.py FOLDER_WITH_CASES --out out/portland_hose

reads each case folder in FOLDER_WITH_CASES (README: how to make them), fits the braid with inelastic and
with elastic threads, draws the figures of each fit, prints the tables and writes comparison.json.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from command_line import build_parser, list_cases

from pamjax.compile.jax_cache import keep_compiled
from pamjax.infer.fitting.fit import fit
from pamjax.records.case import read_case
from pamjax.view.figures.fit import save_fit_figures

# The checkout, in which `fits` is a package.
sys.path.insert(0, str(Path(__file__).parents[2]))
from fits.comparison import THREADS, Comparison, compare


def compare_case(folder: Path, out: Path) -> Comparison:
    """Return the scores of one case; print its checks and fits, and save the figures.

    Args:
        folder: the case.
        out: folder for the figures.
    """
    case = read_case(folder)
    print(case, end="\n\n")
    fits = [fit(case, law) for law in THREADS]
    for result in fits:
        print(result, end="\n\n")
        save_fit_figures(result, out / case.name / result.law)
    comparison = compare(case, fits)
    print(comparison, end="\n\n")
    return comparison


def format_table(comparisons: list[Comparison], split: str) -> str:
    """Return one split of all cases as Markdown."""
    models = list(comparisons[0].scores)
    lines = [f"| {split} | " + " | ".join(models) + " |", "|---" * (len(models) + 1) + "|"]
    for comparison in comparisons:
        cells = (f"{comparison.rmse(model, split):.3g}".replace("nan", "–") for model in models)
        lines.append(f"| {comparison.case} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    parser = build_parser(__doc__)
    options = parser.parse_args(arguments)
    folders = list_cases(options.cases)
    if not folders:
        parser.error(
            f"no case folder in {options.cases}. A case folder contains muscle.toml and recording.csv."
        )
    keep_compiled()
    comparisons = [compare_case(folder, options.out) for folder in folders]
    for split in comparisons[0].scores["Gaylord"]:
        print(f"rmse of force [N]\n\n{format_table(comparisons, split)}\n")
    options.out.mkdir(parents=True, exist_ok=True)
    report = json.dumps([one.as_dict() for one in comparisons], indent=2, allow_nan=False)
    (options.out / "comparison.json").write_text(report + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

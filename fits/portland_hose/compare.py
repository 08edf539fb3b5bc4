"""Fluidic-muscle hoses: the bare braid beside Gaylord and Sárosi, on whole lengths held out.

python fits/portland_hose/compare.py FOLDER_WITH_CASES --out out/portland_hose

reads each case folder in FOLDER_WITH_CASES (the README says how to make them), fits both braids, draws the
figures of each fit, prints the tables and writes comparison.json.
"""

from __future__ import annotations

import json
from pathlib import Path

from words import taker

from fits.comparison import THREADS, Comparison, compare
from pamjax.compile.jax_cache import keep_compiled
from pamjax.infer.fitting.fit import fit
from pamjax.records.case import read_case
from pamjax.view.figures.fit import save_figures


def cases_in(folder: Path) -> list[Path]:
    """The case folders in a folder, by name."""
    return sorted(path.parent for path in folder.glob("*/muscle.toml"))


def compared(folder: Path, out: Path | None) -> Comparison:
    """One case: checked, fitted with each kind of threads, drawn if there is a place for it, and scored."""
    case = read_case(folder)
    print(case, end="\n\n")
    fits = [fit(case, law) for law in THREADS]
    for one in fits:
        print(one, end="\n\n")
        if out is not None:
            save_figures(one, out / case.name / one.law)
    found = compare(case, fits)
    print(found, end="\n\n")
    return found


def table(found: list[Comparison], split: str) -> str:
    """One split of all cases side by side, as Markdown."""
    models = list(found[0].scores)
    lines = [f"| {split} | " + " | ".join(models) + " |", "|---" * (len(models) + 1) + "|"]
    for one in found:
        cells = (f"{one.rmse(model, split):.3g}".replace("nan", "–") for model in models)
        lines.append(f"| {one.case} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    parser = taker(__doc__)
    asked = parser.parse_args(arguments)
    folders = cases_in(asked.cases)
    if not folders:
        parser.error(f"no case folder in {asked.cases}: each holds a muscle.toml and a recording.csv")
    keep_compiled()
    found = [compared(folder, asked.out) for folder in folders]
    for split in found[0].scores["Gaylord"]:
        print(f"rmse of force [N]\n\n{table(found, split)}\n")
    asked.out.mkdir(parents=True, exist_ok=True)
    report = json.dumps([one.as_dict() for one in found], indent=2, allow_nan=False)
    (asked.out / "comparison.json").write_text(report + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

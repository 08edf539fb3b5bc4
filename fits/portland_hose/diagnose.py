"""Hoses diagnosed: what the inelastic braid leaves out, and how well the named model predicts.

python fits/portland_hose/diagnose.py FOLDER_WITH_CASES --out out/portland_hose

diagnoses each case folder (medians of six samples, `thin.py`), then refits the named model without each inner
length, without the longest length and without the last test of every length, beside Sárosi's formula on the
same rows and the floor of `floor.py`; writes the diagnoses, gains.json and two figures, prints the tables.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from drawn import loops, walls
from floor import floor
from thin import thinned
from words import taker

from pamjax.baselines.comparison import contest, save_contest
from pamjax.baselines.empirical import fit_sarosi
from pamjax.compile.jax_cache import keep_compiled
from pamjax.diagnosis.refit.misfit_weighting import weighed
from pamjax.diagnosis.result import Diagnosis, save
from pamjax.diagnosis.run import diagnose
from pamjax.errors import BadInput
from pamjax.records.case import read_case
from pamjax.records.levels import find_levels, nearest_level


def splits(one: Diagnosis) -> dict[str, list[np.ndarray]]:
    """Rows to hold out, by question."""
    recording = one.found.case.recording
    at = nearest_level(recording.length, find_levels(recording.length))
    seen = np.isfinite(one.found.measured[0])
    last = [recording.cycle == recording.cycle[at == k].max() for k in np.unique(at)]
    return {
        "inner lengths": [seen & (at == k) for k in range(1, at.max())],
        "longest length": [seen & (at == at.max())],
        "last tests": [seen & np.any([(at == k) & last[k] for k in np.unique(at)], axis=0)],
    }


def named(one: Diagnosis, out: np.ndarray) -> np.ndarray:
    """Force of the named model, refitted without some rows, N."""
    model = weighed(one.found, ~out, one.model.chosen, one.model.at.values)
    return one.found.shows(model.at.values)[0]


def sarosi(one: Diagnosis, out: np.ndarray) -> np.ndarray:
    """Force of Sárosi's formula, fitted without some rows, N; NaN where it cannot be fitted."""
    recording = one.found.case.recording
    contraction = 1 - recording.length / one.found.case.entry.rest_length.value
    told = np.where(out, np.nan, one.found.measured[0])
    try:
        return fit_sarosi(recording.pressure, contraction, told).force(recording.pressure, contraction)
    except BadInput:
        return np.full(one.found.n, np.nan)


def scores(one: Diagnosis) -> dict[str, dict[str, float]]:
    """Rmse and largest error of both models on each split, N."""
    found = {}
    for split, outs in splits(one).items():
        models = (named, sarosi)
        off = {model.__name__: [] for model in models}
        for out in outs:
            for model in models:
                off[model.__name__].append((one.found.measured[0] - model(one, out))[out])
        errors = {name: np.concatenate(parts) for name, parts in off.items()}
        found[split] = {name: float(np.sqrt(np.mean(e**2))) for name, e in errors.items()}
        found[split]["largest"] = float(np.abs(errors["named"]).max())
    return found


def answered(folder: Path, out: Path) -> tuple[Diagnosis, dict]:
    """One hose: diagnosed, saved and scored."""
    case = read_case(folder)
    short = thinned(case)
    one = diagnose(short)
    save(one, out / case.name)
    held = contest(one)
    save_contest(held, out / case.name)
    print(one, held, sep="\n", end="\n\n", flush=True)
    repeat = floor(case)
    numbers = {f"{id}.{name}": (v.value, v.sd) for id, by in one.parameters.items() for name, v in by.items()}
    return one, {
        "names": [name.id for name in one.names],
        "numbers": numbers,
        "floor": repeat.floor,
        "tests": repeat.test,
        "full_scale": repeat.full_scale,
        "scores": scores(one),
    }


def table(found: dict[str, dict]) -> str:
    """All hoses side by side, as Markdown."""
    lines = [
        "| hose | named | inner lengths: named, Sárosi, floor | longest length: named, Sárosi"
        " | last tests: named, of full scale, Sárosi |",
        "|---|---|---|---|---|",
    ]
    for name, one in found.items():
        inner, rest, last = (one["scores"][s] for s in ("inner lengths", "longest length", "last tests"))
        cells = [
            name.removeprefix("hose-"),
            ", ".join(one["names"]),
            f"{inner['named']:.3g}, {inner['sarosi']:.3g}, {one['floor']:.3g}",
            f"{rest['named']:.3g}, {rest['sarosi']:.3g}",
            f"{last['named']:.3g}, {100 * last['named'] / one['full_scale']:.2g} %, {last['sarosi']:.3g}",
        ]
        lines.append("| " + " | ".join(cells).replace("nan", "–") + " |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    parser = taker(__doc__)
    parser.add_argument("--only", default="", help="names of cases, with commas between them")
    asked = parser.parse_args(arguments)
    folders = sorted(toml.parent for toml in asked.cases.glob("*/muscle.toml"))
    if asked.only:
        folders = [asked.cases / name for name in asked.only.split(",")]
    keep_compiled()
    asked.out.mkdir(parents=True, exist_ok=True)
    found = {}
    for folder in folders:
        one, found[folder.name] = answered(folder, asked.out)
        loops(one, asked.out / f"{folder.name}.png")
        text = json.dumps(found, indent=1, allow_nan=True)
        (asked.out / "gains.json").write_text(text + "\n", encoding="utf-8")
    print(f"rmse of force, N\n\n{table(found)}")
    walls(found, asked.out / "walls.png")


if __name__ == "__main__":
    main()

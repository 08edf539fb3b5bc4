"""Hoses diagnosed: what the inelastic braid omits, and how well the named mechanisms predict.

python fits/portland_hose/diagnose.py FOLDER_WITH_CASES --out out/portland_hose

Each case folder is diagnosed on medians of `--samples` samples (`block_medians.py`). The model with the named
mechanisms is then refitted without each inner length, without the longest length, and without the last
test of every length. Sárosi's formula is fitted to the same rows. The script writes the diagnoses,
gains.json and the figures, and prints the table with the floor of `repeatability_floor.py`.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from block_medians import take_medians
from command_line import build_parser, list_cases
from hose_figures import draw_loops, draw_wall_moduli
from repeatability_floor import measure_floor

from pamjax.baselines.comparison import compare_models, save_comparison
from pamjax.baselines.empirical import fit_sarosi
from pamjax.compile.jax_cache import keep_compiled
from pamjax.diagnosis.form_errors.fit import add_form_errors
from pamjax.diagnosis.form_errors.prediction import predict_with_uncertainty
from pamjax.diagnosis.refit.misfit_weighting import fit_with_misfit_weight
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.diagnosis.result import Diagnosis, save_diagnosis
from pamjax.diagnosis.run import diagnose
from pamjax.errors import BadInput
from pamjax.records.case import read_case
from pamjax.records.levels import find_levels, find_nearest_level


def make_splits(diagnosis: Diagnosis) -> dict[str, list[np.ndarray]]:
    """Return the masks of the rows to hold out, by split."""
    recording = diagnosis.problem.case.recording
    level = find_nearest_level(recording.length, find_levels(recording.length))
    measured = np.isfinite(diagnosis.problem.measured[0])
    last = [recording.cycle == recording.cycle[level == k].max() for k in np.unique(level)]
    return {
        "inner lengths": [measured & (level == k) for k in range(1, level.max())],
        "longest length": [measured & (level == level.max())],
        "last tests": [measured & np.any([(level == k) & last[k] for k in np.unique(level)], axis=0)],
    }


def refit_named(diagnosis: Diagnosis, held_out: np.ndarray) -> ModelFit:
    """Return the model with the named mechanisms, refitted without some rows."""
    return fit_with_misfit_weight(
        diagnosis.problem, ~held_out, diagnosis.model.mechanisms, diagnosis.model.estimate.values
    )


def predict_equations(diagnosis: Diagnosis, held_out: np.ndarray) -> np.ndarray:
    """Return the force of the named mechanisms without form errors, refitted without some rows, N."""
    return diagnosis.problem.predict(refit_named(diagnosis, held_out).estimate.values)[0]


def predict_named(diagnosis: Diagnosis, held_out: np.ndarray) -> np.ndarray:
    """Return the force of the named mechanisms with their form errors, refitted without some rows, N."""
    model = add_form_errors(diagnosis.problem, refit_named(diagnosis, held_out))
    return predict_with_uncertainty(diagnosis.problem, model).values[0]


def predict_sarosi(diagnosis: Diagnosis, held_out: np.ndarray) -> np.ndarray:
    """Return the force of Sárosi's formula, fitted without some rows, N; NaN where it cannot be fitted."""
    problem = diagnosis.problem
    recording = problem.case.recording
    contraction = 1 - recording.length / problem.case.muscle_toml.rest_length.value
    training = np.where(held_out, np.nan, problem.measured[0])
    try:
        law = fit_sarosi(recording.pressure, contraction, training)
    except BadInput:
        return np.full(problem.n, np.nan)
    return law.force(recording.pressure, contraction)


#: Models that are scored, by their name in gains.json.
MODELS = {"named": predict_named, "equations": predict_equations, "sarosi": predict_sarosi}


def score_splits(diagnosis: Diagnosis) -> dict[str, dict[str, float]]:
    """Return the rmse of each model on each split, and the largest error of the named model, N."""
    force = diagnosis.problem.measured[0]
    scores = {}
    for split, masks in make_splits(diagnosis).items():
        errors = {
            name: np.concatenate([(force - predict(diagnosis, mask))[mask] for mask in masks])
            for name, predict in MODELS.items()
        }
        scores[split] = {name: float(np.sqrt(np.mean(e**2))) for name, e in errors.items()}
        scores[split]["largest"] = float(np.abs(errors["named"]).max())
    return scores


def diagnose_hose(folder: Path, out: Path, samples: int = 6) -> tuple[Diagnosis, dict]:
    """Return the diagnosis of one hose and its numbers for gains.json; save and print the diagnosis."""
    case = read_case(folder)
    diagnosis = diagnose(take_medians(case, samples))
    save_diagnosis(diagnosis, out / case.name)
    comparison = compare_models(diagnosis)
    assert comparison is not None  # the hoses measure force
    save_comparison(comparison, out / case.name)
    print(diagnosis, comparison, sep="\n", end="\n\n", flush=True)
    floor = measure_floor(case)
    numbers = {
        f"{id}.{name}": (v.value, v.sd) for id, by in diagnosis.parameters.items() for name, v in by.items()
    }
    return diagnosis, {
        "names": [name.id for name in diagnosis.named_mechanisms],
        "numbers": numbers,
        "floor": floor.floor,
        "tests": floor.tests,
        "full_scale": floor.full_scale,
        "scores": score_splits(diagnosis),
    }


def format_table(results: dict[str, dict]) -> str:
    """Return all hoses as Markdown."""
    lines = [
        "| hose | mechanisms named | inner lengths held out: named, equations alone, Sárosi, floor"
        " | longest length held out: named, equations alone, Sárosi"
        " | last tests held out: named, named in % of full scale, Sárosi |",
        "|---|---|---|---|---|",
    ]
    for name, result in results.items():
        splits = ("inner lengths", "longest length", "last tests")
        inner, rest, last = (result["scores"][split] for split in splits)
        percent = 100 * last["named"] / result["full_scale"]
        cells = [
            name.removeprefix("hose-"),
            ", ".join(result["names"]),
            f"{inner['named']:.3g}, {inner['equations']:.3g}, {inner['sarosi']:.3g}, {result['floor']:.3g}",
            f"{rest['named']:.3g}, {rest['equations']:.3g}, {rest['sarosi']:.3g}",
            f"{last['named']:.3g}, {percent:.2g} %, {last['sarosi']:.3g}",
        ]
        lines.append("| " + " | ".join(cells).replace("nan", "–") + " |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    parser = build_parser(__doc__)
    parser.add_argument("--only", default="", help="names of the cases, separated by commas")
    parser.add_argument("--samples", type=int, default=6, help="number of samples in a median")
    options = parser.parse_args(arguments)
    folders = list_cases(options.cases)
    if options.only:
        folders = [options.cases / name for name in options.only.split(",")]
    keep_compiled()
    options.out.mkdir(parents=True, exist_ok=True)
    results = {}
    for folder in folders:
        diagnosis, results[folder.name] = diagnose_hose(folder, options.out, options.samples)
        draw_loops(diagnosis, options.out / f"{folder.name}.png")
        text = json.dumps(results, indent=1, allow_nan=True)
        (options.out / "gains.json").write_text(text + "\n", encoding="utf-8")
    print(f"rmse of force, N\n\n{format_table(results)}")
    draw_wall_moduli(results, options.out / "walls.png")


if __name__ == "__main__":
    main()

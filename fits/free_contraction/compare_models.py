"""Free contractions of hand-made muscles: all sets fitted together, and each set predicted from the others.

python fits/free_contraction/compare_models.py TABLE.csv --out out/free_contraction

The script writes the case folders (`build.py`). It fits each model to all sets. The sets share all parameters
of the model except the rest length. Then each set is left out in turn, and predicted with the parameters of
the others. A formula of pressure and contraction has the same splits. The tables have the rms errors of
length, without the row at zero pressure, which is the rest length. The results are also in comparison.json.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from build import DEFAULT_OUT, build_cases
from scipy.optimize import least_squares

from pamjax.compile.jax_cache import keep_compiled
from pamjax.infer.fitting.fit import fit
from pamjax.infer.problem.informative_samples import find_informative_samples
from pamjax.infer.problem.priors import list_free_parameters
from pamjax.records.case import Case, read_case

# The checkout, in which `fits` is a package.
sys.path.insert(0, str(Path(__file__).parents[2]))
from fits.series import (
    Predictor,
    SeriesErrors,
    build_model,
    compute_contraction,
    compute_errors,
    format_table,
)
from fits.source_table import build_parser, run_build

#: Mechanisms of each model, in the order of the table.
MODELS: dict[str, tuple[str, ...]] = {
    "inelastic braid": (),
    "with rubber": ("bladder_elasticity",),
    "with `contact_pressure`": ("contact_pressure",),
    "rubber, `braid_locking`": ("bladder_elasticity", "braid_locking"),
    "rubber, `end_taper`": ("bladder_elasticity", "end_taper"),
}

#: Name of the model whose sets share nothing.
OWN = "rubber, nothing shared"

#: Parameter that each set has for itself: muscles have different lengths.
OWN_PARAMETER = "muscle.rest_length"

#: Name of the formula of pressure and contraction.
FORMULA = "formula of three numbers"


def fit_formula(pressure: np.ndarray, contraction: np.ndarray) -> np.ndarray:
    """Return k, b, m of the contraction k [1 − exp(−(p/b)^m)], fitted by least squares."""

    def compute_residual(numbers: np.ndarray) -> np.ndarray:
        return evaluate_formula(numbers, pressure) - contraction

    start = np.array([contraction.max(), 0.4 * pressure.max(), 1.5])
    return least_squares(compute_residual, start, x_scale=start, bounds=(1e-9, np.inf)).x


def evaluate_formula(numbers: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """Return the contraction of the formula, (n,)."""
    largest, scale, exponent = numbers
    return -largest * np.expm1(-((pressure / scale) ** exponent))


def build_formula(cases: list[Case]) -> Predictor:
    """Return the formula, with numbers that all sets share."""
    columns = [(case.recording.pressure, compute_contraction(case)) for case in cases]

    def predict(kept: Sequence[int]) -> list[np.ndarray]:
        numbers = fit_formula(*map(np.concatenate, zip(*(columns[k] for k in kept), strict=True)))
        return [
            case.muscle_toml.rest_length.value * (1 - evaluate_formula(numbers, pressure))
            for case, (pressure, _) in zip(cases, columns, strict=True)
        ]

    return predict


def compare(cases: list[Case]) -> dict[str, SeriesErrors]:
    """Return the errors of all models; print each fit."""
    errors: dict[str, SeriesErrors] = {}
    for name, mechanisms in MODELS.items():
        errors[name] = _compare_model(cases, mechanisms, share=True)
    errors[OWN] = _compare_model(cases, MODELS["with rubber"], share=False)
    errors[FORMULA] = compute_length_errors(cases, build_formula(cases))
    return errors


def compute_length_errors(cases: list[Case], predict: Predictor) -> SeriesErrors:
    """Return the errors of a model on the rows that are inflated, m; each set is left out alone."""
    inflated = [find_informative_samples(case, "length") for case in cases]
    return compute_errors(cases, predict, range(len(cases)), inflated)


def _compare_model(cases: list[Case], mechanisms: tuple[str, ...], share: bool) -> SeriesErrors:
    names = [free.name for free in list_free_parameters(cases[0], "inelastic", mechanisms)]
    shared = [name for name in names if share and name != OWN_PARAMETER]
    fitted = fit(cases, "inelastic", shared, mechanisms, starts=4, fold_count=2)
    print(fitted, end="\n\n")
    return compute_length_errors(cases, build_model(fitted))


def main(arguments: list[str] | None = None) -> None:
    options = run_build(build_parser(__doc__, DEFAULT_OUT), build_cases, arguments)
    keep_compiled()
    cases = [read_case(folder) for folder in options.folders]
    errors = compare(cases)
    names, rows = [case.name for case in cases], [case.recording.n - 1 for case in cases]
    rest = np.array([case.muscle_toml.rest_length.value for case in cases])
    print("rms error of length: all sets fitted, set left out\n")
    print(format_table(names, rows, errors, "mm", np.full(rest.size, 1e-3)), end="\n\n")
    print(format_table(names, rows, errors, "% of the rest length", rest / 100))
    document = {
        "cases": names,
        "rest_length_m": list(rest),
        "rmse_m": {name: vars(both) for name, both in errors.items()},
    }
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    (options.out / "comparison.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

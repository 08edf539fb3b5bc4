"""Hand readings at 620 kPa: all series fitted together, and each hose predicted from the others.

python fits/hoses_620kpa/compare_models.py TABLE.csv --out out/hoses_620kpa

The script writes the case folders (`build.py`). It fits each model to all series. The series share all
parameters of the model except the rest length, as hoses of one material do. Then each hose is left out in
turn, and predicted with the parameters of the others. Sárosi's formula and a parabola are fitted to the
contractions of all series, with the same splits. The table has the rms errors of force. Two further lines
show the reading errors: the effect of 1 mm of length, and the difference of two series of one hose.

A series that is left out has no influence, except through the weights of the other series. The results are
also in comparison.json.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
from build import DEFAULT_OUT, build_cases

from pamjax.baselines.empirical import fit_sarosi
from pamjax.compile.jax_cache import keep_compiled
from pamjax.infer.fitting.fit import fit
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

#: Names of the models in the order of the table: thread law and mechanisms.
MODELS: dict[str, tuple[str, tuple[str, ...]]] = {
    "inelastic braid": ("inelastic", ()),
    "with rubber": ("inelastic", ("bladder_elasticity",)),
    "rubber, elastic threads": ("elastic", ("bladder_elasticity",)),
    "rubber, `thread_crimp`": ("inelastic", ("bladder_elasticity", "thread_crimp")),
    "rubber, `end_taper`": ("inelastic", ("bladder_elasticity", "end_taper")),
    "rubber, `rig_compliance`": ("inelastic", ("bladder_elasticity", "rig_compliance")),
    "rubber, elastic threads, `end_taper`": ("elastic", ("bladder_elasticity", "end_taper")),
}

#: Parameter that each series has for itself: hoses have different lengths.
OWN = "muscle.rest_length"

#: Model whose series also have dimensions of their own.
OWN_DIMENSIONS = "rubber, own dimensions"


def list_shared(case: Case, law: str, mechanisms: tuple[str, ...], own_dimensions: bool = False) -> list[str]:
    """Return the parameters that all series share."""
    names = [free.name for free in list_free_parameters(case, law, mechanisms) if free.name != OWN]
    dimensions = ("muscle.", "bladder_elasticity.inner")
    return [name for name in names if not (own_dimensions and name.startswith(dimensions))]


def build_formula(cases: list[Case], fit_formula: Callable[..., Callable]) -> Predictor:
    """Return a formula of pressure and contraction that is the same for all hoses.

    Args:
        cases: the series.
        fit_formula: function from pressure, contraction and force to a function from the first two to force.
    """
    columns = [(case.recording.pressure, compute_contraction(case), case.recording.force) for case in cases]

    def predict(kept: Sequence[int]) -> list[np.ndarray]:
        law = fit_formula(*map(np.concatenate, zip(*(columns[k] for k in kept), strict=True)))
        return [law(pressure, contraction) for pressure, contraction, _ in columns]

    return predict


def fit_sarosi_at_one_pressure(pressure: np.ndarray, contraction: np.ndarray, force: np.ndarray) -> Callable:
    """Return Sárosi's formula at one pressure, F = A exp(c κ) + D κ + E.

    The fit needs two pressures. The second one is 0 Pa with a force of 0 N, which leaves A, c, D and E.
    """
    nothing = np.zeros(force.size)
    return fit_sarosi(np.r_[pressure, nothing], np.r_[contraction, contraction], np.r_[force, nothing]).force


def fit_parabola(pressure: np.ndarray, contraction: np.ndarray, force: np.ndarray) -> Callable:
    """Return a parabola of the contraction."""
    coefficients = np.polyfit(contraction, force, 2)
    return lambda pressure, contraction: np.polyval(coefficients, contraction)


#: Formulas in the order of the table.
FORMULAS = {"Sárosi's formula": fit_sarosi_at_one_pressure, "parabola": fit_parabola}


def list_rest_lengths(cases: list[Case]) -> list[float]:
    """Return the rest length of each series, m; series of one rest length are left out together."""
    return [case.muscle_toml.rest_length.value for case in cases]


def compute_ruler_errors(cases: list[Case], predict: Predictor, sd: float = 1e-3) -> list[float]:
    """Return the rms change of force, N, of each series by an error of each length of `sd`, m."""
    errors = []
    for case, force in zip(cases, predict(range(len(cases))), strict=True):
        order = np.argsort(case.recording.length)
        slope = np.gradient(force[order], case.recording.length[order])
        errors.append(float(np.sqrt(np.mean((sd * slope) ** 2))))
    return errors


def compute_repeat_differences(cases: list[Case]) -> dict[str, float]:
    """Return the rms difference of force, N, of series with one rest length, at equal lengths."""
    differences = {}
    for first, second in combinations(cases, 2):
        if first.muscle_toml.rest_length.value == second.muscle_toml.rest_length.value:
            order = np.argsort(second.recording.length)
            length, force = second.recording.length[order], second.recording.force[order]
            inside = (first.recording.length >= length[0]) & (first.recording.length <= length[-1])
            gap = first.recording.force - np.interp(first.recording.length, length, force)
            differences[f"{first.name} and {second.name}"] = float(np.sqrt(np.mean(gap[inside] ** 2)))
    return differences


def format_errors(cases: list[Case], errors: dict[str, SeriesErrors], unit: str) -> str:
    """Return the errors as Markdown, fitted and left out, in N or in % of the largest force of a series."""
    names = [case.name.removeprefix("hose-") for case in cases]
    scales = np.array([case.recording.force.max() / 100 if unit == "%" else 1.0 for case in cases])
    return format_table(names, [case.recording.n for case in cases], errors, unit, scales)


def compare(cases: list[Case]) -> dict[str, SeriesErrors]:
    """Return the errors of all models; print each fit."""
    errors: dict[str, SeriesErrors] = {}
    for name, (law, mechanisms) in MODELS.items():
        errors[name] = _compare_model(cases, law, list_shared(cases[0], law, mechanisms), mechanisms)
    law, mechanisms = MODELS["with rubber"]
    shared = list_shared(cases[0], law, mechanisms, own_dimensions=True)
    errors[OWN_DIMENSIONS] = _compare_model(cases, law, shared, mechanisms)
    for name, fit_formula in FORMULAS.items():
        formula = build_formula(cases, fit_formula)
        errors[name] = compute_errors(cases, formula, list_rest_lengths(cases))
    return errors


def _compare_model(
    cases: list[Case], law: str, shared: list[str], mechanisms: tuple[str, ...]
) -> SeriesErrors:
    fitted = fit(cases, law, shared, mechanisms, starts=2, fold_count=2)
    print(fitted, end="\n\n")
    return compute_errors(cases, build_model(fitted), list_rest_lengths(cases))


def main(arguments: list[str] | None = None) -> None:
    options = run_build(build_parser(__doc__, DEFAULT_OUT), build_cases, arguments)
    keep_compiled()
    cases = [read_case(folder) for folder in options.folders]
    errors = compare(cases)
    print("rms error of force: all series fitted, hose left out\n")
    for unit in ("N", "%"):
        print(format_errors(cases, errors, unit), end="\n\n")
    ruler = compute_ruler_errors(cases, build_formula(cases, fit_sarosi_at_one_pressure))
    print("an error of 1 mm of each length changes the force by, N:", ", ".join(f"{x:.3g}" for x in ruler))
    repeats = compute_repeat_differences(cases)
    for pair, difference in repeats.items():
        print(f"{pair} differ by {difference:.3g} N at equal lengths")
    document = {
        "cases": [case.name for case in cases],
        "largest_force_N": [float(case.recording.force.max()) for case in cases],
        "ruler_error_N": ruler,
        "repeat_difference_N": repeats,
        "rmse_N": {name: vars(both) for name, both in errors.items()},
    }
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    (options.out / "comparison.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

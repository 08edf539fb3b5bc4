"""Hand readings of force against length at 620 kPa: four series fitted together, each one held out once.

python fits/hoses_620kpa/fit_hoses.py TABLE.csv --out out/hoses_620kpa

TABLE.csv has the columns `lrest_mm`, `length_mm`, `force_N`, `pressure_kPa` and `note` (README: its source).
The script writes a case folder for each series. It fits the braid with and without rubber to all of them, and
all have one rubber. It then leaves out one series at a time, and predicts it from the others and its stated
dimensions. The same is done with a parabola of the contraction. It prints a table of the errors.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from pamjax.compile.jax_cache import keep_compiled
from pamjax.infer.fitting.cross_validation import exclude_rows
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.least_squares import solve_least_squares
from pamjax.infer.fitting.result import Fit
from pamjax.infer.problem.dataset import predict_row_channels
from pamjax.records.case import Case, read_case

#: Columns of the table.
COLUMNS = ["lrest_mm", "length_mm", "force_N", "pressure_kPa", "note"]

#: Parameters that all hoses share: the rubber is the same.
WALL = ("bladder_elasticity.modulus", "bladder_elasticity.mooney")

#: The compared models: mechanisms and shared parameters.
MODELS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "inelastic braid": ((), ()),
    "with rubber": (("bladder_elasticity",), WALL),
}

MUSCLE = """\
[muscle]
name = "fluidic muscle hose, {length:g} mm, {load}"
rest_length = {{value = "{length:g} mm", sd = "1 mm"}}
diameter = {{value = "11.8 mm", sd = "0.9 mm"}}        # threads lie inside a 1.8 mm wall around a 10 mm bore
braid_angle = {{value = "61.4 deg", sd = "1 deg"}}     # from the circumference

[bladder]
inner_diameter = {{value = "8.2 mm", sd = "0.9 mm"}}   # a tube of 10 mm does not fit inside its threads
thickness = "1.8 mm"

[sensors]
length = "1 mm"

[baseline]
model = "inelastic"
"""


def write_cases(table: pd.DataFrame, folder: Path) -> list[Case]:
    """Write a case folder for each rest length and load, and return the cases.

    Args:
        table: the columns of the source.
        folder: folder of the case folders.
    """
    cases = []
    for (length, note), rows in table.groupby(["lrest_mm", table["note"].fillna("")], sort=True):
        case_folder = folder / f"hose-{length:g}{'-tendon' if note else ''}"
        case_folder.mkdir(parents=True, exist_ok=True)
        recording = rows[["pressure_kPa", "length_mm", "force_N"]]
        recording.columns = ["pressure [kPa]", "length [mm]", "force [N]"]
        recording.to_csv(case_folder / "recording.csv", index=False, lineterminator="\n")
        load = "with a tendon in series" if note else "alone"
        (case_folder / "muscle.toml").write_text(MUSCLE.format(length=length, load=load), "utf-8")
        cases.append(read_case(case_folder))
    return cases


def predict_left_out(fitted: Fit, k: int) -> np.ndarray:
    """Return the force of the k-th series, N, (n,), from a fit to the others."""
    training = tuple(
        exclude_rows(dataset, np.ones(dataset.rows.force_weight.size, dtype=bool)) if j == k else dataset
        for j, dataset in enumerate(fitted.datasets)
    )
    solution = solve_least_squares(training, fitted.limited_space, fitted.solution.u, fitted.loss)
    values = fitted.space.to_values(solution.u)
    return predict_row_channels(fitted.datasets[k], values)[0, : fitted.cases[k].case.recording.n]


def compute_contraction(case: Case) -> np.ndarray:
    """Return the contraction of each row, (n,)."""
    return 1 - case.recording.length / case.muscle_toml.rest_length.value


def predict_by_parabola(cases: list[Case], k: int) -> np.ndarray:
    """Return the force of the k-th series, N, (n,), by a parabola of the contraction of the others."""
    others = [case for j, case in enumerate(cases) if j != k]
    contraction, force = (
        np.concatenate(parts)
        for parts in zip(*((compute_contraction(c), c.recording.force) for c in others), strict=True)
    )
    return np.polyval(np.polyfit(contraction, force, 2), compute_contraction(cases[k]))


def compute_errors(cases: list[Case], predict: Callable[[int], np.ndarray]) -> list[float]:
    """Return the rms error of force of each series, N."""
    return [float(np.sqrt(np.mean((case.recording.force - predict(k)) ** 2))) for k, case in enumerate(cases)]


def format_table(cases: list[Case], errors: dict[str, list[float]]) -> str:
    """Return the errors as Markdown: N, and % of the largest force of the series."""
    lines = [
        "| model | " + " | ".join(case.name.removeprefix("hose-") for case in cases) + " |",
        "|---" * (len(cases) + 1) + "|",
    ]
    scales = [float(case.recording.force.max()) for case in cases]
    for model, values in errors.items():
        cells = [f"{value:.3g} ({value / scale:.0%})" for value, scale in zip(values, scales, strict=True)]
        lines.append(f"| {model} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def read_table(file: Path) -> pd.DataFrame:
    """Return the table of the source.

    Raises:
        SystemExit: if it has other columns.
    """
    table = pd.read_csv(file)
    if list(table.columns) != COLUMNS:
        raise SystemExit(
            f"{file} must have the columns {', '.join(COLUMNS)}; got {', '.join(table.columns)}."
        )
    return table


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("table", type=Path, help="the table of the source")
    parser.add_argument("--out", type=Path, default=Path("out/hoses_620kpa"), help="folder for the cases")
    options = parser.parse_args(arguments)
    keep_compiled()
    cases = write_cases(read_table(options.table), options.out)
    fitted_errors, left_out_errors = {}, {}
    for name, (mechanisms, shared) in MODELS.items():
        fitted = fit(cases, "inelastic", shared, mechanisms, starts=2, fold_count=2)
        print(fitted, end="\n\n")
        fitted_errors[name] = [case_fit.rmse["force"] for case_fit in fitted.cases]
        left_out_errors[name] = compute_errors(cases, lambda k, fitted=fitted: predict_left_out(fitted, k))
    left_out_errors["parabola"] = compute_errors(cases, lambda k: predict_by_parabola(cases, k))
    print(f"rmse of force of the fit, N (% of the largest force)\n\n{format_table(cases, fitted_errors)}\n")
    print(f"rmse of force of a series that is left out\n\n{format_table(cases, left_out_errors)}")


if __name__ == "__main__":
    sys.exit(main())

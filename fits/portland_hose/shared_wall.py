"""The rubber wall of four hoses of one series, fitted separately and with shared parameters.

python fits/portland_hose/shared_wall.py FOLDER_WITH_CASES --out out/portland_hose

Hoses of 83, 132, 281 and 521 mm were cut from one series and should have the same rubber. Each hose is
fitted alone; then all four are fitted with one shear modulus and one Mooney share. The model has threads
that do not stretch and a rubber tube; the rows are medians of six samples (`block_medians.py`). The
stated tube does not fit inside its braid (README). Its bore is therefore set to the diameter of the braid
less two walls, with the sd of that diameter. The script prints:

    separate   modulus of each hose, and chi² of the four moduli about their weighted mean
    shared     modulus of all hoses, and the rmse of force in sample and at lengths held out
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from block_medians import take_medians
from command_line import build_parser
from scipy.stats import chi2

from pamjax.compile.jax_cache import keep_compiled
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.result import CaseFit, Estimate, Fit
from pamjax.records.case import Case, read_case
from pamjax.records.reading.quantity import MeasuredValue

#: The series, and the parameters that its hoses share.
HOSES = ("hose-10mm-83", "hose-10mm-132", "hose-10mm-281", "hose-10mm-521")
WALL = ("bladder_elasticity.modulus", "bladder_elasticity.mooney")


@dataclass(frozen=True)
class WeightedMean:
    """Mean of measured values, each weighted with 1/sd².

    Attributes:
        mean, sd: in the unit of the values.
        chi2: sum of the squared deviations from the mean, each in units of its sd.
        p_value: of chi2 with one degree of freedom fewer than values; a small one means disagreement.
    """

    mean: float
    sd: float
    chi2: float
    p_value: float


def read_hose(folder: Path, samples: int = 6) -> Case:
    """Return a hose with medians of that many samples, and with its tube inside its threads."""
    case = take_medians(read_case(folder), samples)
    bladder, outer = case.muscle_toml.bladder, case.muscle_toml.diameter
    assert bladder is not None
    assert bladder.thickness is not None
    assert outer is not None
    bore = MeasuredValue(outer.value - 2 * bladder.thickness.value, outer.sd)
    return replace(case, muscle_toml=replace(case.muscle_toml, bladder=replace(bladder, inner_diameter=bore)))


def fit_wall(cases: list[Case], shared: tuple[str, ...] = (), folds: int = 5) -> Fit:
    """Return the fit of inelastic threads around a rubber tube.

    Args:
        cases: hoses, as `read_hose` returns them.
        shared: parameters that all hoses have in common.
        folds: number of parts into which the lengths are split for cross-validation.
    """
    return fit(cases, "inelastic", shared, ("bladder_elasticity",), starts=2, fold_count=folds)


def average_values(values: Sequence[tuple[float, float]]) -> WeightedMean:
    """Return the weighted mean of pairs of value and sd, with a test of their agreement."""
    value, sd = np.array(values, dtype=float).T
    weight = 1 / sd**2
    mean = float(np.sum(weight * value) / np.sum(weight))
    squares = float(np.sum(weight * (value - mean) ** 2))
    return WeightedMean(
        mean, float(np.sum(weight)) ** -0.5, squares, float(chi2.sf(squares, len(values) - 1))
    )


def format_rmse(result: CaseFit) -> str:
    """Return the rmse of force in sample and held out, N."""
    held_out = result.held_out_score.rmse["force"] if result.held_out_score else np.nan
    return f"{result.rmse['force']:.3g}, {held_out:.3g}"


def format_modulus(estimate: Estimate) -> str:
    """Return a modulus and its sd, MPa."""
    return f"{estimate.value / 1e6:.2f} ± {(estimate.sd or np.nan) / 1e6:.2f}"


def format_report(separate: list[Fit], shared: Fit) -> str:
    """Return both fits as Markdown."""
    moduli = [result.estimates[WALL[0]] for result in separate]
    lines = [
        "| hose | modulus, separate fit, MPa | rmse, separate fit: in sample, held out, N"
        " | rmse, shared fit: in sample, held out, N |",
        "|---|---|---|---|",
    ]
    for name, result, modulus, joint in zip(HOSES, separate, moduli, shared.cases, strict=True):
        lines.append(
            f"| {name.removeprefix('hose-')} | {format_modulus(modulus)} | {format_rmse(result.cases[0])}"
            f" | {format_rmse(joint)} |"
        )
    average = average_values([(one.value, one.sd or np.nan) for one in moduli])
    lines += [
        "",
        f"separate fits: weighted mean {average.mean / 1e6:.2f} ± {average.sd / 1e6:.2f} MPa,"
        f" chi² {average.chi2:.2f} with {len(moduli) - 1} degrees of freedom, p {average.p_value:.2g}",
        f"shared fit: modulus {format_modulus(shared.estimates[WALL[0]])} MPa,"
        f" Mooney share {shared.estimates[WALL[1]].value:.2f}",
    ]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    options = build_parser(__doc__).parse_args(arguments)
    keep_compiled()
    options.out.mkdir(parents=True, exist_ok=True)
    cases = [read_hose(options.cases / name) for name in HOSES]
    text = format_report([fit_wall([case]) for case in cases], fit_wall(cases, WALL))
    (options.out / "shared_wall.md").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()

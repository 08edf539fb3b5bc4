"""Share of a held-out error that one wrong length explains.

python fits/portland_hose/held_out_length.py FOLDER_WITH_CASES --out out/stability

The ruler is read once for all tests of a length, with an sd of 1 mm. A wrong reading Δ of the held-out length
changes all its forces F together, by Δ ∂F/∂L at the pressure P of each row:

    F − F_predicted = Δ s(P) + e,      s = (F₊ − F₋) / (L₊ − L₋)

    F₊, F₋  N   measured force at the next longer and the next shorter length, mean of all tests at P
    Δ       m   from least squares; positive if the hose is longer than predicted
    e       N   error that no length explains

The script prints one row for each diagnosis that `stability.py` made. Neglects: an error of the mechanisms
that is proportional to the slope, which cannot be distinguished from a wrong length.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from command_line import build_parser, list_cases
from treatments import TREATMENTS

from pamjax.infer.problem.informative_samples import find_informative_samples
from pamjax.infer.problem.rms import compute_rms
from pamjax.records.case import Case, read_case
from pamjax.records.levels import find_levels, find_nearest_level

#: Number of bins of pressure in which the force is averaged.
BINS = 40


@dataclass(frozen=True)
class LengthError:
    """Error of a held-out length.

    Attributes:
        rms: rms of the held-out error of force, N.
        length_error: Δ, m.
        remaining_rms: rms of e, N.
        slope: rms of s, N/m.
    """

    rms: float
    length_error: float
    remaining_rms: float
    slope: float


def average_force(case: Case, rows: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """Return the mean measured force of some rows at other pressures, N, by bins of pressure."""
    p, force = case.recording.pressure[rows], case.recording.force[rows]
    bins = np.digitize(p, np.linspace(p.min(), p.max(), BINS))
    means = [(p[bins == k].mean(), force[bins == k].mean()) for k in np.unique(bins)]
    return np.interp(pressure, *np.transpose(means))


def compute_slope(case: Case, rows: np.ndarray) -> np.ndarray:
    """Return ∂F/∂L at the rows of one inner length, from the lengths on both sides, N/m."""
    recording = case.recording
    lengths = find_levels(recording.length)
    level = find_nearest_level(recording.length, lengths)
    (k,) = np.unique(level[rows])
    shorter, longer = (average_force(case, level == k + d, recording.pressure[rows]) for d in (-1, 1))
    return (longer - shorter) / (lengths[k + 1] - lengths[k - 1])


def fit_length_error(case: Case, predicted: np.ndarray, rows: np.ndarray) -> LengthError:
    """Return the length error that explains most of a held-out error.

    Args:
        case: the diagnosed case.
        predicted: (n,) predicted force, N.
        rows: (n,) whether a row is held out and informative; all of them have one length.
    """
    residual, slope = (case.recording.force - predicted)[rows], compute_slope(case, rows)
    length_error = float(slope @ residual / (slope @ slope))
    remaining = residual - length_error * slope
    return LengthError(compute_rms(residual), length_error, compute_rms(remaining), compute_rms(slope))


def format_row(hose: str, title: str, result: LengthError) -> str:
    """Return one row of the table."""
    share = 1 - (result.remaining_rms / result.rms) ** 2
    return (
        f"| {hose.removeprefix('hose-')} | {title} | {result.rms:.3g} | {1e3 * result.length_error:+.2f}"
        f" | {result.remaining_rms:.3g} | {100 * share:.0f} % | {1e-3 * result.slope:.3g} |"
    )


def main(arguments: list[str] | None = None) -> None:
    options = build_parser(__doc__).parse_args(arguments)
    print(
        "| hose | treatment | held-out rms, N | length error, mm | rms without it, N | explained | N per mm |"
    )
    print("|---|---|---|---|---|---|---|")
    for folder in list_cases(options.cases):
        for treatment in TREATMENTS:
            file: Path = options.out / folder.name / treatment.id / "prediction.csv"
            if file.exists():
                case, table = treatment.apply(read_case(folder)), pd.read_csv(file)
                rows = (table["held_out"].to_numpy() == 1) & find_informative_samples(case, "force")
                result = fit_length_error(case, table["force_after [N]"].to_numpy(), rows)
                print(format_row(folder.name, treatment.title, result))


if __name__ == "__main__":
    main()

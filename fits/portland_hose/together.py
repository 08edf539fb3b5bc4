"""One wall in four hoses of a series: its rubber fitted apart and together.

python fits/portland_hose/together.py FOLDER_WITH_CASES --out out/portland_hose

Hoses of 83, 132, 281 and 521 mm were cut from one series, so that their rubber is the same. Each is fitted
alone, and all four with one modulus and one share of Mooney's; medians of six samples (`thin.py`), threads
that do not stretch and a rubber tube. The stated tube does not fit its braid (README): its bore is believed
to be the braid's diameter less two walls, as well known as that diameter. Printed:

    apart       modulus of each hose, and χ² of the four about their weighted mean: what could refute one wall
    together    the modulus of all, and what holding it costs: rmse of force in sample and on lengths held out
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import chi2
from thin import thinned
from words import taker

from pamjax.compile.jax_cache import keep_compiled
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.result import CaseFit, Estimate, Fit
from pamjax.records.case import Case, read_case
from pamjax.records.reading.quantity import Measured

#: The series, and what its specimens have in common.
HOSES = ("hose-10mm-83", "hose-10mm-132", "hose-10mm-281", "hose-10mm-521")
WALL = ("bladder_elasticity.modulus", "bladder_elasticity.mooney")


def believed(folder: Path) -> Case:
    """A hose, thinned, whose tube lies inside its threads."""
    case = thinned(read_case(folder))
    bladder, outer = case.entry.bladder, case.entry.diameter
    assert bladder is not None
    assert bladder.thickness is not None
    assert outer is not None
    bore = Measured(outer.value - 2 * bladder.thickness.value, outer.sd)
    return replace(case, entry=replace(case.entry, bladder=replace(bladder, inner_diameter=bore)))


def fitted(cases: list[Case], share: tuple[str, ...] = (), folds: int = 5) -> Fit:
    """Inelastic threads around a rubber tube; lengths are held out in that many parts."""
    return fit(cases, "inelastic", share, ("bladder_elasticity",), starts=2, fold_count=folds)


def agreement(told: list[tuple[float, float]]) -> tuple[float, float, float, float]:
    """Weighted mean of values with their sd, and its sd; χ² about it and its p-value."""
    value, sd = np.array(told, dtype=float).T
    weight = 1 / sd**2
    mean = float(np.sum(weight * value) / np.sum(weight))
    squares = float(np.sum(weight * (value - mean) ** 2))
    return mean, float(np.sum(weight)) ** -0.5, squares, float(chi2.sf(squares, len(told) - 1))


def rms(one: CaseFit) -> str:
    """Rmse of force in sample and held out, N."""
    held_out = one.held_out.rmse["force"] if one.held_out else np.nan
    return f"{one.rmse['force']:.3g}, {held_out:.3g}"


def mega(one: Estimate) -> str:
    """A modulus with its standard deviation."""
    return f"{one.value / 1e6:.2f} ± {(one.sd or np.nan) / 1e6:.2f}"


def report(apart: list[Fit], together: Fit) -> str:
    """Both, as Markdown."""
    moduli = [one.estimates[WALL[0]] for one in apart]
    lines = [
        "| hose | modulus apart, MPa | rmse apart: in sample, lengths held out, N | together |",
        "|---|---|---|---|",
    ]
    for name, one, modulus, joint in zip(HOSES, apart, moduli, together.cases, strict=True):
        lines.append(
            f"| {name.removeprefix('hose-')} | {mega(modulus)} | {rms(one.cases[0])} | {rms(joint)} |"
        )
    mean, sd, squares, p = agreement([(one.value, one.sd or np.nan) for one in moduli])
    shared = together.estimates[WALL[0]]
    lines += [
        "",
        f"apart: mean {mean / 1e6:.2f} ± {sd / 1e6:.2f} MPa, chi2 {squares:.2f} about it for 3, p {p:.2g}",
        f"together: {mega(shared)} MPa, mooney {together.estimates[WALL[1]].value:.2f}",
    ]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    asked = taker(__doc__).parse_args(arguments)
    keep_compiled()
    asked.out.mkdir(parents=True, exist_ok=True)
    cases = [believed(asked.cases / name) for name in HOSES]
    apart = [fitted([case]) for case in cases]
    together = fitted(cases, WALL)
    told = report(apart, together)
    (asked.out / "together.md").write_text(told + "\n", encoding="utf-8")
    print(told)


if __name__ == "__main__":
    main()

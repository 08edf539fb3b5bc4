"""Export: a muscle's inverse as Chebyshev sums, with the error that was measured, for a robot without JAX."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.polynomial.chebyshev import chebfit, chebvander

from pamjax.control import standalone
from pamjax.control.command_uncertainty import Doubt
from pamjax.control.inverse import Inverse, Limit
from pamjax.control.neglected import half_loop
from pamjax.errors import at_least, refuse
from pamjax.records.files import write_beside
from pamjax.units import show

#: Degrees that are tried, in turn, until the error is small enough.
DEGREES = (8, 12, 16, 24, 32, 48)

#: Error that is small enough, as a share of the range, and whose.
ENOUGH, JUDGED = 1e-5, ("force", "stiffness", "pressure", "length")

#: Random points at which the error is measured, and the factor between the largest found and the stated one.
POINTS, MARGIN = 20_000, 2.0

#: The same for what is itself no better known than to a few hundredths, and the degree of its sum.
FEW, LOW = 500, 12

#: The least share of the highest pressure at which a length can be commanded: without pressure, no stiffness.
LEAST = 0.05

#: Shares of the highest pressure at which a table may begin where it cannot begin at the lowest, and the
#: share of the lengths that it must then keep: below, rubber may hold the muscle open by itself.
BEGIN, KEEP = (0.05, 0.1, 0.2, 0.3, 0.5), 0.6


@dataclass(frozen=True)
class Exported:
    """What was written.

    Attributes:
        files: the table and the module that reads it.
        pressures, lengths: what the table covers, Pa and m.
        degree: of the sums.
        error: stated error by name, SI: twice the largest that was met.
        share: the largest of them, as a share of its range.
    """

    files: tuple[Path, Path]
    pressures: tuple[float, float]
    lengths: tuple[float, float]
    degree: int
    error: dict[str, float]
    share: float

    def __str__(self) -> str:
        units = {"pressure": "Pa", "length": "um", "force": "N", "stiffness": "N/m"}
        told = ", ".join(f"{n} {show(self.error[n], u, 2)}" for n, u in units.items())
        (low, high), (short, long) = self.pressures, self.lengths
        covers = f"{show(low, 'kPa')} to {show(high, 'kPa')}, {show(short, 'mm')} to {show(long, 'mm')}"
        return f"for {covers}; sums of degree {self.degree}; off by less than {told}"


def export(of: Inverse, folder: Path, *, doubt: Doubt | None = None, seed: int = 0) -> Exported:
    """Write controller.npz and controller.py.

    Args:
        of: the inverse of a muscle. Its range is narrowed to where every wish between the least and the
            most force has an answer.
        folder: where to.
        doubt: how surely the force is known; None where that is not.
        seed: of the random points at which the error is measured.

    Raises:
        BadInput: where there is no such range.
    """
    at_least("seed", seed, 0)
    of = narrowed(of)
    folder.mkdir(parents=True, exist_ok=True)
    table, share, degree = {}, np.inf, 0
    for degree in DEGREES:
        trial = _table(of, degree)
        found = _measured(of, trial, folder, seed)
        if max(found[1].values()) < share:
            table, share, error = trial, max(found[1].values()), found[0]
        if share < ENOUGH:
            break
    rough = {"friction": lambda p, l: half_loop(of.muscle, p, l), "sd": doubt or _unknown}
    for name, values in rough.items():
        table[name], error[name] = _rough(of, values, seed)
    stated = {name: MARGIN * value for name, value in error.items()}
    files = folder / "controller.npz", folder / "controller.py"
    _write(files[0], table | {f"error_{name}": np.array(value) for name, value in stated.items()})
    with write_beside(files[1]) as beside:
        shutil.copyfile(standalone.__file__, beside)
    return Exported(files, of.pressures, of.lengths, degree, stated, MARGIN * share)


def narrowed(of: Inverse) -> Inverse:
    """The part of the range in which every force between the ends' has an answer.

    From the lowest pressure that leaves most lengths; where none does, from the one that leaves most.
    """
    lowest, high = of.pressures
    begins = [lowest, *(share * high for share in BEGIN if share * high > lowest)]
    best, most = of, 0.0
    for low in begins:
        lengths = np.linspace(*of.lengths, 201)
        first = _first_good(Inverse(of.muscle, (low, high), of.lengths), lengths)
        kept = 1 - first / lengths.size
        if kept > most:
            best, most = Inverse(of.muscle, (low, high), (float(lengths[first]), float(lengths[-1]))), kept
        if kept >= KEEP:
            break
    if most < 0.1:
        rule = "a controller needs a range of pressure and length in which pressure pulls"
        raise refuse(rule, "hardly any length", remedy="Give a longer one, or a higher pressure.")
    return best


def _first_good(of: Inverse, lengths: np.ndarray) -> int:
    """The shortest of rising lengths from which on to the longest all have an answer."""
    good = np.ones(lengths.size, dtype=bool)
    low, high = of.pressures
    for pressure in np.linspace(low, high, 9):
        force, stiffness = of.force(pressure, lengths)
        command = of.pressure(force, lengths)
        good &= (np.asarray(command.status) == Limit.OK) & np.isfinite(force)
        if pressure >= LEAST * high:
            good &= stiffness > 0
    bad = np.flatnonzero(~good)
    return int(bad.max()) + 1 if bad.size else 0


def _holding(of: Inverse) -> Inverse:
    """The same from the least pressure at which a length can be commanded."""
    low, high = of.pressures
    return Inverse(of.muscle, (max(low, LEAST * high), high), of.lengths)


def _nodes(degree: int) -> np.ndarray:
    """Chebyshev points, ends included."""
    return -np.cos(np.pi * np.arange(degree + 1) / degree)


def _to(x: np.ndarray, ends: tuple[float, float]) -> np.ndarray:
    return (ends[0] + ends[1]) / 2 + x * (ends[1] - ends[0]) / 2


def _fitted(values: np.ndarray, degree: int) -> np.ndarray:
    """(i, j) coefficients of values at Chebyshev points in both directions."""
    inverse = np.linalg.inv(chebvander(_nodes(degree), degree))
    return inverse @ values @ inverse.T


def _table(of: Inverse, degree: int) -> dict[str, np.ndarray]:
    x = _nodes(degree)
    p, l = (g.ravel() for g in np.meshgrid(_to(x, of.pressures), _to(x, of.lengths), indexing="ij"))
    square = degree + 1, degree + 1
    holding = _holding(of)
    table = {
        "pressures": np.array(of.pressures), "holding": np.array(holding.pressures),
        "lengths": np.array(of.lengths),
    }  # fmt: skip
    table |= {name: _fitted(values.reshape(square), degree) for name, values in _forward(of, p, l).items()}
    inverses: list[tuple[str, Callable, tuple[float, float], tuple[float, float]]] = [
        ("pressure", of.pressure, of.lengths, of.pressures),
        ("length", holding.length, holding.pressures, of.lengths),
    ]
    for name, solve, range_, into in inverses:
        other = _to(x, range_)
        ends = [of.force(e, other)[0] if name == "pressure" else of.force(other, e)[0] for e in into]
        for end, values in zip(("least", "most"), ends, strict=True):
            table[f"{name}_{end}"] = chebfit(x, values, degree)
        wanted = ends[0] + (x[:, None] + 1) / 2 * (ends[1] - ends[0])
        asked = np.broadcast_to(other, square)
        solved = np.asarray(solve(wanted.ravel(), asked.ravel()).value)
        table[name] = _fitted(solved.reshape(square), degree)
    return table


def _measured(of: Inverse, table, folder: Path, seed: int) -> tuple[dict[str, float], dict[str, float]]:
    """Largest errors at random points, SI and as shares of the range, of the code that is handed over."""
    _write(folder / "controller.npz", table)
    robot = standalone.Controller(folder / "controller.npz")
    rng = np.random.default_rng(seed)
    p, l = (rng.uniform(*ends, POINTS) for ends in (of.pressures, of.lengths))
    true = _forward(of, p, l)
    pairs = {name: (getattr(robot, name)(p, l), values) for name, values in true.items()}
    pairs["pressure"] = robot.pressure(true["force"], l)[0], p
    held = _to(2 * (p - of.pressures[0]) / np.ptp(of.pressures) - 1, _holding(of).pressures)
    pairs["length"] = robot.length(of.force(held, l)[0], held)[0], l
    errors = {name: float(np.max(np.abs(got - want))) for name, (got, want) in pairs.items()}
    return errors, {name: errors[name] / float(np.ptp(pairs[name][1])) for name in JUDGED}


def _forward(of: Inverse, pressure: np.ndarray, length: np.ndarray) -> dict[str, np.ndarray]:
    """Force and its derivatives, each (n,), by the names under which a robot asks for them."""
    force, stiffness = of.force(pressure, length)
    by_pressure, by_length = of.stiffening(pressure, length).T
    return {
        "force": force, "pull": of.pull(pressure, length), "stiffness": stiffness,
        "stiffness_by_pressure": by_pressure, "stiffness_by_length": by_length,
    }  # fmt: skip


def _rough(of: Inverse, values: Doubt, seed: int) -> tuple[np.ndarray, float]:
    """A sum of low degree, and its largest error at some random points."""
    x = _nodes(LOW)
    p, l = (g.ravel() for g in np.meshgrid(_to(x, of.pressures), _to(x, of.lengths), indexing="ij"))
    table = _fitted(values(p, l).reshape(LOW + 1, LOW + 1), LOW)
    a, b = np.random.default_rng(seed).uniform(-1, 1, (2, FEW))
    got = np.einsum("ni,ij,nj->n", chebvander(a, LOW), table, chebvander(b, LOW))
    return table, float(np.max(np.abs(got - values(_to(a, of.pressures), _to(b, of.lengths)))))


def _unknown(pressure: np.ndarray, length: np.ndarray) -> np.ndarray:
    return np.full(np.shape(pressure), np.nan)


def _write(path: Path, table: dict[str, np.ndarray]) -> None:
    with write_beside(path) as beside, beside.open("wb") as file:
        np.savez(file, **table)  # pyright: ignore[reportArgumentType]

"""Export of a muscle's inverse model as Chebyshev series with measured errors, for a robot without JAX."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.polynomial.chebyshev import chebfit, chebvander

from pamjax.control import standalone
from pamjax.control.command_uncertainty import ForceUncertainty
from pamjax.control.inverse import CommandLimit, Inverse
from pamjax.control.neglected import compute_friction_half_loop
from pamjax.errors import BadInput, check_minimum
from pamjax.notebook import NotebookText
from pamjax.records.files import write_folder_atomically
from pamjax.units import format_quantity

#: Degrees of the series, tried in this order until the error is small enough.
_CHEBYSHEV_DEGREES = (8, 12, 16, 24, 32, 48)

#: Permitted interpolation error as a share of the output's range, and the outputs that must satisfy it.
_TARGET_ERROR, _CHECKED_OUTPUTS = 1e-5, ("force", "stiffness", "pressure", "length")

#: Number of random points at which the error is measured, and the ratio of stated to largest measured error.
_TEST_POINTS, _ERROR_MARGIN = 20_000, 2.0

#: Number of points and degree for outputs that are themselves uncertain by a few per cent: friction and sd.
_ROUGH_TEST_POINTS, _ROUGH_DEGREE = 500, 12

#: Minimum pressure for a commanded length, as a share of the highest one: without pressure, no stiffness.
_MIN_PRESSURE_SHARE = 0.05

#: Lower pressure limits of a table, as shares of the highest pressure, tried if the lowest pressure is not
#: possible: at low pressure, rubber may keep the muscle open. A limit must leave this share of the lengths.
_START_PRESSURE_SHARES, _MIN_LENGTH_SHARE = (0.05, 0.1, 0.2, 0.3, 0.5), 0.6


@dataclass(frozen=True, repr=False)
class ExportedController(NotebookText):
    """The written files, with the table's range and interpolation error.

    Attributes:
        files: the table and the module that reads it.
        pressures, lengths: range of the table, Pa and m.
        degree: polynomial degree of the series.
        error: stated error by output, SI: twice the largest measured error.
        largest_share: the largest stated error as a share of its output's range.
        uncertainty: source of the force's standard deviation, a key of `standalone.UNCERTAINTY_TEXTS`.
        force_sd: median and largest standard deviation of the force over the range, N; NaN if unknown.
        pressure_sd: the same of the commanded pressure, Pa.
    """

    files: tuple[Path, Path]
    pressures: tuple[float, float]
    lengths: tuple[float, float]
    degree: int
    error: dict[str, float]
    largest_share: float
    uncertainty: str = "unknown"
    force_sd: tuple[float, float] = (np.nan, np.nan)
    pressure_sd: tuple[float, float] = (np.nan, np.nan)

    def __str__(self) -> str:
        units = {"pressure": "Pa", "length": "um", "force": "N", "stiffness": "N/m"}
        errors = ", ".join(f"{n} {format_quantity(self.error[n], u, 2)}" for n, u in units.items())
        (low, high), (short, long) = self.pressures, self.lengths
        covered_range = (
            f"{format_quantity(low, 'kPa')} to {format_quantity(high, 'kPa')},"
            f" {format_quantity(short, 'mm')} to {format_quantity(long, 'mm')}"
        )
        return (
            f"range {covered_range}; Chebyshev series of degree {self.degree}"
            f"\n  interpolation error below {errors}\n  {self._format_uncertainty()}"
        )

    def _format_uncertainty(self) -> str:
        source = standalone.UNCERTAINTY_TEXTS[self.uncertainty]
        if not np.isfinite(self.force_sd[0]):
            return f"uncertainty of the model: {standalone.UNCERTAINTY_TEXTS['unknown']}"
        (force, max_force), (pressure, max_pressure) = self.force_sd, self.pressure_sd
        return (
            f"uncertainty of the model, one standard deviation: force {format_quantity(force, 'N', 2)}"
            f" (at most {format_quantity(max_force, 'N', 2)}), pressure {format_quantity(pressure, 'kPa', 2)}"
            f" (at most {format_quantity(max_pressure, 'kPa', 2)}); from {source}"
        )


def export(
    inverse: Inverse,
    folder: str | Path,
    *,
    force_sd: ForceUncertainty | None = None,
    uncertainty: str = "calibration",
    seed: int = 0,
) -> ExportedController:
    """Write controller.npz and controller.py, and return their range and errors.

    Args:
        inverse: the inverse model. Its range is reduced to where every force between the lowest and the
            highest is possible.
        folder: folder for the files.
        force_sd: function for the force's standard deviation; None if it is unknown.
        uncertainty: its source, a key of `standalone.UNCERTAINTY_TEXTS`.
        seed: seed of the random test points.

    Returns:
        the `ExportedController` with paths of the files, range and stated errors, SI.

    Raises:
        BadInput: if no such range exists.

    Example:
        inverse = pamjax.inverse(pamjax.load_muscle("mine"), pressures=(50e3, 400e3), lengths=(0.17, 0.19))
        print(pamjax.export(inverse, "out/controller"))
    """
    check_minimum("seed", seed, 0)
    folder = Path(folder)
    inverse = narrow_range(inverse)
    folder.parent.mkdir(parents=True, exist_ok=True)
    table, share, degree = {}, np.inf, 0
    for degree in _CHEBYSHEV_DEGREES:
        trial_table = _build_table(inverse, degree)
        # A trial table has no stated errors, so it must not be in the folder even for a moment.
        with TemporaryDirectory() as trial_folder:
            errors_and_shares = _measure_errors(inverse, trial_table, Path(trial_folder), seed)
        if max(errors_and_shares[1].values()) < share:
            table, share, error = trial_table, max(errors_and_shares[1].values()), errors_and_shares[0]
        if share < _TARGET_ERROR:
            break
    rough_outputs = {
        "friction": lambda p, l: compute_friction_half_loop(inverse.muscle, p, l),
        "sd": force_sd or _return_unknown,
    }
    for name, values in rough_outputs.items():
        table[name], error[name] = _fit_rough(inverse, values, seed)
    stated_errors = {name: _ERROR_MARGIN * value for name, value in error.items()}
    table |= {f"error_{name}": np.array(value) for name, value in stated_errors.items()}
    uncertainty = uncertainty if np.isfinite(error["sd"]) else "unknown"
    table["uncertainty"] = np.array(uncertainty)
    with write_folder_atomically(folder) as temporary:
        _write_table(temporary / "controller.npz", table)
        shutil.copyfile(standalone.__file__, temporary / "controller.py")
    files = folder / "controller.npz", folder / "controller.py"
    return ExportedController(
        files,
        inverse.pressures,
        inverse.lengths,
        degree,
        stated_errors,
        _ERROR_MARGIN * share,
        uncertainty,
        *_summarise_sds(standalone.Controller(files[0]), seed),
    )


def _summarise_sds(
    controller: standalone.Controller, seed: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the median and the largest sd of the force, N, and of the commanded pressure, Pa."""
    rng = np.random.default_rng(seed)
    p, l = (
        rng.uniform(ends[0], ends[1], _ROUGH_TEST_POINTS)
        for ends in (controller.pressures, controller.lengths)
    )
    force_sd = controller.sd(p, l)
    pressure_sd = force_sd / controller.pull(p, l)
    return tuple((float(np.median(x)), float(np.max(x))) for x in (force_sd, pressure_sd))  # pyright: ignore[reportReturnType]


def narrow_range(inverse: Inverse) -> Inverse:
    """Return the inverse model on the range in which every force between both ends is possible.

    The range starts at the lowest pressure that keeps most lengths, otherwise at the one that keeps the
    largest share of lengths.

    Raises:
        BadInput: if less than a tenth of the lengths remains.
    """
    lowest, high = inverse.pressures
    start_pressures = [lowest, *(share * high for share in _START_PRESSURE_SHARES if share * high > lowest)]
    best, best_share = inverse, 0.0
    for low in start_pressures:
        lengths = np.linspace(*inverse.lengths, 201)
        first_index = _find_first_solvable(Inverse(inverse.muscle, (low, high), inverse.lengths), lengths)
        length_share = 1 - first_index / lengths.size
        if length_share > best_share:
            best, best_share = (
                Inverse(inverse.muscle, (low, high), (float(lengths[first_index]), float(lengths[-1]))),
                length_share,
            )
        if length_share >= _MIN_LENGTH_SHARE:
            break
    if best_share < 0.1:
        rule = "a controller needs a range of pressure and length in which pressure increases the force"
        raise BadInput.from_rule(
            rule, "almost no such length", remedy="State a longer length, or a higher pressure."
        )
    return best


def _find_first_solvable(inverse: Inverse, lengths: np.ndarray) -> int:
    """Return the index of the first increasing length from which all longer ones have a command."""
    solvable = np.ones(lengths.size, dtype=bool)
    low, high = inverse.pressures
    for pressure in np.linspace(low, high, 9):
        force, stiffness = inverse.force(pressure, lengths)
        command = inverse.pressure(force, lengths)
        solvable &= (np.asarray(command.status) == CommandLimit.OK) & np.isfinite(force)
        if pressure >= _MIN_PRESSURE_SHARE * high:
            solvable &= stiffness > 0
    unsolvable = np.flatnonzero(~solvable)
    return int(unsolvable.max()) + 1 if unsolvable.size else 0


def _restrict_pressures(inverse: Inverse) -> Inverse:
    """Return the inverse model from the lowest pressure at which a length can be commanded."""
    low, high = inverse.pressures
    return Inverse(inverse.muscle, (max(low, _MIN_PRESSURE_SHARE * high), high), inverse.lengths)


def _compute_nodes(degree: int) -> np.ndarray:
    """Return the Chebyshev points in [-1, 1], with both ends, (degree + 1,)."""
    return -np.cos(np.pi * np.arange(degree + 1) / degree)


def _map_to_range(x: np.ndarray, limits: tuple[float, float]) -> np.ndarray:
    return (limits[0] + limits[1]) / 2 + x * (limits[1] - limits[0]) / 2


def _fit_chebyshev(values: np.ndarray, degree: int) -> np.ndarray:
    """Return the coefficients (i, j) from values at Chebyshev points in both directions."""
    inverse_vandermonde = np.linalg.inv(chebvander(_compute_nodes(degree), degree))
    return inverse_vandermonde @ values @ inverse_vandermonde.T


def _build_table(inverse: Inverse, degree: int) -> dict[str, np.ndarray]:
    x = _compute_nodes(degree)
    p, l = (
        g.ravel()
        for g in np.meshgrid(
            _map_to_range(x, inverse.pressures), _map_to_range(x, inverse.lengths), indexing="ij"
        )
    )
    square = degree + 1, degree + 1
    restricted_inverse = _restrict_pressures(inverse)
    table = {
        "pressures": np.array(inverse.pressures), "holding": np.array(restricted_inverse.pressures),
        "lengths": np.array(inverse.lengths),
    }  # fmt: skip
    table |= {
        name: _fit_chebyshev(values.reshape(square), degree)
        for name, values in _compute_forward(inverse, p, l).items()
    }
    inverses: list[tuple[str, Callable, tuple[float, float], tuple[float, float]]] = [
        ("pressure", inverse.pressure, inverse.lengths, inverse.pressures),
        ("length", restricted_inverse.length, restricted_inverse.pressures, inverse.lengths),
    ]
    for name, solve, given_range, value_range in inverses:
        given_values = _map_to_range(x, given_range)
        end_forces = [
            inverse.force(e, given_values)[0] if name == "pressure" else inverse.force(given_values, e)[0]
            for e in value_range
        ]
        for end, values in zip(("least", "most"), end_forces, strict=True):
            table[f"{name}_{end}"] = chebfit(x, values, degree)
        forces = end_forces[0] + (x[:, None] + 1) / 2 * (end_forces[1] - end_forces[0])
        given_grid = np.broadcast_to(given_values, square)
        solution = np.asarray(solve(forces.ravel(), given_grid.ravel()).value)
        table[name] = _fit_chebyshev(solution.reshape(square), degree)
    return table


def _measure_errors(
    inverse: Inverse, table, folder: Path, seed: int
) -> tuple[dict[str, float], dict[str, float]]:
    """Return the largest errors of the exported code at random points, SI and as shares of the range."""
    _write_table(folder / "controller.npz", table)
    controller = standalone.Controller(folder / "controller.npz")
    rng = np.random.default_rng(seed)
    p, l = (rng.uniform(*ends, _TEST_POINTS) for ends in (inverse.pressures, inverse.lengths))
    exact = _compute_forward(inverse, p, l)
    pairs = {name: (getattr(controller, name)(p, l), values) for name, values in exact.items()}
    pairs["pressure"] = controller.pressure(exact["force"], l)[0], p
    restricted_pressures = _map_to_range(
        2 * (p - inverse.pressures[0]) / np.ptp(inverse.pressures) - 1, _restrict_pressures(inverse).pressures
    )
    pairs["length"] = controller.length(inverse.force(restricted_pressures, l)[0], restricted_pressures)[0], l
    errors = {
        name: float(np.max(np.abs(computed - expected))) for name, (computed, expected) in pairs.items()
    }
    return errors, {name: errors[name] / float(np.ptp(pairs[name][1])) for name in _CHECKED_OUTPUTS}


def _compute_forward(inverse: Inverse, pressure: np.ndarray, length: np.ndarray) -> dict[str, np.ndarray]:
    """Return force and its derivatives, each (n,), by the names of the exported functions."""
    force, stiffness = inverse.force(pressure, length)
    by_pressure, by_length = inverse.stiffness_slopes(pressure, length).T
    return {
        "force": force, "pull": inverse.pull(pressure, length), "stiffness": stiffness,
        "stiffness_by_pressure": by_pressure, "stiffness_by_length": by_length,
    }  # fmt: skip


def _fit_rough(inverse: Inverse, function: ForceUncertainty, seed: int) -> tuple[np.ndarray, float]:
    """Return the coefficients of a series of low degree, and its largest error at random points."""
    x = _compute_nodes(_ROUGH_DEGREE)
    p, l = (
        g.ravel()
        for g in np.meshgrid(
            _map_to_range(x, inverse.pressures), _map_to_range(x, inverse.lengths), indexing="ij"
        )
    )
    coefficients = _fit_chebyshev(function(p, l).reshape(_ROUGH_DEGREE + 1, _ROUGH_DEGREE + 1), _ROUGH_DEGREE)
    a, b = np.random.default_rng(seed).uniform(-1, 1, (2, _ROUGH_TEST_POINTS))
    fitted_values = np.einsum(
        "ni,ij,nj->n", chebvander(a, _ROUGH_DEGREE), coefficients, chebvander(b, _ROUGH_DEGREE)
    )
    return coefficients, float(
        np.max(
            np.abs(
                fitted_values
                - function(_map_to_range(a, inverse.pressures), _map_to_range(b, inverse.lengths))
            )
        )
    )


def _return_unknown(pressure: np.ndarray, length: np.ndarray) -> np.ndarray:
    return np.full(np.shape(pressure), np.nan)


def _write_table(path: Path, table: dict[str, np.ndarray]) -> None:
    with path.open("wb") as file:
        np.savez(file, **table)  # pyright: ignore[reportArgumentType]

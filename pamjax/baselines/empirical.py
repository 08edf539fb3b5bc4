"""Empirical force laws for comparison: Gaylord's cylinder and Sárosi's formula.

Both are laws for the force only, with numpy and scipy. Both are fitted to their global least-squares optimum,
so that a bad starting value does not decide a comparison.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar, nnls

from pamjax.errors import BadInput
from pamjax.units import format_quantity

Vector = NDArray[np.float64]

#: Range of |c| × (span of contraction) that is searched. Below it the exponential is a parabola to 1 %,
#: above it a step that affects only the last length.
_MIN_EXPONENT_SPAN, _MAX_EXPONENT_SPAN = 0.02, 50.0


@dataclass(frozen=True)
class Gaylord:
    """Gaylord's law: a cylinder of inextensible threads with a threshold pressure.

    F = (P − P₀) (3 L² − B²) / (4 π N²)

    ========  =================  ====  ==========================================
    symbol    name               unit  meaning
    ========  =================  ====  ==========================================
    F         `force`            N     tension, positive pulls
    P         `pressure`         Pa    gauge
    L         `length`           m     between the fittings
    B         `thread_length`    m     of one thread
    N         `turns`            1     of one thread
    P₀        `threshold`        Pa    lost in the rubber; 0 in the original law
    ========  =================  ====  ==========================================

    Neglects: thread stretch, rubber elasticity, end effects, friction. The force can be negative. A
    threshold has the same effect as a zero error of the pressure gauge.
    Source: R. H. Gaylord, U.S. Patent 2,844,126 (1958); Chambers & Wereley, *Actuators* 2022, 11, 219, eq 12;
    the threshold is a common addition.

    >>> f"{Gaylord(thread_length=0.2512, turns=1.09).force(689e3, 0.2357):.0f} N"
    '4779 N'
    """

    thread_length: float
    turns: float
    threshold: float = 0.0

    def force(self, pressure: ArrayLike, length: ArrayLike) -> Vector:
        """Return the tension, N, at gauge pressure, Pa, and length, m."""
        area = (3 * np.square(length) - self.thread_length**2) / (4 * np.pi * self.turns**2)
        return (np.asarray(pressure, float) - self.threshold) * area

    def __str__(self) -> str:
        return (
            f"Gaylord: thread length {format_quantity(self.thread_length, 'mm')}, {self.turns:.4g} turns, "
            f"threshold {format_quantity(self.threshold, 'kPa')}"
        )


@dataclass(frozen=True)
class Sarosi:
    """Sárosi's six-parameter formula for fluidic muscles.

    F = (a P + b) exp(c κ) + d κ P + e P + f

    ========  ==============  =====  ==========================================
    symbol    name            unit   meaning
    ========  ==============  =====  ==========================================
    F         `force`         N      tension, positive pulls
    P         `pressure`      Pa     gauge
    κ         `contraction`   1      1 − length / rest length, as a fraction
    a, e      `a`, `e`        N/Pa   fitted
    b, f      `b`, `f`        N      fitted
    c         `c`             1      fitted, of either sign
    d         `d`             N/Pa   fitted
    ========  ==============  =====  ==========================================

    Papers use κ in percent and P in bar or kPa, which only rescales the coefficients. `at_limit`: c is at a
    bound of its search range. The data then fit a parabola, or a step between two lengths.

    Neglects: direction, rate, history and geometry. It is valid only for the fitted muscle.
    Source: J. Sárosi uses such a formula for Festo muscles in *Tehnički vjesnik* 2015, 22(6), 1489,
    doi 10.17559/TV-20140716143627 (its abstract was checked, the equation was not). The formula probably
    comes from a conference paper of about 2012.
    """

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float
    at_limit: bool = False

    def force(self, pressure: ArrayLike, contraction: ArrayLike) -> Vector:
        """Return the tension, N, at gauge pressure, Pa, and contraction, a fraction."""
        p, k = np.asarray(pressure, float), np.asarray(contraction, float)
        return (self.a * p + self.b) * np.exp(self.c * k) + self.d * k * p + self.e * p + self.f

    def __str__(self) -> str:
        text = ", ".join(
            f"{x.name} {getattr(self, x.name):.4g}" for x in fields(self) if x.name != "at_limit"
        )
        return f"Sárosi: {text}" + (" (c at a limit)" if self.at_limit else "")


def fit_gaylord(
    pressure: ArrayLike, length: ArrayLike, force: ArrayLike, *, threshold: bool = False
) -> Gaylord:
    """Fit thread length, turns and, optionally, a threshold by least squares in force.

    For a given threshold the law is linear in 1/N² and B²/N²: one bounded linear solve is the global optimum.
    The bound keeps the thread at least as long as the longest muscle.

    Args:
        pressure: (n,) gauge pressure, Pa.
        length: (n,) distance between the fittings, m.
        force: (n,) tension, N. Rows with a blank (NaN) are left out.
        threshold: whether to fit a threshold pressure too.

    Raises:
        BadInput: if there are fewer than two lengths (or, with a threshold, pressures), or the force does not
            increase with pressure.
    """
    p, l, tension = _drop_blank_rows(pressure=pressure, length=length, force=force)
    _check_level_count(l, 2, "length", "m")
    pressure_threshold = 0.0
    if threshold:
        _check_level_count(p, 2, "pressure", "Pa")
        # A threshold below zero is a gauge that reads low; one near the top leaves nothing to pull with.
        pressure_threshold = _minimise_on_grid(
            lambda x: _fit_gaylord_coefficients(p - x, l, tension)[1], np.linspace(-0.5, 0.9, 57) * p.max()
        )[1]
    (slope, offset), _ = _fit_gaylord_coefficients(p - pressure_threshold, l, tension)
    if slope <= 0:
        raise BadInput.from_rule(
            "`force` must increase with `pressure`", "a force that does not increase", remedy="Check signs."
        )
    thread = np.sqrt(l.max() ** 2 + 3 * offset / slope)
    return Gaylord(float(thread), float(np.sqrt(3 / (4 * np.pi * slope))), float(pressure_threshold))


def fit_sarosi(pressure: ArrayLike, contraction: ArrayLike, force: ArrayLike) -> Sarosi:
    """Fit the six coefficients by least squares in force.

    For a given c the formula is linear, so only c is searched. The search evaluates a grid of both signs,
    then minimises with bounds around each local minimum of the grid. A search from one start often ends in a
    wrong minimum.

    Args:
        pressure: (n,) gauge pressure, Pa.
        contraction: (n,) 1 − length / rest length, a fraction.
        force: (n,) tension, N. Rows with a blank (NaN) are left out.

    Raises:
        BadInput: if there are fewer than two pressures, three contractions or six rows.
    """
    p, k, tension = _drop_blank_rows(pressure=pressure, contraction=contraction, force=force)
    if p.size < 6:
        raise BadInput.from_rule(
            "six coefficients need at least six rows",
            f"{p.size}",
            remedy="Measure at more pressures and lengths.",
        )
    _check_level_count(p, 2, "pressure", "Pa")
    _check_level_count(k, 3, "contraction", "")
    rate, at_limit = _search_exponent(p, k, tension)
    a, b, d, e, f = map(float, _fit_sarosi_coefficients(rate, p, k, tension)[0])
    return Sarosi(a, b, rate, d, e, f, at_limit=at_limit)


def _search_exponent(p: Vector, k: Vector, force: Vector) -> tuple[float, bool]:
    """Return the c with the smallest misfit, and whether it is at a bound of the search range."""
    span = np.ptp(k)
    # If all contractions are close together and far from zero, exp(c κ) must not overflow.
    high = min(_MAX_EXPONENT_SPAN, 300 * span / np.abs(k).max())
    sizes = np.linspace(np.log(_MIN_EXPONENT_SPAN), np.log(high), 60)
    sides = []
    for sign in (-1.0, 1.0):

        def misfit(size: float, sign: float = sign) -> float:
            return _fit_sarosi_coefficients(sign * np.exp(size) / span, p, k, force)[1]

        value, size, at_end = _minimise_on_grid(misfit, sizes)
        sides.append((value, sign * float(np.exp(size)) / span, at_end))
    _, rate, at_end = min(sides)
    return rate, at_end


def _minimise_on_grid(misfit: Callable[[float], float], grid: Vector) -> tuple[float, float, bool]:
    """Return the smallest value over a grid range, its argument, and whether it is at an end."""
    values = np.array([misfit(x) for x in grid])
    best = []
    for i in _find_local_minima(values):
        around = (grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)])
        minimum: Any = minimize_scalar(
            misfit, bounds=around, method="bounded", options={"xatol": 1e-9 * np.ptp(grid)}
        )
        best.append(min((float(minimum.fun), float(minimum.x)), (float(values[i]), float(grid[i]))))
    value, argument = min(best)
    return value, argument, bool(min(argument - grid[0], grid[-1] - argument) < 1e-6 * np.ptp(grid))


def _find_local_minima(values: Vector) -> NDArray[np.intp]:
    """Return the indices of the local minima of a sequence, ends included."""
    padded_values = np.concatenate([[np.inf], values, [np.inf]])
    return np.flatnonzero((values <= padded_values[:-2]) & (values <= padded_values[2:]))


def _fit_gaylord_coefficients(p: Vector, l: Vector, force: Vector) -> tuple[Vector, float]:
    """Return the two non-negative linear coefficients of the cylinder, and the sum of squares."""
    longest = l.max()
    design = np.column_stack([p * (l**2 - longest**2 / 3), -p])
    scale = np.linalg.norm(design, axis=0)
    if not scale.all():
        rule = "`pressure` must differ from zero in some row"
        raise BadInput.from_rule(rule, "0 Pa in every row", remedy="Check its column.")
    scaled_coefficients, norm = nnls(design / scale, force)
    return scaled_coefficients / scale, float(norm**2)


def _fit_sarosi_coefficients(rate: float, p: Vector, k: Vector, force: Vector) -> tuple[Vector, float]:
    """Return the coefficients a, b, d, e, f for a given c, and the sum of squares."""
    # The exponential is scaled by its largest value to avoid overflow; a and b are scaled back afterwards.
    end = k.max() if rate > 0 else k.min()
    curve = np.exp(rate * (k - end))
    design = np.column_stack([p * curve, curve, k * p, p, np.ones_like(p)])
    scale = np.linalg.norm(design, axis=0)
    scaled_coefficients = np.linalg.lstsq(design / scale, force, rcond=None)[0]
    misfit = force - (design / scale) @ scaled_coefficients
    back = np.exp(-rate * end) * np.array([1, 1, 0, 0, 0]) + np.array([0, 0, 1, 1, 1])
    return scaled_coefficients / scale * back, float(misfit @ misfit)


def _drop_blank_rows(**columns: ArrayLike) -> list[Vector]:
    """Return the columns as flat arrays without the rows in which one of them is blank."""
    arrays = {name: np.asarray(column, float).ravel() for name, column in columns.items()}
    sizes = {name: array.size for name, array in arrays.items()}
    if len(set(sizes.values())) > 1:
        got = ", ".join(f"{size} of `{name}`" for name, size in sizes.items())
        raise BadInput.from_rule(
            "columns must have the same number of rows", got, remedy="Pass one row for each sample."
        )
    complete_rows = np.all(np.isfinite(list(arrays.values())), axis=0)
    if not complete_rows.any():
        raise BadInput.from_rule("a fit needs rows without blank values", "none", remedy="Check the columns.")
    return [array[complete_rows] for array in arrays.values()]


def _check_level_count(values: Vector, min_count: int, name: str, unit: str) -> None:
    """Refuse a column with too few different values; values within 0.1 % of the largest count as one."""
    size = np.abs(values).max()
    count = np.unique(np.round(values / size, 3)).size if size > 0 else 1
    if count < min_count:
        raise BadInput.from_rule(
            f"this fit needs at least {min_count} different values of `{name}`",
            f"{count}, near {np.mean(values):.4g} {unit}".rstrip(),
            remedy=f"Measure at another {name}.",
        )

"""The constrained search: SciPy's SLSQP or trust-constr on exact slopes, and what its multipliers mean.

    minimise f(z) subject to m_j(z) >= 0, 0 <= z <= 1          f = ln(objective), m the scaled margins
    ∇f = Σ λ_j ∇m_j + limits,   λ_j >= 0                       where it is stationary

λ is found again from the slopes at the answer, by non-negative least squares on what binds: whatever the
solver did on its way, the residual of this equation says whether the answer is one. Where a spec cannot be
met, the largest broken margin is made small instead (elastic mode).

Source: Nocedal & Wright, Numerical Optimization, 2006, chs. 12, 18 and 19; SLSQP after Kraft, DFVLR-FB 88-28.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, minimize, nnls

from pamjax.sizing.problem import Problem

#: Margin below zero that still counts as kept: a millionth of what is required.
KEPT = 1e-6
#: Margin below which a requirement binds.
BINDS = 1e-5
#: Steps of a search.
STEPS = 200
METHODS = ("slsqp", "trust-constr")


@dataclass(frozen=True, eq=False)
class Answer:
    """Where a search ended.

    Attributes:
        z: (free,) scaled coordinates.
        value: ln of the objective.
        margins: (rows,) what is left.
        multipliers: (rows,) λ, zero where nothing binds.
        stationary: largest residual of ∇f = Σ λ ∇m, over the size of ∇f.
        steps: of the solver.
    """

    z: np.ndarray
    value: float
    margins: np.ndarray
    multipliers: np.ndarray
    stationary: float
    steps: int

    @property
    def kept(self) -> bool:
        """Whether every requirement is."""
        return bool(np.min(self.margins) >= -KEPT)


def search(problem: Problem, start: np.ndarray, method: str = "slsqp") -> Answer:
    """The best candidate that a search finds from a start, (free,) scaled."""
    if method == "trust-constr":
        z, steps = _trust(problem, start)
    else:
        z, steps = _slsqp(problem, start)
    value, slope, margins, slopes = problem.at(z)
    multipliers, stationary = multiply(z, slope, margins, slopes)
    return Answer(z, value, margins, multipliers, stationary, steps)


def _slsqp(problem: Problem, start: np.ndarray) -> tuple[np.ndarray, int]:
    keep = {
        "type": "ineq",
        "fun": lambda z: problem.at(z)[2].copy(),
        "jac": lambda z: problem.at(z)[3].copy(),
    }
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        # A line search that leaves the box is clipped by SciPy, with a warning.
        warnings.simplefilter("ignore")
        found = minimize(
            lambda z: problem.at(z)[0],
            start,
            jac=lambda z: problem.at(z)[1].copy(),
            bounds=Bounds(0.0, 1.0),
            constraints=[keep],
            method="SLSQP",
            options={"maxiter": STEPS, "ftol": 1e-12},
        )
    return np.clip(found.x, 0.0, 1.0), int(found.nit)


def _trust(problem: Problem, start: np.ndarray) -> tuple[np.ndarray, int]:
    nothing = np.zeros(problem.rows.size)
    keep = NonlinearConstraint(
        lambda z: problem.at(z)[2].copy(),
        0.0,
        np.inf,
        # SciPy's types know only its names for finite differences.
        jac=lambda z: problem.at(z)[3].copy(),  # pyright: ignore[reportArgumentType]
        hess=lambda z, weights: problem.curvature(z, np.asarray(weights)),
    )
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        found = minimize(
            lambda z: problem.at(z)[0],
            np.clip(start, 1e-3, 1 - 1e-3),
            jac=lambda z: problem.at(z)[1].copy(),
            hess=lambda z: problem.curvature(z, nothing, 1.0),
            bounds=Bounds(0.0, 1.0),
            constraints=[keep],
            method="trust-constr",
            options={"maxiter": 500, "gtol": 1e-9, "xtol": 1e-10, "barrier_tol": 1e-9},
        )
    return np.clip(found.x, 0.0, 1.0), int(found.nit)


def multiply(
    z: np.ndarray, slope: np.ndarray, margins: np.ndarray, slopes: np.ndarray, binds: float = BINDS
) -> tuple[np.ndarray, float]:
    """The multipliers of what binds, (rows,), and how far from stationary the rest is."""
    active = np.flatnonzero(margins < binds)
    at_low, at_high = np.flatnonzero(z < 1e-9), np.flatnonzero(z > 1 - 1e-9)
    sides = np.eye(z.size)
    columns = np.concatenate([slopes[active], sides[at_low], -sides[at_high]]).T
    found = np.zeros(margins.size)
    if not columns.size:
        return found, 1.0
    weights, left = nnls(columns, slope)
    found[active] = weights[: active.size]
    return found, float(left / max(np.linalg.norm(slope), 1e-12))


def relax(
    problem: Problem, start: np.ndarray, weights: np.ndarray | None = None
) -> tuple[np.ndarray, float, np.ndarray]:
    """Make the largest broken margin small: minimise s subject to m_j + w_j s >= 0, s >= 0.

    Args:
        weights: (rows,) w, one if left out; zero for a requirement that may not give.

    Returns:
        z (free,), s, and the multipliers (rows,), which say what binds; they sum to one where w is one.
    """
    w = np.ones(problem.rows.size) if weights is None else weights
    z0 = np.clip(start, 0.0, 1.0)
    first = max(0.0, float(-np.min(problem.at(z0)[2])))
    n = z0.size

    def margins(x):
        return problem.at(x[:n])[2] + w * x[n]

    def slopes(x):
        return np.column_stack([problem.at(x[:n])[3], w])

    only = np.zeros(n + 1)
    only[n] = 1.0
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        found = minimize(
            lambda x: x[n],
            np.append(z0, first),
            jac=lambda x: only,
            bounds=[(0.0, 1.0)] * n + [(0.0, None)],
            constraints=[{"type": "ineq", "fun": margins, "jac": slopes}],
            method="SLSQP",
            options={"maxiter": STEPS, "ftol": 1e-12},
        )
    z = np.clip(found.x[:n], 0.0, 1.0)
    z, s = (z0, first) if problem.lost(z) else (z, float(found.x[n]))
    here = problem.at(z)[2]
    if np.any(w > 0):
        # What the answer itself needs, whatever the solver says of it.
        s = max(0.0, float(np.max(-here[w > 0] / w[w > 0])))
    sizes, _ = multiply(np.append(z, 0.5), only, here + w * s, np.column_stack([problem.at(z)[3], w]))
    return z, s, sizes

"""Constrained optimisation by SciPy's SLSQP or trust-constr with exact derivatives, and its multipliers.

    minimise f(z) subject to m_j(z) >= 0, 0 <= z <= 1          f = ln(objective), m the scaled margins
    ∇f = Σ λ_j ∇m_j + bounds,   λ_j >= 0                       at a stationary point

λ is computed from the slopes at the result by non-negative least squares over the active constraints. The
residual of this equation tests the optimality of the result, independently of the solver. For an infeasible
spec, the largest violation is minimised instead (elastic mode).

Source: Nocedal & Wright, Numerical Optimization, 2006, chs. 12, 18 and 19; SLSQP after Kraft, DFVLR-FB 88-28.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, minimize, nnls

from pamjax.sizing.problem import SizingProblem

#: Permitted violation of a requirement: a millionth of its bound.
MARGIN_TOLERANCE = 1e-6
#: Margin below which a requirement is active.
_BINDING_MARGIN = 1e-5
#: Largest number of steps of a search.
_MAX_SEARCH_STEPS = 200
#: The same for the smallest violation. Longer searches are at the limit of equilibrium: most steps fail.
_MAX_VIOLATION_STEPS = 60
METHODS = ("slsqp", "trust-constr")


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The result of a search.

    Attributes:
        z: (free,) scaled coordinates.
        log_objective: ln of the objective.
        margins: (rows,) margins of the requirements.
        multipliers: (rows,) λ, zero for inactive requirements.
        stationarity: norm of the residual of ∇f = Σ λ ∇m / norm of ∇f.
        step_count: number of steps of the solver.
    """

    z: np.ndarray
    log_objective: float
    margins: np.ndarray
    multipliers: np.ndarray
    stationarity: float
    step_count: int

    @property
    def is_feasible(self) -> bool:
        """Return whether all requirements are met."""
        return bool(np.min(self.margins) >= -MARGIN_TOLERANCE)


def search_optimum(problem: SizingProblem, start: np.ndarray, method: str = "slsqp") -> SearchResult:
    """Return the local optimum that a search reaches from a start, (free,) scaled."""
    if method == "trust-constr":
        z, steps = _run_trust_constr(problem, start)
    else:
        z, steps = _run_slsqp(problem, start)
    log_objective, slope, margins, slopes = problem.evaluate(z)
    multipliers, stationarity = _estimate_multipliers(z, slope, margins, slopes)
    return SearchResult(z, log_objective, margins, multipliers, stationarity, steps)


def _run_slsqp(problem: SizingProblem, start: np.ndarray) -> tuple[np.ndarray, int]:
    constraint = {
        "type": "ineq",
        "fun": lambda z: problem.evaluate(z)[2].copy(),
        "jac": lambda z: problem.evaluate(z)[3].copy(),
    }
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        # SciPy clips a line search that leaves the bounds, and warns.
        warnings.simplefilter("ignore")
        result = minimize(
            lambda z: problem.evaluate(z)[0],
            start,
            jac=lambda z: problem.evaluate(z)[1].copy(),
            bounds=Bounds(0.0, 1.0),
            constraints=[constraint],
            method="SLSQP",
            options={"maxiter": _MAX_SEARCH_STEPS, "ftol": 1e-12},
        )
    return np.clip(result.x, 0.0, 1.0), int(result.nit)


def _run_trust_constr(problem: SizingProblem, start: np.ndarray) -> tuple[np.ndarray, int]:
    zeros = np.zeros(problem.rows.size)
    constraint = NonlinearConstraint(
        lambda z: problem.evaluate(z)[2].copy(),
        0.0,
        np.inf,
        # The types of SciPy permit only the names of finite-difference methods.
        jac=lambda z: problem.evaluate(z)[3].copy(),  # pyright: ignore[reportArgumentType]
        hess=lambda z, weights: problem.compute_hessian(z, np.asarray(weights)),
    )
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        result = minimize(
            lambda z: problem.evaluate(z)[0],
            np.clip(start, 1e-3, 1 - 1e-3),
            jac=lambda z: problem.evaluate(z)[1].copy(),
            hess=lambda z: problem.compute_hessian(z, zeros, 1.0),
            bounds=Bounds(0.0, 1.0),
            constraints=[constraint],
            method="trust-constr",
            options={"maxiter": 500, "gtol": 1e-9, "xtol": 1e-10, "barrier_tol": 1e-9},
        )
    return np.clip(result.x, 0.0, 1.0), int(result.nit)


def _estimate_multipliers(
    z: np.ndarray,
    slope: np.ndarray,
    margins: np.ndarray,
    slopes: np.ndarray,
    binding_margin: float = _BINDING_MARGIN,
) -> tuple[np.ndarray, float]:
    """Return the multipliers, (rows,), and the relative norm of the residual of stationarity."""
    active = np.flatnonzero(margins < binding_margin)
    at_low, at_high = np.flatnonzero(z < 1e-9), np.flatnonzero(z > 1 - 1e-9)
    sides = np.eye(z.size)
    columns = np.concatenate([slopes[active], sides[at_low], -sides[at_high]]).T
    multipliers = np.zeros(margins.size)
    if not columns.size:
        return multipliers, 1.0
    weights, residual = nnls(columns, slope)
    multipliers[active] = weights[: active.size]
    return multipliers, float(residual / max(np.linalg.norm(slope), 1e-12))


def minimise_violation(
    problem: SizingProblem, start: np.ndarray, weights: np.ndarray | None = None
) -> tuple[np.ndarray, float, np.ndarray]:
    """Minimise the largest violation: minimise s subject to m_j + w_j s >= 0, s >= 0.

    Args:
        weights: (rows,) w, by default one; zero for a requirement that must be met.

    Returns:
        z (free,), s, and the multipliers (rows,), positive for active requirements. They sum to one if all w
        are one.
    """
    w = np.ones(problem.rows.size) if weights is None else weights
    z0 = np.clip(start, 0.0, 1.0)
    start_violation = max(0.0, float(-np.min(problem.evaluate(z0)[2])))
    n = z0.size

    def margins(x):
        return problem.evaluate(x[:n])[2] + w * x[n]

    def slopes(x):
        return np.column_stack([problem.evaluate(x[:n])[3], w])

    objective_slope = np.zeros(n + 1)
    objective_slope[n] = 1.0
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        result = minimize(
            lambda x: x[n],
            np.append(z0, start_violation),
            jac=lambda x: objective_slope,
            bounds=[(0.0, 1.0)] * n + [(0.0, None)],
            constraints=[{"type": "ineq", "fun": margins, "jac": slopes}],
            method="SLSQP",
            options={"maxiter": _MAX_VIOLATION_STEPS, "ftol": 1e-12},
        )
    z = np.clip(result.x[:n], 0.0, 1.0)
    z, violation = (z0, start_violation) if problem.is_unsolved(z) else (z, float(result.x[n]))
    margins_at_z = problem.evaluate(z)[2]
    if np.any(w > 0):
        # The violation at the result, instead of the value that the solver returns.
        violation = max(0.0, float(np.max(-margins_at_z[w > 0] / w[w > 0])))
    multipliers, _ = _estimate_multipliers(
        np.append(z, 0.5),
        objective_slope,
        margins_at_z + w * violation,
        np.column_stack([problem.evaluate(z)[3], w]),
    )
    return z, violation, multipliers

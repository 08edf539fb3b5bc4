"""Least squares with few evaluations of the Jacobian.

The Jacobian of a model costs as much as several predictions. It is therefore evaluated at the start and at
the solution. Between them, each step s corrects it by the change of the residual r along that step:

    J ← J + (Δr − J s) sᵀ / sᵀs

The Jacobian is evaluated again where the model is strongly curved, |Δr − J s| > ½ |J s|. The solution is
accepted if the next steps from it, with its own Jacobian, hardly decrease the cost.
Source: C. G. Broyden, Math. Comput. 19, 577 (1965); in units of the expected parameter widths.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np
from scipy.optimize import least_squares

Residual = Callable[[np.ndarray], np.ndarray]
ResidualAndJacobian = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]

#: Tolerances of the minimiser: relative decrease of the cost, relative step, gradient.
_COST_DECREASE_TOLERANCE, _STEP_TOLERANCE, _GRADIENT_TOLERANCE = 1e-5, 1e-7, 1e-10

#: The first of them for a rough minimisation.
_ROUGH_COST_DECREASE_TOLERANCE = 1e-4

#: Curvature |Δr − J s| / |J s| of a step, above which the Jacobian is evaluated.
_MAX_SECANT_CURVATURE = 0.5


@dataclass(frozen=True, eq=False)
class _Linearisation:
    """Residual, (m,), and its derivatives by the parameters in units of their widths, (m, k), at a point."""

    point: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray

    @property
    def cost(self) -> float:
        """Return half of the sum of squares."""
        return 0.5 * float(self.residual @ self.residual)

    @cached_property
    def triangle(self) -> np.ndarray:
        """Return R of the QR decomposition of the Jacobian with the residual as last column, (k + 1, k + 1).

        Its columns have the lengths and angles of the originals, which is all that a minimiser uses.
        The minimiser decomposes k + 1 rows instead of thousands.
        """
        columns = np.column_stack([self.jacobian, self.residual])
        return np.asarray(np.linalg.qr(columns, mode="r")) if columns.shape[0] > columns.shape[1] else columns


class _SecantFunction:
    """Residual and corrected Jacobian for the minimiser, which asks for a Jacobian only at its last point."""

    def __init__(
        self, evaluate: ResidualAndJacobian, evaluate_residual: Residual, start: np.ndarray, width: np.ndarray
    ) -> None:
        self._evaluate, self._evaluate_residual, self._width = evaluate, evaluate_residual, width
        self.base = self.last = self._linearise(start)
        self.start_cost = self.base.cost

    def compute_residual(self, point: np.ndarray) -> np.ndarray:
        """Return the residual in the basis of `triangle`."""
        if not np.array_equal(point, self.last.point):
            self.last = self._approach(point)
        return self.last.triangle[:, -1]

    def compute_jacobian(self, point: np.ndarray) -> np.ndarray:
        """Return the derivatives in the same basis."""
        self.compute_residual(point)
        self.base = self.last
        return self.base.triangle[:, :-1] / self._width

    def _linearise(self, point: np.ndarray) -> _Linearisation:
        residual, jacobian = self._evaluate(point)
        return _Linearisation(point.copy(), residual, jacobian * self._width)

    def _approach(self, point: np.ndarray) -> _Linearisation:
        """Return the linearisation at a new point, by a correction of that at the base."""
        residual, step = self._evaluate_residual(point), (point - self.base.point) / self._width
        if step @ step < _STEP_TOLERANCE**2:
            # The minimiser moves a point away from a limit by less than the rounding of the residual.
            return _Linearisation(point.copy(), residual, self.base.jacobian)
        expected_change = self.base.jacobian @ step
        error = residual - self.base.residual - expected_change
        is_curved = np.linalg.norm(error) > _MAX_SECANT_CURVATURE * np.linalg.norm(expected_change)
        if is_curved and residual @ residual < self.base.residual @ self.base.residual:
            return self._linearise(point)
        jacobian = self.base.jacobian + np.outer(error, step / (step @ step))
        return _Linearisation(point.copy(), residual, jacobian)


def minimise_least_squares(
    evaluate: ResidualAndJacobian,
    evaluate_residual: Residual,
    start: np.ndarray,
    limits: tuple[np.ndarray, np.ndarray],
    width: np.ndarray,
    max_evaluations: int,
    is_rough: bool = False,
) -> np.ndarray:
    """Return the point within the limits where the sum of squares is smallest, (k,).

    Args:
        evaluate: returns residual, (m,), and Jacobian, (m, k), at a point.
        evaluate_residual: returns the residual alone.
        start: (k,) first point, inside the limits.
        limits: lowest and highest value of each parameter, (k,) each.
        width: (k,) expected size of a change of each parameter.
        max_evaluations: largest number of residuals.
        is_rough: whether it ends at a larger tolerance, and without a Jacobian that confirms the minimum.
    """
    point, remaining = start, max_evaluations
    cost_tolerance = _ROUGH_COST_DECREASE_TOLERANCE if is_rough else _COST_DECREASE_TOLERANCE
    while True:
        function = _SecantFunction(evaluate, evaluate_residual, point, width)
        solution = least_squares(
            cast(Any, function.compute_residual), point, jac=cast(Any, function.compute_jacobian),
            bounds=limits, x_scale=width, max_nfev=remaining,
            ftol=cost_tolerance, xtol=_STEP_TOLERANCE, gtol=_GRADIENT_TOLERANCE,
        )  # fmt: skip
        decrease = function.start_cost - solution.cost
        if not is_rough and decrease <= _COST_DECREASE_TOLERANCE * function.start_cost:
            return point
        point, remaining = solution.x, remaining - solution.nfev
        if is_rough or remaining < 1:
            return point

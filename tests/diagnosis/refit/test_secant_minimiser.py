"""The minimiser finds the minimum of SciPy with exact derivatives, and evaluates the Jacobian less often."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from pamjax.diagnosis.refit.secant_minimiser import minimise_least_squares

TIMES = np.linspace(0.0, 4.0, 60)
TRUTH = np.array([3.0, 0.7, 1.5])
LIMITS = np.array([0.1, 0.05, -2.0]), np.array([9.0, 4.0, 4.0])
WIDTH = np.array([1.0, 0.5, 1.0])
START = np.array([1.0, 2.0, 0.0])


class _Decay:
    """An exponential decay above a constant, with counted evaluations."""

    def __init__(self, noise: float = 0.0) -> None:
        self.data = self.compute_model(TRUTH) + noise * np.random.default_rng(3).normal(size=TIMES.size)
        self.jacobians = 0

    @staticmethod
    def compute_model(x: np.ndarray) -> np.ndarray:
        return x[0] * np.exp(-x[1] * TIMES) + x[2]

    def compute_residual(self, x: np.ndarray) -> np.ndarray:
        return self.compute_model(x) - self.data

    def compute_jacobian(self, x: np.ndarray) -> np.ndarray:
        self.jacobians += 1
        decay = np.exp(-x[1] * TIMES)
        return np.column_stack([decay, -x[0] * TIMES * decay, np.ones_like(TIMES)])

    def evaluate(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.compute_residual(x), self.compute_jacobian(x)

    def minimise(self, start: np.ndarray, limits=LIMITS, max_evaluations: int = 60, is_rough: bool = False):
        return minimise_least_squares(
            self.evaluate, self.compute_residual, start, limits, WIDTH, max_evaluations, is_rough
        )


def compute_cost(problem: _Decay, x: np.ndarray) -> float:
    """Return the sum of squares."""
    return float(np.sum(problem.compute_residual(x) ** 2))


@pytest.mark.parametrize(
    "limits", [LIMITS, (LIMITS[0], np.array([9.0, 4.0, 1.0]))], ids=["inside", "at limit"]
)
def test_the_minimum_is_that_of_exact_derivatives(limits) -> None:
    noisy, exact = _Decay(0.05), _Decay(0.05)
    expected = least_squares(
        exact.compute_residual, START, jac=exact.compute_jacobian, bounds=limits, x_scale=WIDTH, ftol=1e-12
    )
    minimum = noisy.minimise(START, limits)
    assert compute_cost(noisy, minimum) <= (1 + 2e-5) * 2 * expected.cost
    assert np.allclose(minimum, expected.x, atol=0.01)
    assert noisy.jacobians < exact.jacobians


def test_a_start_at_the_minimum_stays_with_one_jacobian() -> None:
    problem = _Decay(0.05)
    best = problem.minimise(START)
    problem.jacobians = 0
    assert np.array_equal(problem.minimise(best), best)
    assert problem.jacobians == 1


def test_a_rough_fit_has_one_jacobian_less_than_a_confirmed_one() -> None:
    rough, confirmed = _Decay(0.05), _Decay(0.05)
    rough.minimise(START, is_rough=True)
    confirmed.minimise(START)
    assert rough.jacobians < confirmed.jacobians


def test_a_strongly_curved_step_evaluates_the_jacobian_again() -> None:
    """Rosenbrock's valley is curved: with one Jacobian, the minimiser would not follow it."""
    jacobians = 0

    def compute_residual(x):
        return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0], 0.0, 0.0])

    def evaluate(x):
        nonlocal jacobians
        jacobians += 1
        return compute_residual(x), np.array([[-20 * x[0], 10.0], [-1.0, 0.0], [0.0, 0.0], [0.0, 0.0]])

    limits = np.full(2, -5.0), np.full(2, 5.0)
    minimum = minimise_least_squares(
        evaluate, compute_residual, np.array([-1.2, 1.0]), limits, np.ones(2), max_evaluations=200
    )
    assert np.allclose(minimum, 1.0, atol=1e-3)
    assert jacobians > 2


def test_few_evaluations_end_at_a_better_point() -> None:
    problem = _Decay()
    assert compute_cost(problem, problem.minimise(START, max_evaluations=3)) < compute_cost(problem, START)


def test_a_start_at_a_limit_is_not_misled_by_rounding() -> None:
    """SciPy moves such a start inwards by 1e-10, where the change of a rounded residual is zero."""
    problem = _Decay(0.05)
    limits = LIMITS[0], np.array([9.0, 4.0, 1.0])

    def compute_rounded(x):
        return np.round(problem.compute_residual(x), 7)

    def minimise(start):
        return minimise_least_squares(
            lambda x: (compute_rounded(x), problem.compute_jacobian(x)),
            compute_rounded, start, limits, WIDTH, max_evaluations=7, is_rough=True,
        )  # fmt: skip

    at_limit, inside = minimise(np.array([3.0, 0.6, 1.0])), minimise(np.array([3.0, 0.6, 0.9]))
    assert compute_cost(problem, at_limit) < 1.001 * compute_cost(problem, inside)

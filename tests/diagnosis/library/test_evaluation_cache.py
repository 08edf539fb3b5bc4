"""Results at recent parameter values are kept, and are those of a new computation."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from pamjax.benchmark.inject_effect import inject_effects
from pamjax.diagnosis.library import evaluation_cache
from pamjax.diagnosis.library.evaluation_cache import EvaluationCache
from pamjax.diagnosis.library.library_problem import LibraryProblem, build_library_problem
from tests.diagnosis.bank import build_setup

ROWS = 100


def build_result(value: float) -> np.ndarray:
    return np.full((2, ROWS), value)


def test_new_derivatives_are_added_to_known_results():
    cache = EvaluationCache()
    assert cache.get("a").prediction is None
    cache.add("a", build_result(1.0), {3: build_result(2.0)})
    cache.add("a", build_result(9.0), {5: build_result(4.0)})
    evaluation = cache.get("a")
    assert np.all(evaluation.prediction == 1.0)
    assert {k: float(d[0, 0]) for k, d in evaluation.derivatives.items()} == {3: 2.0, 5: 4.0}


def test_oldest_results_are_dropped(monkeypatch):
    monkeypatch.setattr(evaluation_cache, "_MAX_BYTES", 3 * build_result(0).nbytes)
    cache = EvaluationCache()
    for key in "abc":
        cache.add(key, build_result(0.0), {})
    cache.get("a")
    cache.add("d", build_result(0.0), {})
    assert [key for key in "abcd" if cache.get(key).prediction is not None] == ["a", "c", "d"]
    cache.add("e", build_result(0.0), dict.fromkeys(range(9), build_result(1.0)))
    assert [key for key in "abcde" if cache.get(key).prediction is not None] == ["e"]


def test_threads_lose_no_derivative():
    cache = EvaluationCache()
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda k: cache.add("a", build_result(1.0), {k: build_result(k)}), range(200)))
    assert sorted(cache.get("a").derivatives) == list(range(200))


def test_pickled_cache_is_empty():
    cache = EvaluationCache()
    cache.add("a", build_result(1.0), {})
    assert pickle.loads(pickle.dumps(cache)).get("a").prediction is None


@pytest.fixture(scope="module")
def problem() -> LibraryProblem:
    return build_library_problem(inject_effects(0, np.random.default_rng(5), setup=build_setup()).case)


@pytest.mark.slow
def test_known_results_are_those_of_a_new_computation(problem):
    values = problem.neutral.copy()
    values[problem.index("braid_friction.coefficient")] = 0.1
    names = ("muscle.turns", "force_gain.gain", "braid_friction.coefficient", "muscle.thread_length")
    indices = [problem.index(name) for name in names]
    problem.predict_with_jacobian(values, indices[:2])
    prediction, jacobian = problem.predict_with_jacobian(values, indices)
    problem.evaluations.__init__()
    new_prediction, new_jacobian = problem.predict_with_jacobian(values, indices)
    np.testing.assert_allclose(prediction, new_prediction, rtol=1e-12)
    np.testing.assert_allclose(jacobian, new_jacobian, rtol=1e-9, atol=1e-12 * np.abs(new_jacobian).max())


@pytest.mark.slow
def test_known_results_need_no_program(problem, monkeypatch):
    prediction, jacobian = problem.predict_with_jacobian(problem.neutral, [0, 1])
    monkeypatch.setattr(LibraryProblem, "_compute_derivatives", None)
    monkeypatch.setattr(LibraryProblem, "_compute_prediction", None)
    again, again_jacobian = problem.predict_with_jacobian(problem.neutral.copy(), [1, 0])
    assert np.array_equal(again, prediction)
    assert np.array_equal(again_jacobian, jacobian[::-1])
    assert np.array_equal(problem.predict(problem.neutral), prediction)


@pytest.mark.slow
def test_prediction_program_agrees_with_that_of_the_derivatives(problem):
    for name, value in (("force_gain.gain", 1.1), ("braid_friction.coefficient", 0.2)):
        values = problem.neutral.copy()
        values[problem.index(name)] = value
        problem.evaluations.__init__()
        alone = problem.predict(values)
        problem.evaluations.__init__()
        with_derivatives, _ = problem.predict_with_jacobian(values, [problem.index(name)])
        np.testing.assert_allclose(alone, with_derivatives, rtol=1e-11)

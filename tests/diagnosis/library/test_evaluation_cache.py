"""Cached results at recent parameter values equal computed ones."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from pamjax.benchmark.inject_effect import inject_effects
from pamjax.diagnosis.library import evaluation_cache, library_problem
from pamjax.diagnosis.library.evaluation_cache import CachedEvaluation, EvaluationCache
from pamjax.diagnosis.library.library_problem import LibraryProblem, build_library_problem
from tests.diagnosis.bank import build_setup

ROWS = 100


def build_result(value: float) -> np.ndarray:
    return np.full((2, ROWS), value)


def put(cache: EvaluationCache, key: str, derivatives: dict[int, float] | None = None) -> None:
    columns = {k: build_result(value) for k, value in (derivatives or {}).items()}
    cache.put(key, CachedEvaluation({"alone": build_result(1.0)}, columns))


def test_new_derivatives_are_added_to_cached_results():
    cache = EvaluationCache()
    assert not cache.get("a").predictions
    put(cache, "a", {3: 2.0})
    cache.put("a", CachedEvaluation({True: build_result(9.0)}, {5: build_result(4.0)}))
    evaluation = cache.get("a")
    assert {k: float(p[0, 0]) for k, p in evaluation.predictions.items()} == {"alone": 1.0, True: 9.0}
    assert {k: float(d[0, 0]) for k, d in evaluation.derivatives.items()} == {3: 2.0, 5: 4.0}
    cache.clear()
    assert not cache.get("a").predictions


def test_oldest_results_are_dropped(monkeypatch):
    monkeypatch.setattr(evaluation_cache, "_MAX_BYTES", 3 * build_result(0).nbytes)
    cache = EvaluationCache()
    for key in "abc":
        put(cache, key)
    cache.get("a")
    put(cache, "d")
    assert [key for key in "abcd" if cache.get(key).predictions] == ["a", "c", "d"]
    put(cache, "e", dict.fromkeys(range(9), 1.0))
    assert [key for key in "abcde" if cache.get(key).predictions] == ["e"]


def test_threads_lose_no_derivative():
    cache = EvaluationCache()
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda k: put(cache, "a", {k: 1.0}), range(200)))
    assert sorted(cache.get("a").derivatives) == list(range(200))


def test_cached_results_cannot_be_changed():
    cache = EvaluationCache()
    put(cache, "a", {3: 2.0})
    for array in (cache.get("a").predictions["alone"], cache.get("a").derivatives[3]):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 5.0


def test_pickled_cache_is_empty():
    cache = EvaluationCache()
    put(cache, "a")
    assert not pickle.loads(pickle.dumps(cache)).get("a").predictions


@pytest.fixture(scope="module")
def problem() -> LibraryProblem:
    return build_library_problem(inject_effects(0, np.random.default_rng(5), setup=build_setup()).case)


def choose_parameters(problem: LibraryProblem, *names: str) -> list[int]:
    return [problem.index(name) for name in names]


@pytest.mark.slow
@pytest.mark.parametrize(("switch", "value"), [("braid_friction.coefficient", 0.1), ("force_gain.gain", 1.1)])
def test_cached_results_equal_computed_ones(problem, switch, value):
    values = problem.neutral.copy()
    values[problem.index(switch)] = value
    indices = choose_parameters(problem, "muscle.turns", "force_gain.gain", "braid_friction.coefficient")
    problem.evaluations.clear()
    problem.predict_with_jacobian(values, indices[1:2])
    problem.predict(values)
    results = problem.predict_with_jacobian(values, indices)
    problem.evaluations.clear()
    for result, computed in zip(results, problem.predict_with_jacobian(values, indices), strict=True):
        assert np.array_equal(result, computed)


@pytest.mark.slow
def test_cached_results_need_no_program(problem, monkeypatch):
    values = problem.neutral
    alone, (prediction, jacobian) = problem.predict(values), problem.predict_with_jacobian(values, [0, 1])
    monkeypatch.setattr(library_problem.programs, "run_compiled", None)
    again, again_jacobian = problem.predict_with_jacobian(values.copy(), [1, 0])
    assert np.array_equal(again, prediction)
    assert np.array_equal(again_jacobian, jacobian[::-1])
    assert np.array_equal(problem.predict(values), alone)


@pytest.mark.slow
def test_results_that_are_dropped_during_a_computation_are_returned(problem, monkeypatch):
    expected = problem.predict_with_jacobian(problem.neutral, [0, 1])[1]
    problem.evaluations.clear()
    problem.predict_with_jacobian(problem.neutral, [0])
    run = problem._run_sweep

    def drop_and_run(*args):
        problem.evaluations.clear()
        return run(*args)

    monkeypatch.setattr(LibraryProblem, "_run_sweep", lambda self, *args: drop_and_run(*args))
    assert np.array_equal(problem.predict_with_jacobian(problem.neutral, [0, 1])[1], expected)


@pytest.mark.slow
def test_channel_without_an_effect_is_exactly_unchanged(problem):
    """A form error is scaled by the effect of its mechanism: rounding must not look like an effect."""
    values = problem.neutral.copy()
    values[problem.index("force_gain.gain")] = 1.1
    for clear in (True, False):
        problem.predict_with_jacobian(values, [0, problem.index("force_gain.gain")])
        if clear:
            problem.evaluations.clear()
        change = problem.predict(values) - problem.predict(problem.neutral)
        assert change[0].all()
        assert not change[1].any()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "value"),
    [("force_gain.gain", 1.1), ("braid_friction.coefficient", 0.2), ("end_taper.share", 0.5)],
)
def test_both_programs_agree(problem, name, value):
    values = problem.neutral.copy()
    values[problem.index(name)] = value
    prediction, _ = problem.predict_with_jacobian(values, [problem.index(name)])
    np.testing.assert_allclose(problem.predict(values), prediction, rtol=1e-11)

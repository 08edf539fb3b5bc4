"""The search for the required probability ends when no further choice can improve the objective."""

from types import SimpleNamespace

import pytest

from pamjax.sizing import assure
from pamjax.sizing.assure import MAX_ASSURED_CHOICES, MAX_FAILURES, Finalist, assure_probability

SPEC = SimpleNamespace(entries=SimpleNamespace(probability=0.9))


def make_result(objective):
    return SimpleNamespace(optimum=SimpleNamespace(log_objective=objective))


@pytest.fixture
def assure_pool(monkeypatch):
    """Return a function that assures a pool of (nominal objective, assured objective, probability)."""

    def run(pool):
        results = [make_result(nominal) for nominal, _, _ in pool]
        outcomes = {id(result): row[1:] for result, row in zip(results, pool, strict=True)}
        assured = []

        def assure_choice(result, *others):
            assured.append(result)
            objective, probability = outcomes[id(result)]
            return Finalist(make_result(objective), probability)

        monkeypatch.setattr(assure, "_assure_choice", assure_choice)
        return assure_probability(results, None, SPEC, 0), len(assured)

    return run


def test_choices_above_the_best_assured_objective_are_not_optimised(assure_pool):
    finalists, count = assure_pool([(1.0, 1.5, 0.9), (1.2, 1.3, 0.95), (1.4, 1.4, 1.0), (1.5, 1.5, 1.0)])
    assert count == 2
    assert [finalist.log_objective for finalist in finalists] == [1.3, 1.5]


def test_an_improbable_choice_does_not_end_the_search(assure_pool):
    finalists, count = assure_pool([(1.0, 1.1, 0.5), (1.2, 1.3, 0.92), (1.25, 1.3, 0.8)])
    assert count == 3
    assert [finalist.probability for finalist in finalists] == [0.92, 0.8, 0.5]


def test_search_without_success_is_limited(assure_pool):
    finalists, count = assure_pool([(1.0, 1.0, 0.01 * k) for k in range(40)])
    assert count == MAX_FAILURES
    assert finalists[0].probability == max(finalist.probability for finalist in finalists)
    _, count = assure_pool([(1.0, 1.0, 0.95)] * 40)
    assert count == MAX_ASSURED_CHOICES


def test_unknown_probability_reaches_no_target():
    assert not Finalist(make_result(1.0)).reaches(0.9)
    assert Finalist(make_result(1.0)).reaches(0.0)

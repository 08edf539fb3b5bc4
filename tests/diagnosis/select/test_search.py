"""A search that began wrongly begins again, and small effects are named where they leave only noise."""

import dataclasses
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from pamjax.benchmark.trial import TrialTask, draw_ground_truth
from pamjax.diagnosis.crossval.gain import select_held_out_rows
from pamjax.diagnosis.detect.score_test import compute_score_directions
from pamjax.diagnosis.library.candidates import Candidate, build_candidates
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.noise.estimate import NoiseModel
from pamjax.diagnosis.refit.candidate_fit import CandidateFit, fit_candidate
from pamjax.diagnosis.select import search as under_test
from pamjax.diagnosis.select.search import search_mechanisms
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.progress import ignore_progress
from pamjax.records.blocks import find_blocks

WHITE = NoiseModel(
    (Ar1Noise(np.ones(1000), 1.0, 0.0, True), None),
    (np.arange(1000), np.arange(0)),
    (np.array([[0, 1000]]), np.zeros((0, 2), int)),
)


class Bare(under_test.MechanismSearch):
    """A search whose models need no refit."""

    def refit(self, model):
        return model


def searched(task):
    """What is concealed in a recording of the proof, and where a search ends on it."""
    envelope = draw_ground_truth(task)
    found = build_library_problem(envelope.case)
    used = ~select_held_out_rows(find_blocks(envelope.case.recording))
    baseline = fit_candidate(found, used, (), found.neutral)
    first = compute_score_directions(found, baseline.noise, baseline.estimate, build_candidates(found))
    look = under_test.MechanismSearch(found, used, baseline, build_candidates(found), ignore_progress)
    return set(envelope.effect_ids), search_mechanisms(look, first)


@pytest.mark.parametrize(("left", "taken"), [(0.0, True), (40.0, True), (400.0, False)])
def test_a_search_that_ends_far_from_noise_begins_again(monkeypatch, left, taken):
    """Where that leaves a twentieth of it at most, and is likelier, it goes there."""
    baseline, stuck, pair, other = (
        SimpleNamespace(excess_chi2=excess, full_bic=likely)
        for excess, likely in ((9000.0, 9000.0), (1000.0, 1000.0), (5000.0, 5000.0), (left, left))
    )
    monkeypatch.setattr(
        under_test, "run_search", lambda look, begin, scored=None: stuck if begin is baseline else other
    )
    monkeypatch.setattr(under_test, "_find_restart_pairs", lambda look, model, first: [pair])
    monkeypatch.setattr(
        under_test.MechanismSearch, "leaves_large_residual", lambda look, model: model.excess_chi2 > 500
    )
    monkeypatch.setattr(under_test.MechanismSearch, "refit", lambda look, model: model)
    look = under_test.MechanismSearch(
        cast(Any, None), np.ones(1, dtype=bool), cast(Any, baseline), (), ignore_progress
    )
    assert (under_test.search_mechanisms(look, ()) is other) is taken
    # What is near already is left there.
    stuck.excess_chi2 = 400.0
    assert under_test.search_mechanisms(look, ()) is stuck


@pytest.mark.slow
def test_what_is_small_beside_the_whole_stays_where_it_leaves_only_noise(monkeypatch):
    """A drift and a gain of 7 and 8 standard deviations beside an offset of 42."""
    task = TrialTask("all", "triple", 0.0, 1, seed=6)
    concealed, model = searched(task)
    # A gain of force and one of pressure are one and the same here.
    assert concealed - set(model.ids) <= {"pressure_gain"}
    assert len(model.ids) == 3
    # Able to fail: without that the largest stands alone.
    worth = under_test.MechanismSearch.is_worthwhile
    monkeypatch.setattr(
        under_test.MechanismSearch,
        "is_worthwhile",
        lambda look, a, b, small, form=None: worth(look, a, b, False, form),
    )
    _, alone = searched(task)
    assert alone.ids == ("length_offset",)


def test_models_that_see_other_noise_are_compared_by_their_likelihood():
    """Minus twice the logarithm of the normal density of all samples, written out."""
    n, colour = 12, Ar1Noise(np.linspace(0.5, 2.0, 12), 0.7, 0.8, True)
    white = NoiseModel(
        (colour, None), (np.arange(n), np.arange(0)), (np.array([[0, n]]), np.zeros((0, 2), int))
    )
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    covariance = np.outer(colour.sd, colour.sd) * (0.7 * 0.8**lag + 0.3 * np.eye(n))
    residual = np.random.default_rng(0).standard_normal((2, n))
    cost = float(np.sum(white.whiten(residual) ** 2))
    at: Any = SimpleNamespace(cost=cost, chi2=cost, free=())
    model = CandidateFit((), white, at)
    want = np.linalg.slogdet(covariance)[1] + residual[0] @ np.linalg.solve(covariance, residual[0])
    # The filter is that of a run without an end: its first samples are a little off.
    assert model.full_bic == pytest.approx(want, abs=0.5)
    # Able to fail: the score alone prefers whoever sees more noise.
    loud = dataclasses.replace(white, channels=(dataclasses.replace(colour, sd=9 * colour.sd), None))
    cost = float(np.sum(loud.whiten(residual) ** 2))
    at = SimpleNamespace(cost=cost, chi2=cost, free=())
    louder = CandidateFit((), loud, at)
    assert louder.bic < model.bic
    assert louder.full_bic > model.full_bic + 10


@pytest.mark.parametrize(("explained", "ended"), [((10, 50), ()), ((500, 400), ()), ((500, 499), ("a", "b"))])
def test_a_search_goes_only_where_nothing_but_noise_is_left(monkeypatch, explained, ended):
    """Many pairs bend towards what is in no catalogue, and nobody asked the pair that it begins with."""
    a, b = (Candidate(id, (f"{id}.much",), {}) for id in "ab")

    def model(*chosen):
        taken = float(sum(dict(zip("ab", explained, strict=True))[form.id] for form in chosen))
        at: Any = SimpleNamespace(cost=2000 - taken, chi2=2000 - taken, free=())
        return CandidateFit(chosen, WHITE, at)

    def removed(found, one, k):
        return model(*one.mechanisms[:k], *one.mechanisms[k + 1 :])

    monkeypatch.setattr(under_test, "fit_without_mechanism", removed)
    monkeypatch.setattr(
        under_test, "_add_candidates", lambda look, one, scored=None, small=False, best=None: (one, None)
    )
    monkeypatch.setattr(under_test, "_find_restart_pairs", lambda look, one, first: [model(a, b)])
    # How many were tried is not what is asked here.
    monkeypatch.setattr(under_test, "is_reduction_significant", lambda gain, numbers, tried: True)
    found: Any = SimpleNamespace()
    look = Bare(found, np.ones(1000, dtype=bool), model(), [], ignore_progress)
    assert search_mechanisms(look, []).ids == ended

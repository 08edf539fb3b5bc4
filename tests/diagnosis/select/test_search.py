"""A search that began wrongly begins again, and small effects are named where they leave only noise."""

import dataclasses
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from pamjax.benchmark.trial import Task, drawn
from pamjax.diagnosis.crossval.gain import held_out
from pamjax.diagnosis.detect.score_test import signatures
from pamjax.diagnosis.library.candidates import Form, forms
from pamjax.diagnosis.library.library_problem import problem
from pamjax.diagnosis.noise.estimate import Whitening
from pamjax.diagnosis.refit.candidate_fit import Model, settle
from pamjax.diagnosis.select import search as under_test
from pamjax.diagnosis.select.search import search
from pamjax.infer.noise.ar1_filter import Colour
from pamjax.progress import silent
from pamjax.records.blocks import blocks

WHITE = Whitening(
    (Colour(np.ones(1000), 1.0, 0.0, True), None),
    (np.arange(1000), np.arange(0)),
    (np.array([[0, 1000]]), np.zeros((0, 2), int)),
)


class Bare(under_test.Look):
    """A search whose models need no refit."""

    def settled(self, model):
        return model


def searched(task):
    """What is concealed in a recording of the proof, and where a search ends on it."""
    envelope = drawn(task)
    found = problem(envelope.case)
    used = ~held_out(blocks(envelope.case.recording))
    baseline = settle(found, used, (), found.neutral)
    first = signatures(found, baseline.white, baseline.at, forms(found))
    look = under_test.Look(found, used, baseline, forms(found), silent)
    return set(envelope.concealed), search(look, first)


@pytest.mark.parametrize(("left", "taken"), [(0.0, True), (40.0, True), (400.0, False)])
def test_a_search_that_ends_far_from_noise_begins_again(monkeypatch, left, taken):
    """Where that leaves a twentieth of it at most, and is likelier, it goes there."""
    baseline, stuck, pair, other = (
        SimpleNamespace(excess=excess, likely=likely)
        for excess, likely in ((9000.0, 9000.0), (1000.0, 1000.0), (5000.0, 5000.0), (left, left))
    )
    monkeypatch.setattr(
        under_test, "ended", lambda look, begin, scored=None: stuck if begin is baseline else other
    )
    monkeypatch.setattr(under_test, "_beginnings", lambda look, model, first: [pair])
    monkeypatch.setattr(under_test.Look, "far", lambda look, model: model.excess > 500)
    monkeypatch.setattr(under_test.Look, "settled", lambda look, model: model)
    look = under_test.Look(cast(Any, None), np.ones(1, dtype=bool), cast(Any, baseline), (), silent)
    assert (under_test.search(look, ()) is other) is taken
    # What is near already is left there.
    stuck.excess = 400.0
    assert under_test.search(look, ()) is stuck


@pytest.mark.slow
def test_what_is_small_beside_the_whole_stays_where_it_leaves_only_noise(monkeypatch):
    """A drift and a gain of 7 and 8 standard deviations beside an offset of 42."""
    task = Task("all", "triple", 0.0, 1, seed=6)
    concealed, model = searched(task)
    # A gain of force and one of pressure are one and the same here.
    assert concealed - set(model.ids) <= {"pressure_gain"}
    assert len(model.ids) == 3
    # Able to fail: without that the largest stands alone.
    worth = under_test.Look.worth
    monkeypatch.setattr(
        under_test.Look, "worth", lambda look, a, b, small, form=None: worth(look, a, b, False, form)
    )
    _, alone = searched(task)
    assert alone.ids == ("length_offset",)


def test_models_that_see_other_noise_are_compared_by_their_likelihood():
    """Minus twice the logarithm of the normal density of all samples, written out."""
    n, colour = 12, Colour(np.linspace(0.5, 2.0, 12), 0.7, 0.8, True)
    white = Whitening(
        (colour, None), (np.arange(n), np.arange(0)), (np.array([[0, n]]), np.zeros((0, 2), int))
    )
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    covariance = np.outer(colour.sd, colour.sd) * (0.7 * 0.8**lag + 0.3 * np.eye(n))
    residual = np.random.default_rng(0).standard_normal((2, n))
    cost = float(np.sum(white(residual) ** 2))
    at: Any = SimpleNamespace(cost=cost, misfit=cost, moved=())
    model = Model((), white, at)
    want = np.linalg.slogdet(covariance)[1] + residual[0] @ np.linalg.solve(covariance, residual[0])
    # The filter is that of a run without an end: its first samples are a little off.
    assert model.likely == pytest.approx(want, abs=0.5)
    # Able to fail: the score alone prefers whoever sees more noise.
    loud = dataclasses.replace(white, colours=(dataclasses.replace(colour, sd=9 * colour.sd), None))
    cost = float(np.sum(loud(residual) ** 2))
    at = SimpleNamespace(cost=cost, misfit=cost, moved=())
    louder = Model((), loud, at)
    assert louder.score < model.score
    assert louder.likely > model.likely + 10


@pytest.mark.parametrize(("explained", "ended"), [((10, 50), ()), ((500, 400), ()), ((500, 499), ("a", "b"))])
def test_a_search_goes_only_where_nothing_but_noise_is_left(monkeypatch, explained, ended):
    """Many pairs bend towards what is in no catalogue, and nobody asked the pair that it begins with."""
    a, b = (Form(id, (f"{id}.much",), {}) for id in "ab")

    def model(*chosen):
        taken = float(sum(dict(zip("ab", explained, strict=True))[form.id] for form in chosen))
        at: Any = SimpleNamespace(cost=2000 - taken, misfit=2000 - taken, moved=())
        return Model(chosen, WHITE, at)

    def removed(found, one, k):
        return model(*one.chosen[:k], *one.chosen[k + 1 :])

    monkeypatch.setattr(under_test, "removed", removed)
    monkeypatch.setattr(
        under_test, "_grown", lambda look, one, scored=None, small=False, best=None: (one, None)
    )
    monkeypatch.setattr(under_test, "_beginnings", lambda look, one, first: [model(a, b)])
    # How many were tried is not what is asked here.
    monkeypatch.setattr(under_test, "significant", lambda gain, numbers, tried: True)
    found: Any = SimpleNamespace()
    look = Bare(found, np.ones(1000, dtype=bool), model(), [], silent)
    assert search(look, []).ids == ended

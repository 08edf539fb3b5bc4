"""A search that began wrongly begins again, and small effects are named where they leave only noise."""

import dataclasses

import numpy as np
import pytest

from pamjax.records.blocks import blocks
from pamjax.study import search as under_test
from pamjax.study.forms import forms
from pamjax.study.gain import held_out
from pamjax.study.problem import problem
from pamjax.study.search import search
from pamjax.study.settled import settle
from pamjax.study.setups import SIZE
from pamjax.study.signature import signatures
from pamjax.study.trial import Task, drawn

pytestmark = pytest.mark.slow


def searched(task):
    """What is concealed in a recording of the proof, and where a search ends on it."""
    envelope = drawn(task)
    found = problem(envelope.case, SIZE)
    used = ~held_out(blocks(envelope.case.recording))
    baseline = settle(found, used, (), found.neutral)
    first = signatures(found, baseline.white, baseline.at, forms(found))
    return set(envelope.concealed), search(found, used, baseline, first)


def test_a_search_that_began_wrongly_begins_again(monkeypatch):
    """A diameter read wrongly and soft threads look like tapered ends first."""
    task = Task("all", "pair", 0.0, 2, seed=6)
    concealed, model = searched(task)
    assert set(model.ids) == concealed == {"diameter_offset", "braid_elasticity"}
    assert model.excess < 0.3 * model.white.size
    # Able to fail: what began there alone ends far from the noise.
    monkeypatch.setattr(under_test, "_beginnings", lambda look, model, first: [])
    _, stuck = searched(task)
    assert stuck.excess > 10 * stuck.white.size


def test_what_is_small_beside_the_whole_stays_where_it_leaves_only_noise(monkeypatch):
    """A drift and a gain of 7 and 8 standard deviations beside an offset of 42."""
    task = Task("all", "triple", 0.0, 1, seed=6)
    concealed, model = searched(task)
    # A gain of force and one of pressure are one and the same here.
    assert concealed - set(model.ids) <= {"pressure_gain"}
    assert len(model.ids) == 3
    # Able to fail: without that the largest stands alone.
    monkeypatch.setattr(under_test, "COMPLETE", 1.0)
    _, alone = searched(task)
    assert alone.ids == ("length_offset",)


def test_models_that_see_other_noise_are_compared_by_their_likelihood():
    """The same residuals under twice the noise: a quarter of χ², and ln 4 for each sample."""
    envelope = drawn(Task("all", "nothing", 0.5, 0, seed=6))
    found = problem(envelope.case, SIZE)
    model = settle(found, np.ones(found.n, dtype=bool), (), found.neutral)
    white = model.white
    loud = dataclasses.replace(
        white, colours=tuple(c and dataclasses.replace(c, sd=2 * c.sd) for c in white.colours)
    )
    assert loud.volume - white.volume == pytest.approx(2 * np.log(2) * white.size)
    residual = model.at.residual
    assert loud(found.measured - found.shows(model.at.values)) == pytest.approx(residual / 2)

"""What explains only the blocks that it was fitted to is no physics."""

from types import SimpleNamespace

import numpy as np
import pytest

from pamjax.records.blocks import Blocks
from pamjax.study import borne_out as under_test
from pamjax.study.borne_out import borne_out, borne_shares
from pamjax.study.forms import Form
from pamjax.study.naming import Model, Name, Naming
from pamjax.study.refit import refit
from pamjax.study.whiten import Colour, Whitening

ROWS, BLOCKS, NOISE = 400, 4, 0.1
X = np.linspace(-1, 1, ROWS)
SLOPE = Form("slope", ("slope.much",))
LAID = Blocks(np.arange(ROWS) // (ROWS // BLOCKS), tuple("abcd"), "rows")
EVERY = np.ones(ROWS, dtype=bool)


def weights(found, values, used):
    colours = (Colour(np.full(ROWS, NOISE), 1.0, 0.0, True), None)
    runs = (np.zeros((0, 2), int),) * 2
    return Whitening(colours, (np.flatnonzero(used), np.arange(0)), runs)


@pytest.fixture
def recording(monkeypatch):
    """A level that is known roughly, a slope that may be named, and something in no catalogue."""

    def make(slope, outside):
        rng = np.random.default_rng(4)
        force = 2 + slope * X + outside + NOISE * rng.standard_normal(ROWS)
        design = np.stack([np.ones(ROWS), X])

        def slopes(values, places):
            steep = [np.stack([design[k], np.zeros(ROWS)]) for k in places]
            return np.stack([values @ design, np.zeros(ROWS)]), np.stack(steep)

        found = SimpleNamespace(
            names=("level", "slope.much"), place=["level", "slope.much"].index, n=ROWS,
            start=np.array([2.0, 0.0]), neutral=np.array([2.0, 0.0]), sd=np.array([1.0, np.inf]),
            low=np.full(2, -50.0), high=np.full(2, 50.0), log=np.zeros(2, bool), own=np.array([True, False]),
            meaning=tuple(SimpleNamespace(neutral=neutral, scale="linear") for neutral in (None, 0.0)),
            measured=np.stack([force, np.full(ROWS, np.nan)]), slopes=slopes,
            shows=lambda values: slopes(values, [0])[0],
        )  # fmt: skip
        monkeypatch.setattr(under_test, "whitening", weights)
        monkeypatch.setattr(
            under_test, "settle", lambda found, used, chosen, values: model(found, chosen, [0])
        )
        return found

    def model(found, chosen, moved):
        white = weights(found, found.neutral, EVERY)
        return Model(chosen, white, refit(found, white, moved, found.neutral))

    def named(found):
        name = Name("slope", 0.9, (), 100.0)
        return Naming(model(found, (), [0]), model(found, (SLOPE,), [0, 1]), (name,), ())

    def made(slope, outside):
        found = make(slope, outside)
        return found, named(found)

    return made


def test_what_is_there_is_borne_out(recording):
    found, naming = recording(slope=3.0, outside=0.3 * np.sin(9 * X))
    assert borne_shares(found, LAID, EVERY, naming.model)["slope"] > 0.9
    kept = borne_out(found, LAID, EVERY, naming)
    assert [name.id for name in kept.names] == ["slope"]
    assert 0.7 < kept.names[0].probability < 0.9


def test_what_only_bends_towards_a_misfit_is_not(recording):
    found, naming = recording(slope=0.0, outside=np.where(X > 0.5, 8 * (X - 0.5), 0.0))
    # Where it was fitted it explains half of what is there.
    assert naming.model.excess < 0.6 * naming.baseline.excess
    assert borne_shares(found, LAID, EVERY, naming.model)["slope"] < 0.3
    dropped = borne_out(found, LAID, EVERY, naming)
    assert dropped.names == ()
    assert dropped.model is naming.baseline


def test_one_block_alone_bears_nothing_out_and_refutes_nothing(recording):
    found, naming = recording(slope=3.0, outside=0.0)
    alone = Blocks(np.zeros(ROWS, int), ("all",), "rows")
    assert borne_shares(found, alone, EVERY, naming.model) == {"slope": 1.0}

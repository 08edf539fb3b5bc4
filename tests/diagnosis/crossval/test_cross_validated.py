"""What explains only the blocks that it was fitted to is no physics."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pamjax.diagnosis.crossval import cross_validated as under_test
from pamjax.diagnosis.crossval.cross_validated import (
    cross_validate_selection,
    format_dropped_mechanisms,
    halve_certainty,
)
from pamjax.diagnosis.crossval.explained_fraction import BlockCrossValidation, _fit_without_blocks
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.noise.estimate import NoiseModel
from pamjax.diagnosis.refit.candidate_fit import CandidateFit
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.select.selection import NamedMechanism, Selection
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.records.blocks import Blocks

ROWS, NOISE = 400, 0.1
X = np.linspace(-1, 1, ROWS)
BLOCK = np.arange(ROWS) // 100
LAID = Blocks(BLOCK, tuple("abcd"), "lengths")
EVERY = np.ones(ROWS, dtype=bool)

#: What each number adds: a level and the ruler's error at one length are the lab's own.
SHAPES = {
    "level": np.ones(ROWS),
    "ruler": (BLOCK == 2).astype(float),
    "slope.much": X,
    "step.much": (BLOCK == 3) * 1.0,
    "other.much": X**2,
}
NAMES = tuple(SHAPES)
SLOPE, STEP, OTHER = (Candidate(id, (f"{id}.much",)) for id in ("slope", "step", "other"))


def recording(force, empty=False) -> Any:
    """A recording of 400 rows in four blocks; with `empty` the first one has nothing to compare with."""
    design = np.stack(list(SHAPES.values()))
    own = np.array([name in ("level", "ruler") for name in NAMES])

    def slopes(values, places):
        steep = [np.stack([design[k], np.zeros(ROWS)]) for k in places]
        return np.stack([values @ design, np.zeros(ROWS)]), np.stack(steep)

    measured = np.stack(
        [force + NOISE * np.random.default_rng(4).standard_normal(ROWS), np.full(ROWS, np.nan)]
    )
    if empty:
        measured[0, BLOCK == 0] = np.nan
    return SimpleNamespace(
        names=NAMES,
        index=NAMES.index,
        n=ROWS,
        is_baseline=own,
        measured=measured,
        jacobian=slopes,
        start=np.zeros(5),
        neutral=np.zeros(5),
        prior_sd=np.where(own, 10.0, np.inf),
        is_logarithmic=np.zeros(5, bool),
        low=np.full(5, -50.0),
        high=np.full(5, 50.0),
        predict=lambda values: slopes(values, [0])[0],
        meanings=tuple(SimpleNamespace(neutral=None if mine else 0.0, scale="linear") for mine in own),
    )


def settled(found, used, chosen, values):
    rows = np.flatnonzero(used & np.isfinite(found.measured[0]))
    colours = (Ar1Noise(np.full(ROWS, NOISE), 1.0, 0.0, True), None)
    runs = (np.array([[0, rows.size]]), np.zeros((0, 2), int))
    white = NoiseModel(colours, (rows, np.arange(0)), runs)
    moved = sorted({0, 1, *(found.index(name) for form in chosen for name in form.free_parameters)})
    return CandidateFit(tuple(chosen), white, fit_parameters(found, white, moved, values))


def names_of(found, model):
    return tuple(NamedMechanism(form.id, 0.9, (), 100.0) for form in model.mechanisms)


@pytest.fixture
def judged(monkeypatch):
    """What becomes of names: their shares, and the naming that is left."""
    monkeypatch.setattr(under_test, "fit_candidate", settled)

    def judge(found, chosen, laid=LAID, much=True):
        bare, model = (settled(found, EVERY, forms, found.neutral) for forms in ((), chosen))
        naming = Selection(bare, model, names_of(found, model), ())
        return BlockCrossValidation.from_blocks(
            found, laid, EVERY, model
        ).explained_fraction_by_mechanism, cross_validate_selection(
            found, laid, EVERY, naming, judge_each=much
        )

    return judge


def test_what_is_there_is_borne_out(judged):
    shares, kept = judged(recording(2 + 3 * X + 0.3 * np.sin(9 * X)), (SLOPE,))
    assert shares["slope"] > 0.95
    assert [name.id for name in kept.named_mechanisms] == ["slope"]
    assert kept.named_mechanisms[0].probability == pytest.approx(0.9 * shares["slope"])


def test_what_only_bends_towards_a_misfit_is_not(judged):
    found = recording(np.where(X > 0.5, 8 * (X - 0.5), 0.0))
    shares, dropped = judged(found, (SLOPE,))
    bare, fitted = (settled(found, EVERY, forms, found.neutral) for forms in ((), (SLOPE,)))
    # Where it was fitted it explains a good part of what is there.
    assert fitted.excess_chi2 < 0.8 * bare.excess_chi2
    assert shares["slope"] < 0.3
    assert dropped.named_mechanisms == ()
    assert dropped.model is dropped.baseline


def test_the_one_that_is_not_borne_out_goes_and_the_other_stays(judged):
    found = recording(5 * X + np.where(X > 0.6, 5 * (X - 0.6), 0.0))
    shares, kept = judged(found, (SLOPE, OTHER))
    assert shares["slope"] > 0.95 > 0.5 > shares["other"]
    assert [name.id for name in kept.named_mechanisms] == ["slope"]
    assert kept.model.ids == ("slope",)


@pytest.mark.parametrize("much", [True, False])
def test_names_that_leave_much_together_fall_together(judged, much):
    found = recording(4 * X + 1.6 * np.sin(12 * X) * (1 + (BLOCK == 1)))
    bare, model = (settled(found, EVERY, forms, found.neutral) for forms in ((), (SLOPE,)))
    unseen = BlockCrossValidation.from_blocks(found, LAID, EVERY, model)
    _, kept = judged(found, (SLOPE,), much=much)
    # More than a half is explained, which would be enough for a name alone.
    assert 0.55 < unseen.explained_fraction == unseen.explained_fraction_by_mechanism["slope"] < 5 / 6
    assert unseen.fails_out_of_sample
    assert kept.named_mechanisms == ()
    assert bare.excess_chi2 > model.excess_chi2


def test_names_that_are_borne_out_one_by_one_fall_where_all_of_them_leave_much(judged):
    found = recording(4 * X + 4 * X**2 + 2.5 * np.sin(60 * X))
    model = settled(found, EVERY, (SLOPE, OTHER), found.neutral)
    unseen = BlockCrossValidation.from_blocks(found, LAID, EVERY, model)
    _, kept = judged(found, (SLOPE, OTHER))
    assert min(0.9 * share for share in unseen.explained_fraction_by_mechanism.values()) > 0.5
    assert unseen.explained_fraction < 5 / 6
    assert kept.named_mechanisms == ()


def test_a_name_that_leaves_only_noise_everywhere_keeps_all_of_its_probability(judged):
    _, kept = judged(recording(2 + 3 * X), (SLOPE,), much=False)
    assert [name.probability for name in kept.named_mechanisms] == [0.9]


def test_a_faint_name_that_unseen_blocks_miss_by_noise_stays(judged):
    """A sixth of next to nothing is noise."""

    def unseen(wave):
        found = recording(0.08 * X + wave * np.sin(60 * X))
        return BlockCrossValidation.from_blocks(
            found, LAID, EVERY, settled(found, EVERY, (SLOPE,), found.neutral)
        )

    faint = unseen(0.0)
    assert faint.explained_fraction < 5 / 6
    assert not faint.fails_out_of_sample
    assert unseen(0.1).fails_out_of_sample


@pytest.mark.parametrize("id", ["force_drift", "end_taper", "diameter_offset", "braid_friction"])
def test_beside_something_unexplained_a_name_of_any_kind_stays_with_half_its_certainty(judged, id):
    """Whether a mechanism acts with time or with pressure and length alone does not decide."""
    _, kept = judged(recording(5 * X + 2 * X**2), (SLOPE, OTHER), much=False)
    named = replace(
        kept, named_mechanisms=(replace(kept.named_mechanisms[0], id=id), kept.named_mechanisms[1])
    )
    less_sure = halve_certainty(named)
    assert [name.id for name in less_sure.named_mechanisms] == [name.id for name in named.named_mechanisms]
    assert [name.probability for name in less_sure.named_mechanisms] == pytest.approx([0.7, 0.7])
    assert less_sure.model is named.model


def test_a_name_that_left_out_blocks_refute_is_in_a_note(judged):
    found = recording(5 * X + np.where(X > 0.6, 5 * (X - 0.6), 0.0))
    kept = judged(found, (SLOPE, OTHER))[1]
    both = replace(
        kept, named_mechanisms=names_of(found, settled(found, EVERY, (SLOPE, OTHER), found.neutral))
    )
    assert format_dropped_mechanisms(both, kept) == [
        "`other` explains too little of the blocks that were left out of a fit and is not named."
    ]
    assert format_dropped_mechanisms(kept, kept) == []


def test_what_goes_is_switched_off_wherever_a_refit_begins(judged):
    _, kept = judged(recording(5 * X + np.where(X > 0.6, 5 * (X - 0.6), 0.0)), (SLOPE, OTHER))
    assert [name.id for name in kept.named_mechanisms] == ["slope"]
    assert kept.start_values[NAMES.index("other.much")] == 0.0
    assert kept.fit_before_small_effects is None


def test_a_number_that_one_block_alone_knows_excuses_no_other_block():
    found = recording(4 * X + 8 * np.sin(12 * X))
    both = Candidate("both", ("slope.much", "step.much"))
    unseen = BlockCrossValidation.from_blocks(
        found, LAID, EVERY, settled(found, EVERY, (both,), found.neutral)
    )
    assert unseen.block_fits[-1].expected_excess > 1e3
    assert unseen.fails_out_of_sample


def test_a_shape_that_one_block_alone_knows_is_told_beforehand():
    """As when a slip came; how much there is of it the other blocks have to say."""
    found = recording(3 * X + 4 * SHAPES["step.much"])
    form = Candidate("both", ("slope.much",), {"step.much": 4.0})
    unseen = BlockCrossValidation.from_blocks(
        found, LAID, EVERY, settled(found, EVERY, (form,), found.neutral)
    )
    assert unseen.fixed_indices == [set(), set(), set(), {NAMES.index("step.much")}]
    assert abs(unseen.block_fits[-1].excess_chi2) < 60
    moved = _fit_without_blocks(found, (form,), found.neutral, unseen.noise_splits, [set()] * 4)
    assert moved[-1].excess_chi2 > 1e4


def test_an_error_of_the_ruler_refutes_no_name(judged):
    ruler = 1.5 * SHAPES["ruler"]
    shares, kept = judged(recording(3 * X + ruler), (SLOPE,))
    assert shares["slope"] > 0.9
    assert kept.named_mechanisms


def test_a_block_that_alone_knows_of_a_name_says_nothing_of_it(judged):
    found = recording(np.where(BLOCK == 3, 10 * (X - 0.5), 0.0))
    # The level is known well: nothing is missing anywhere else.
    found.prior_sd[0] = 1e-3
    shares, _ = judged(found, (STEP,))
    assert shares["step"] == 1.0


@pytest.mark.parametrize("many", [1, 2])
def test_too_few_blocks_bear_nothing_out_and_refute_nothing(judged, many):
    few = Blocks(BLOCK * many // 4, tuple("ab")[:many], "lengths")
    shares, kept = judged(recording(3 * X), (SLOPE,), few)
    assert shares == {"slope": 1.0}
    assert [name.probability for name in kept.named_mechanisms] == [0.9]


def test_a_block_without_a_reading_is_left_alone(judged):
    shares, kept = judged(recording(3 * X, empty=True), (SLOPE,))
    assert shares["slope"] > 0.95
    assert kept.named_mechanisms

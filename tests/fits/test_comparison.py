"""The comparison ranks models correctly: the braid is best for a bare braid, and not with a thick wall."""

import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from fits.comparison import compare, list_splits
from pamjax.baselines.empirical import fit_gaylord
from pamjax.errors import BadInput
from pamjax.infer.fitting.cross_validation import exclude_rows
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.least_squares import solve_least_squares
from pamjax.infer.problem.dataset import predict_row_channels
from pamjax.model.muscle import Muscle, predict
from pamjax.records.case import Case
from pamjax.records.reading.muscle_toml import parse_muscle_toml
from pamjax.records.recording import Recording

LENGTHS = np.array([0.180, 0.185, 0.190, 0.195, 0.200])
PRESSURES = np.linspace(30e3, 300e3, 12)
LENGTH, PRESSURE = (grid.ravel() for grid in np.meshgrid(LENGTHS, PRESSURES, indexing="ij"))
NOISE = 2.0

BRAID, SAROSI = "braid, inelastic threads", "Sárosi"
INNER, REST = "inner lengths held out", "rest length held out"


def simulate_case(extra=0.0, pressure=PRESSURE, length=LENGTH):
    """Return the force of a bare braid with noise and exact lengths, plus the force of a wall."""
    truth = predict(Muscle(0.200, 0.2142, 1.203), jnp.asarray(pressure), jnp.asarray(length)).force
    noise = np.random.default_rng(3).normal(0, NOISE, pressure.size)
    muscle_toml = parse_muscle_toml(
        {
            "muscle": {
                "rest_length": "200 mm",
                "thread_length": {"value": "214 mm", "sd": "0.5 mm"},
                "turns": {"value": 1.2, "sd": 0.01},
            },
            "sensors": {"force": f"{NOISE} N", "length": {"sd": "0.2 mm", "per": "setting"}},
        }
    )
    force = np.asarray(truth) + noise + extra
    recording = Recording.from_arrays(pressure=pressure, length=length, force=force)
    return Case("simulated", Path(), muscle_toml, recording, "")


def thick_wall(pressure, length):
    """Return the force of a wall that needs pressure to inflate, and is compressed by shortening."""
    return -30.0 - 1e5 * (0.2 - length) ** 2 - 2e3 * (0.2 - length)


@pytest.fixture(scope="module")
def bare_comparison():
    case = simulate_case()
    fitted = fit(case, "inelastic", starts=1)
    return fitted, compare(case, [fitted])


def test_a_bare_braid_is_predicted_best_by_the_braid(bare_comparison):
    _, comparison = bare_comparison
    assert comparison.best(INNER) == comparison.best(REST) == BRAID
    assert comparison.rmse(BRAID, INNER) < 1.5 * NOISE
    assert comparison.rmse(BRAID, REST) < comparison.rmse("Gaylord, free threshold", REST)
    assert comparison.rmse(SAROSI, REST) > 3 * NOISE


def test_thick_wall_reverses_the_ranking():
    case = simulate_case(thick_wall(PRESSURE, LENGTH))
    comparison = compare(case, [fit(case, "inelastic", starts=1)])
    assert comparison.best("in sample") == comparison.best(INNER) == SAROSI
    assert comparison.rmse(BRAID, INNER) > 5 * comparison.rmse(SAROSI, INNER)


def test_rmse_agrees_with_a_separate_computation(bare_comparison):
    fitted, comparison = bare_comparison
    case = fitted.cases[0].case
    force = case.recording.force
    rows = force > 0.02 * force.max()
    assert comparison.rows == rows.sum()
    assert comparison.threshold == pytest.approx(0.02 * force.max())
    misfit = []
    for length in LENGTHS[1:-1]:
        training_mask, test_rows = rows & (length != LENGTH), rows & (length == LENGTH)
        law = fit_gaylord(PRESSURE[training_mask], LENGTH[training_mask], force[training_mask])
        misfit += list((force - law.force(PRESSURE, LENGTH))[test_rows])
    assert comparison.rmse("Gaylord", INNER) == pytest.approx(np.sqrt(np.mean(np.square(misfit))))


def test_held_out_length_does_not_affect_the_braid(bare_comparison):
    fitted, comparison = bare_comparison
    case = fitted.cases[0].case
    test_rows = np.isclose(LENGTH, 0.2) & (case.recording.force > comparison.threshold)
    hidden = exclude_rows(
        fitted.datasets[0], np.isclose(LENGTH, 0.2) | (case.recording.force < comparison.threshold)
    )
    values = fitted.space.to_named_values(
        solve_least_squares((hidden,), fitted.space, jnp.zeros(fitted.space.size), "square").u
    )
    assert float(values["length_error.5"]) == pytest.approx(0.0, abs=1e-9)
    assert abs(float(values["length_error.3"])) > 1e-6
    force = predict_row_channels(hidden, jnp.array(list(values.values())))[0, : test_rows.size]
    by_hand = np.sqrt(np.mean((case.recording.force - np.asarray(force))[test_rows] ** 2))
    assert comparison.rmse(BRAID, REST) == pytest.approx(float(by_hand), rel=1e-4)


def test_comparison_is_printed_as_a_table(bare_comparison):
    _, comparison = bare_comparison
    head, columns, *models = str(comparison).splitlines()
    assert head.startswith("simulated: rmse of force [N], ")
    assert columns.split("  ")[-3:] == ["in sample", INNER, REST]
    assert [line.split("  ")[1] for line in models[:4]] == [
        BRAID,
        "Gaylord",
        "Gaylord, free threshold",
        SAROSI,
    ]
    numbers = json.loads(json.dumps(comparison.as_dict(), allow_nan=False))
    assert numbers["rmse_N"][SAROSI][REST] == comparison.rmse(SAROSI, REST)


def test_failed_fit_reports_its_reason():
    case = simulate_case(np.where(LENGTH > 0.187, 0.0, np.nan))
    comparison = compare(case, [fit(case, "inelastic", starts=1)])
    assert np.isnan(comparison.rmse(SAROSI, INNER))
    assert "* this fit needs at least 3 different values of `contraction`; got 2" in str(comparison)
    assert comparison.as_dict()["rmse_N"][SAROSI][INNER] is None
    assert np.isfinite(comparison.rmse(BRAID, INNER))


def test_strokes_are_split_by_isobar():
    length = np.random.default_rng(1).uniform(0.18, 0.2, 160)
    case = simulate_case(0.0, np.repeat([100e3, 200e3, 300e3, 400e3], 40), length)
    splits = list_splits(case, np.ones(160, dtype=bool))
    assert [split.name for split in splits] == [
        "in sample",
        "inner isobars held out",
        "highest isobar held out",
    ]
    assert [int(rows.sum()) for rows in splits[1].test_masks] == [40, 40]
    assert not (splits[2].test_masks[0] & splits[2].training_masks[0]).any()


def test_a_case_without_force_is_refused():
    case = simulate_case()
    blank = Recording.from_arrays(pressure=PRESSURE, length=LENGTH, diameter=np.full(PRESSURE.size, 0.02))
    with pytest.raises(BadInput, match="a comparison of forces needs a measured force; got none"):
        compare(Case("blank", case.folder, case.muscle_toml, blank, ""))

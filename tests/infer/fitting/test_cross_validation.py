"""Cross-validation holds out complete blocks, which the fit does not use."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.infer.fitting.cross_validation import cross_validate, exclude_rows
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.joint_space import build_joint_space
from pamjax.infer.fitting.least_squares import solve_least_squares
from pamjax.infer.problem.dataset import build_dataset
from pamjax.records.blocks import find_blocks
from tests.infer.made import made


@pytest.fixture(scope="module")
def problem():
    """Return the standard case: dataset, parameter space, solution and blocks."""
    case = made()
    at, (rename,) = build_joint_space([case], "elastic", ())
    members = (build_dataset(case, "elastic", at, rename),)
    return (
        case,
        at,
        members,
        solve_least_squares(members, at, jnp.zeros(at.size)),
        find_blocks(case.recording),
    )


def unseen(problem, members):
    case, at, _, solution, blocks = problem
    deals, predictions = cross_validate([case], members, [blocks], at, solution, "square", 2, 0)
    return deals[0], predictions[0]


def wild(dataset, rows):
    """Return the dataset with scaled measurements in some rows."""
    mask = np.zeros(dataset.rows.force.size, dtype=bool)
    mask[: rows.size] = rows
    return eqx.tree_at(
        lambda m: (m.rows.force, m.rows.diameter),
        dataset,
        (
            jnp.where(mask, 7 * dataset.rows.force, dataset.rows.force),
            jnp.where(mask, 0.1, dataset.rows.diameter),
        ),
    )


def test_each_block_is_held_out_once(problem):
    blocks = problem[-1]
    deal, _ = unseen(problem, problem[2])
    assert np.all(np.sum(deal, axis=0) == (blocks.label >= 0))
    for fold in deal:
        held = np.unique(blocks.label[fold])
        assert np.array_equal(fold, np.isin(blocks.label, held))


def test_held_out_rows_do_not_affect_the_fit(problem):
    deal, honest = unseen(problem, problem[2])
    for fold in deal:
        _, disturbed = unseen(problem, (wild(problem[2][0], fold),))
        for channel in honest:
            np.testing.assert_array_equal(disturbed[channel][fold], honest[channel][fold])
            # Control: the fit of the other fold used them.
            seen = ~fold & np.isfinite(honest[channel])
            assert np.max(np.abs(disturbed[channel][seen] / honest[channel][seen] - 1)) > 0.1


def test_masked_rows_have_no_effect(problem):
    dataset, n = problem[2][0], problem[0].recording.n
    out = np.arange(n) < 10
    assert float(exclude_rows(dataset, out).rows.training_mask.sum()) == n - 10
    assert exclude_rows(dataset, None) is dataset


def test_score_uses_held_out_predictions():
    fitted = fit(made(), starts=1, fold_count=2)
    (case_fit,) = fitted.cases
    for channel, value in case_fit.held_out_score.rmse.items():
        off = getattr(case_fit.case.recording, channel) - case_fit.held_out_prediction[channel]
        assert value == pytest.approx(np.sqrt(np.nanmean(off**2)))
        # The model simulated the data: the error on a held-out isobar is almost the noise.
        assert 0.95 * case_fit.rmse[channel] < value < 1.3 * case_fit.rmse[channel]
    assert case_fit.held_out_score.kind == "isobars"
    assert sorted(name for fold in case_fit.held_out_score.folds for name in fold) == sorted(
        set(case_fit.block)
    )


def test_single_block_is_not_held_out(problem):
    case, at, members, solution, blocks = problem
    single = type(blocks)(np.zeros_like(blocks.label), ("all",), "isobars")
    deals, predictions = cross_validate([case], members, [single], at, solution, "square", 2, 0)
    assert deals == [[]]
    assert np.isnan(predictions[0]["force"]).all()

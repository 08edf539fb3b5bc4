"""Posteriors of one recording are compared by held-out prediction."""

import json

import numpy as np
import pytest

from pamjax.cli.main import main
from pamjax.errors import BadInput
from pamjax.infer.fitting.fit import fit
from pamjax.infer.posterior.compare import PosteriorComparison, PosteriorScore, compare
from pamjax.infer.posterior.io import save_posterior
from pamjax.infer.posterior.sample import sample
from pamjax.records.case import read_case
from tests.infer.posterior.test_sample import PAPER, drawn


@pytest.fixture(scope="module")
def elastic(tmp_path_factory):
    folder = tmp_path_factory.mktemp("elastic")
    save_posterior(drawn(), folder)
    return folder


@pytest.fixture(scope="module")
def inelastic(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inelastic")
    inelastic_fit = fit(read_case(PAPER), "inelastic", starts=1, fold_count=2)
    save_posterior(sample(inelastic_fit, seed=1, ess=400, rhat=1.05), folder)
    return folder


@pytest.mark.slow
def test_elastic_threads_predict_better(elastic, inelastic, capsys):
    comparison = compare([inelastic, elastic])
    assert comparison.scores[0].model == "elastic threads"
    less, error = comparison.compute_deficit(comparison.scores[1])
    assert less > 2 * error > 0
    assert main(["compare", str(inelastic), str(elastic), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == comparison.as_dict()
    assert "predicts better than" in str(comparison)


def test_equal_models_are_not_separated():
    each = np.random.default_rng(0).normal(size=10)
    shift = np.random.default_rng(1).normal(size=10)
    a, b = (
        PosteriorScore(n, "elastic threads", tuple("abcdefghij"), e, 0.1 + 0 * e)
        for n, e in (("a", each), ("b", each + shift))
    )
    comparison = PosteriorComparison((a, b) if a.total > b.total else (b, a))
    assert "predict equally well within the error" in str(comparison)


def test_influential_block_is_named():
    score = PosteriorScore(
        "a", "elastic threads", ("isobar 1 kPa", "isobar 2 kPa"), np.zeros(2), np.array([0.2, 0.9])
    )
    assert "a: the score of isobar 2 kPa is not reliable: Pareto k̂ is up to 0.9, above 0.7" in str(
        PosteriorComparison((score,))
    )


def test_invalid_posterior_is_refused(tmp_path):
    with pytest.raises(BadInput, match="there is no file"):
        compare([tmp_path])
    (tmp_path / "posterior.nc").write_text("no netCDF")
    with pytest.raises(BadInput, match="a posterior is a netCDF that `pamjax sample` wrote"):
        compare([tmp_path])

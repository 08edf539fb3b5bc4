"""A posterior on disk: readable by ArviZ, with units, blocks and checksums; its figures."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from pamjax.infer.posterior.identifiability_report import COMBINATION_KIND
from pamjax.infer.posterior.io import save_posterior
from pamjax.infer.posterior.predictive import sample_prior
from pamjax.view.figures.posterior import (
    find_ridges,
    plot_corner,
    plot_ridges,
    remove_stale_figures,
    save_posterior_figures,
)
from pamjax.view.figures.posterior_checks import plot_band, plot_profiles
from tests.agreement import ROUNDING, SAMPLED, agree
from tests.infer.posterior.test_sample import drawn

GROUPS = {
    "posterior", "prior", "log_likelihood", "posterior_predictive", "prior_predictive", "observed_data",
    "sample_stats",
}  # fmt: skip


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("out")
    assert [p.name for p in save_posterior(drawn(), folder)] == ["posterior.json", "posterior.nc"]
    return folder


def test_file_has_all_groups_and_attributes(written):
    with xr.open_datatree(written / "posterior.nc", engine="h5netcdf") as tree:
        assert set(tree) == GROUPS
        assert json.loads(tree.attrs["checksum"]) == {
            "chambers_wereley_2022": drawn().fit.cases[0].case.checksum
        }
        assert tree.attrs["seed"] == 1
        assert tree["posterior"]["thread.modulus"].attrs["units"] == "Pa"
        agree(tree["posterior"]["thread.modulus"].values, drawn().draws[:, :, 2].T, ROUNDING)
        assert tree["observed_data"]["diameter"].shape == (5,)
        assert tree["posterior_predictive"]["diameter"].shape == (1, 100, 5)


def test_arviz_reads_the_file(written):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import arviz

        read = arviz.from_netcdf(written / "posterior.nc")
        summary = arviz.summary(read, var_names=["thread.modulus"], fmt="long", kind="diagnostics")
        ess = arviz.ess(read.posterior)["thread.modulus"].item()
    # Before ArviZ 1.0 a method that returns names; later a property with paths, including the root.
    names = read.groups() if callable(read.groups) else read.groups
    assert {name.strip("/") for name in names} - {""} == GROUPS
    assert summary is not None
    # The effective sample size of ArviZ agrees approximately.
    assert 0.7 < ess / drawn().convergence.ess[2] < 1.4


def test_likelihood_is_the_sum_over_blocks(written):
    post = drawn()
    with xr.open_datatree(written / "posterior.nc", engine="h5netcdf") as tree:
        blocks = tree["log_likelihood"]["blocks"]
        assert list(tree["log_likelihood"]["block"].values) == [f"row {k}" for k in range(2, 7)]
        sums, draw = blocks.sum("block").values, blocks["draw"].values
    at = post.density.space
    for k in (0, 3):
        value = dict(zip(post.names, post.draws[draw[k], 0], strict=True))
        agree(sums[0, k], float(post.density.compute_log_likelihood(at.to_point(value))), 1e-6)


def test_prior_group_agrees_with_the_priors():
    draws = sample_prior(drawn().density, 20_000, 0)
    error = 20e9 / np.sqrt(20_000)
    assert abs(draws[:, 2].mean() - 112e9) < SAMPLED * error
    assert abs(draws[:, 2].std() - 20e9) < SAMPLED * error
    low, high = (float(a[3]) for a in (drawn().density.space.low, drawn().density.space.high))
    share = np.log(draws[:, 3] / low) / np.log(high / low)
    assert abs(share.mean() - 0.5) < SAMPLED * np.sqrt(1 / 12 / 20_000)


def test_interrupted_save_leaves_no_partial_file(tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(xr.DataTree, "to_netcdf", interrupted)
    with pytest.raises(KeyboardInterrupt):
        save_posterior(drawn(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["posterior.json"]


def test_figures_show_every_parameter():
    corner = plot_corner(drawn())
    assert sum(axes.axison for axes in corner.axes) == 10
    assert corner.get_suptitle().startswith("Strongest correlation: +0.9")
    (panel,) = (axes for axes in plot_band(drawn()).axes)
    assert "of rows in the 90 % prediction band" in panel.get_title("left").replace("\n", " ")
    points = [line for line in panel.lines if line.get_gid() == "measured"]
    assert sum(line.get_xdata().size for line in points) == 5
    lines = [
        line for axes in plot_profiles(drawn()).axes for line in axes.lines if line.get_gid() == "profile"
    ]
    assert len(lines) == 3
    assert all(line.get_ydata().min() == 0 for line in lines)


def test_figure_of_a_ridge_shows_the_priors():
    post = drawn()
    assert find_ridges(post) == []
    loose = {
        name: replace(v, kind=COMBINATION_KIND) if name != "thread.modulus" else v
        for name, v in post.verdicts.items()
    }
    other_post = replace(post)
    vars(other_post)["verdicts"] = loose
    assert find_ridges(other_post) == [(0, 1)]
    # The second parameter need not be reported as a combination itself.
    vars(other_post)["verdicts"] = loose | {"muscle.turns": post.verdicts["muscle.turns"]}
    assert find_ridges(other_post) == [(0, 1)]
    (panel,) = plot_ridges(other_post).axes
    before, after = (
        next(line for line in panel.lines if line.get_gid() == gid) for gid in ("prior", "posterior")
    )
    assert np.corrcoef(after.get_xydata().T)[0, 1] > 0.9
    assert abs(np.corrcoef(before.get_xydata().T)[0, 1]) < 0.1


def test_thinned_draws_come_from_all_chains():
    """A distance of 96 draws is a multiple of the 32 chains."""
    chain = np.broadcast_to(np.arange(32.0)[None, :, None], (1200, 32, 1))
    thinned = replace(drawn(), draws=chain).thin_draws(400)
    assert thinned.shape == (400, 1)
    assert set(thinned[:, 0]) == set(range(32))
    assert replace(drawn(), draws=chain[:2]).thin_draws(400).shape == (64, 1)


@pytest.mark.slow
def test_figures_are_written(tmp_path):
    names = {path.name for path in save_posterior_figures(drawn(), tmp_path)}
    assert names == {"corner.png", "marginals.png", "trace.png", "profile.png", "band.png"}
    assert names == {path.name for path in tmp_path.iterdir()}


def test_figures_of_an_earlier_posterior_are_removed(tmp_path):
    for name in ("ridge.png", "profile.png", "other.png"):
        (tmp_path / name).write_bytes(b"of an earlier posterior")
    remove_stale_figures(tmp_path, [tmp_path / "new" / "profile.png"])
    assert {path.name for path in tmp_path.iterdir()} == {"profile.png", "other.png"}

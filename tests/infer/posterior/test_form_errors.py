"""Posteriors of simulated muscles whose mechanism differs from its equation."""

import dataclasses
import json
from functools import cache

import equinox as eqx
import numpy as np
import pytest
import xarray as xr

from pamjax.errors import BadInput
from pamjax.infer.fitting.covariance import compute_sd_and_correlation
from pamjax.infer.posterior.compare import compare
from pamjax.infer.posterior.io import build_posterior_document, save_posterior
from pamjax.infer.posterior.predictive import predict_channels
from pamjax.infer.posterior.profile import build_profile_problem
from pamjax.infer.posterior.sample import sample
from tests.agreement import ENOUGH, ROUNDING, SAMPLED, agree
from tests.infer.deviating import MECHANISM, SENSORS, STRENGTH, compute_true_force, fit_case
from tests.infer.made import TRUE
from tests.infer.posterior.test_sample import fitted

QUICK = {"ess": 400.0, "rhat": 1.02, "seed": 1, "max_draws": 1500}


@cache
def draw_case(share, form_error):
    post = sample(fit_case(share, form_error), **QUICK)
    assert post.convergence.ess.min() > ENOUGH
    return post


def compute_band(post):
    """Return the 90 % band of the force without noise, (2, rows), N."""
    values = post.thin_draws(400)
    force = predict_channels(post.density, values, post.draw_coefficients(values)[0], 0)["force"]
    return np.quantile(force, (0.05, 0.95), axis=0)[:, : post.fit.cases[0].case.recording.n]


def compute_share_inside(post, force):
    low, high = compute_band(post)
    return np.mean((force > low) & (force < high))


@pytest.mark.slow
def test_posterior_agrees_with_least_squares():
    """With the noise of the fit, and narrow priors of the skewed parameters, both are nearly Gaussian."""
    fit = fit_case(0.3, True)
    whitening = fit.datasets[0].whitening
    # The fit includes its misfit in its standard deviations, the posterior in its noise.
    noise_sd = SENSORS.force * float(np.sqrt(whitening.variance_inflation))
    priors = {
        "contact_pressure.fill": {"value": 0.1, "sd": 0.01},
        "thread.modulus": {"value": 35e9, "sd": 1e9},
        "noise.force": {"value": noise_sd, "sd": 1e-3 * noise_sd},
        "noise.force_correlation": {"value": float(whitening.correlation[0]), "sd": 1e-3},
    }
    post = sample(fit, priors=priors, **QUICK)
    problem = build_profile_problem(fit, post.density.space)
    sd, _ = compute_sd_and_correlation(problem.solution.total_information, problem.solution.slope)
    for k, (value, own_sd) in enumerate(zip(problem.values, sd, strict=True)):
        m, ess = post.marginals[post.names[k]], post.convergence.ess[k]
        assert ess > ENOUGH
        # The curvature of the model shifts mean and sd by up to a tenth of the sd.
        assert abs(m.mean - value) < (SAMPLED / np.sqrt(ess) + 0.1) * own_sd
        assert abs(m.sd / own_sd - 1) < 2 * SAMPLED / np.sqrt(2 * ess) + 0.1


@pytest.mark.slow
def test_band_contains_the_true_force_only_with_form_errors():
    true_force = compute_true_force(0.3)
    assert compute_share_inside(draw_case(0.3, True), true_force) > 0.8
    assert compute_share_inside(draw_case(0.3, False), true_force) < 0.5


@pytest.mark.slow
def test_interval_contains_the_truth_only_with_form_errors():
    true = TRUE | STRENGTH
    worst = [
        max(
            abs(m.mean - true[name]) / m.sd
            for name, m in draw_case(0.3, form_error).marginals.items()
            if name in true
        )
        for form_error in (True, False)
    ]
    assert worst[0] < 2.0 < 4.0 < worst[1]


@pytest.mark.slow
def test_report_and_files_have_the_size_of_the_form_error(tmp_path):
    post = draw_case(0.3, True)
    (sizes,) = post.form_errors
    assert sizes[MECHANISM].ratio.mean() == pytest.approx(0.28, abs=0.05)
    assert "form error of contact_pressure: 2" in str(post)
    document = json.loads(json.dumps(build_posterior_document(post), allow_nan=False))
    entry = document["form_errors"]["made"][MECHANISM]
    assert entry["share"] == pytest.approx(0.3)
    assert entry["ratio"]["low"] < entry["ratio"]["mean"] < entry["ratio"]["high"]
    assert entry["textbook_rms"]["force"]["value"] == pytest.approx(150, rel=0.1)
    # Coefficients are no parameters that a user asked for.
    assert set(document["parameters"]) == {*post.fit.estimates, "noise.force", "noise.force_correlation"}
    save_posterior(post, tmp_path)
    with xr.open_datatree(tmp_path / "posterior.nc", engine="h5netcdf") as tree:
        group = tree["form_errors"].to_dataset()
        assert set(group["mechanism"].values) == {MECHANISM}
        form = np.einsum("cdf,fr->cdr", group["coefficients"], group["force_form"])
        draw = int(group["draw"][3])
        # The file is sufficient for the prediction of a draw.
        values = post.draws[draw, 2][None]
        prediction = predict_channels(post.density, values, group["coefficients"].values[None, 2, 3], 0)
        equations = predict_channels(post.density, values, np.zeros((1, group.sizes["form"])), 0)
        n = group.sizes["row"]
        agree((prediction["force"] - equations["force"])[0, :n], form[2, 3], ROUNDING, scale=1e3)


@pytest.mark.slow
def test_exact_equation_has_the_posterior_without_form_errors():
    with_form, without = (sample(fit_case(0.0, on), max_draws=100, seed=1) for on in (True, False))
    assert not with_form.density.has_form_errors
    # The fits agree to 1e-5, and so do the chains, as long as they accept the same proposals.
    agree(with_form.density.space.mean, without.density.space.mean, 1e-9)
    assert "form error of contact_pressure: none, textbook part" in str(with_form)


@pytest.mark.slow
def test_resumed_chain_keeps_its_form_errors(tmp_path):
    fit = fit_case(0.3, True)
    first = sample(fit, checkpoint=tmp_path, max_draws=100, seed=1)
    (dataset,) = fit.datasets
    moved = eqx.tree_at(lambda d: d.form_filter.columns, dataset, 1.001 * dataset.form_filter.columns)
    resumed = sample(dataclasses.replace(fit, datasets=(moved,)), checkpoint=tmp_path, max_draws=200, seed=1)
    np.testing.assert_array_equal(resumed.density.forms[0].columns, first.density.forms[0].columns)
    np.testing.assert_array_equal(resumed.draws, sample(fit, max_draws=200, seed=1).draws)
    with pytest.raises(BadInput, match="can only be resumed with the same model"):
        sample(_set_share(fit, 0.1), checkpoint=tmp_path, max_draws=100, seed=1)


def _set_share(fit, share):
    (case_fit,) = fit.cases
    parts = {id: dataclasses.replace(part, share=share) for id, part in case_fit.form_errors.items()}
    return dataclasses.replace(fit, cases=(dataclasses.replace(case_fit, form_errors=parts),))


@pytest.mark.slow
def test_posterior_with_form_errors_predicts_held_out_blocks_better(tmp_path):
    for name, form_error in (("with", True), ("without", False)):
        save_posterior(draw_case(0.3, form_error), tmp_path / name)
    comparison = compare([tmp_path / "without", tmp_path / "with"])
    assert comparison.scores[0].model == "elastic threads, contact_pressure with form errors"
    deficit, error = comparison.compute_deficit(comparison.scores[1])
    assert deficit > 2 * error > 0


def test_fit_without_form_errors_is_refused():
    with pytest.raises(BadInput, match="`form_error` needs a fit with form errors; got a fit without"):
        sample(fitted(), form_error=True)

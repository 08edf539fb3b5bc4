"""The posterior of the paper's Table 1 agrees with a grid and another sampler; runs can be continued."""

import dataclasses
import functools
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit

import pamjax
from pamjax.errors import BadInput
from pamjax.infer.fitting.fit import fit
from pamjax.infer.posterior.sample import sample
from tests.agreement import ENOUGH, SAMPLED

PAPER = Path(__file__).parents[3] / "fits/chambers_wereley_2022"
QUICK = {"ess": 400.0, "rhat": 1.02}
KEPT = "draws-*.npz"


@functools.cache
def fitted():
    return fit(pamjax.read_case(PAPER), starts=1, fold_count=2)


@functools.cache
def drawn(sampler="emcee"):
    return sample(fitted(), sampler=sampler, seed=1)


def by_grid():
    """Return means and sds of thread length (m), turns, modulus (Pa) and ln sd of the diameter by a grid."""
    pressure = np.array([689, 552, 414, 276, 138]) * 1e3
    measured = np.array([26.52, 26.34, 26.11, 25.91, 25.63]) * 1e-3
    rest, threads, area = 9.28125 * 25.4e-3, 144, 0.0858e-6
    # Each axis extends far beyond the posterior; the modulus has a logarithmic axis.
    length = np.linspace(250.3e-3, 252.4e-3, 71)
    turns = np.linspace(1.07, 1.11, 41)
    modulus = np.exp(np.linspace(np.log(50e9), np.log(170e9), 71))
    reference = 0.01 * np.ptp(measured)
    log_sd = np.linspace(np.log(4e-6), np.log(100 * reference * (1 - 1e-9)), 45)
    b, n, e, s = np.meshgrid(length, turns, modulus, log_sd, indexing="ij", sparse=True)
    # p stretches a thread so that B = B0 / (1 − P L B0 / (2 π N² n E A)): the paper's closed form.
    misfit = 0.0
    for p, d in zip(pressure, measured, strict=True):
        stretched = b / (1 - p * rest * b / (2 * np.pi * n**2 * threads * e * area))
        misfit = misfit + (d - np.sqrt(stretched**2 - rest**2) / (np.pi * n)) ** 2
    log_density = -5 * s - 0.5 * misfit / np.exp(2 * s)
    log_density = log_density - 0.5 * ((b - 9.89 * 25.4e-3) / (0.03125 * 25.4e-3)) ** 2
    log_density = log_density - 0.5 * ((n - 1.09) / 0.005) ** 2 - 0.5 * ((e - 112e9) / 20e9) ** 2 + np.log(e)
    weight = np.exp(log_density - log_density.max())
    weight /= weight.sum()
    moments = []
    for x in (b, n, e, s):
        mean = float((weight * x).sum())
        moments.append((mean, float(np.sqrt((weight * (x - mean) ** 2).sum()))))
    return moments


def noisy(post):
    """Return draws of each parameter (ln of the sd), and effective sample sizes."""
    assert post.convergence.ess.min() > ENOUGH
    draws = post.flat.copy()
    draws[:, 3] = np.log(draws[:, 3])
    return draws.mean(0), draws.std(0), post.convergence.ess


@pytest.mark.slow
def test_posterior_agrees_with_a_grid():
    mean, sd, ess = noisy(drawn())
    assert drawn().converged
    for k, (grid_mean, grid_sd) in enumerate(by_grid()):
        assert abs(mean[k] - grid_mean) < SAMPLED * grid_sd / np.sqrt(ess[k]) + 0.02 * grid_sd
        # Tails increase the error of an sd above the Gaussian value 1 / sqrt(2 ESS).
        assert abs(sd[k] / grid_sd - 1) < 2 * SAMPLED / np.sqrt(2 * ess[k])


@pytest.mark.slow
def test_posterior_agrees_with_least_squares():
    for name, e in fitted().estimates.items():
        m = drawn().marginals[name]
        assert abs(m.median - e.value) < e.sd
        assert m.low < e.value < m.high


@pytest.mark.slow
def test_posterior_agrees_with_another_sampler():
    by_emcee, by_nuts = noisy(drawn()), noisy(drawn("nuts"))
    for k in range(4):
        sd = by_emcee[1][k]
        error = sd * np.sqrt(1 / by_emcee[2][k] + 1 / by_nuts[2][k])
        assert abs(by_emcee[0][k] - by_nuts[0][k]) < SAMPLED * error
        # A shift of the log-density by a third of an sd would be detected.
        assert SAMPLED * error < 0.34 * sd


@pytest.mark.slow
def test_draws_depend_only_on_the_seed():
    a, b, c = (sample(fitted(), seed=s, **QUICK).draws for s in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert a.shape != c.shape or not np.array_equal(a, c)


@pytest.mark.slow
def test_finished_run_is_reused(tmp_path):
    first = sample(fitted(), seed=1, checkpoint=tmp_path, **QUICK)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    again = sample(fitted(), seed=1, checkpoint=tmp_path, **QUICK)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == before
    np.testing.assert_array_equal(first.draws, again.draws)


@pytest.mark.slow
def test_higher_target_continues_a_run(tmp_path):
    low = sample(fitted(), seed=1, checkpoint=tmp_path, ess=100, rhat=1.1)
    count = len(list(tmp_path.glob(KEPT)))
    high = sample(fitted(), seed=1, checkpoint=tmp_path, ess=3000, rhat=1.1)
    assert len(list(tmp_path.glob(KEPT))) > count
    assert high.convergence.ess.min() >= 3000 > low.convergence.ess.min()


def test_too_few_draws_are_returned_with_a_warning():
    post = sample(fitted(), max_draws=150)
    assert not post.converged
    assert "NOT CONVERGED" in str(post)
    assert post.draws.shape[0] == 120


def test_chain_of_another_problem_is_refused(tmp_path):
    sample(fitted(), seed=1, checkpoint=tmp_path, max_draws=100)
    for change, difference in {
        "data": "another recording",
        "model": "another model",
        "priors": "other priors",
    }.items():
        document = json.loads((tmp_path / "identity.json").read_text())
        (tmp_path / "identity.json").write_text(json.dumps(document | {change: "else"}))
        with pytest.raises(BadInput, match=rf"can only be resumed with the same {change}; got {difference}"):
            sample(fitted(), seed=1, checkpoint=tmp_path, max_draws=100)
        (tmp_path / "identity.json").write_text(json.dumps(document))
    with pytest.raises(BadInput, match=r"the same priors"):
        sample(fitted(), seed=1, checkpoint=tmp_path, priors={"thread.modulus": {"sd": 1e9}})
    with pytest.raises(BadInput, match=r"the same model; got another model"):
        sample(_with_memory(fitted(), gaps="anew"), seed=1, checkpoint=tmp_path)
    with pytest.raises(BadInput, match=r"the same seed; got 1, not 2"):
        sample(fitted(), seed=2, checkpoint=tmp_path)


def _with_memory(original_fit, **changes):
    (case_fit,) = original_fit.cases
    case = dataclasses.replace(case_fit.case, **changes)
    return dataclasses.replace(original_fit, cases=(dataclasses.replace(case_fit, case=case),))


CHILD = """
import sys
from pathlib import Path
import pamjax
from pamjax.infer.fitting.fit import fit
fitted = fit(pamjax.read_case(sys.argv[1]), starts=1, fold_count=2)
pamjax.sample(fitted, seed=1, checkpoint=Path(sys.argv[2]), ess=3000.0, rhat=1.1)
"""


@pytest.mark.slow
def test_killed_run_continues_with_the_same_draws(tmp_path):
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(PAPER), str(tmp_path / "chain")])
    patience = time.monotonic() + 120
    while len(list((tmp_path / "chain").glob(KEPT))) < 3 and time.monotonic() < patience:
        assert child.poll() is None
        time.sleep(0.002)
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    saved = {path: path.read_bytes() for path in (tmp_path / "chain").glob(KEPT)}
    assert saved
    want = {"seed": 1, "ess": 3000.0, "rhat": 1.1}
    resumed = sample(fitted(), checkpoint=tmp_path / "chain", **want)
    assert {path: path.read_bytes() for path in saved} == saved
    assert len(list((tmp_path / "chain").glob(KEPT))) > len(saved), (
        "the child had finished before it was killed"
    )
    np.testing.assert_allclose(resumed.draws, sample(fitted(), **want).draws, rtol=1e-9)


def test_prior_affects_the_posterior():
    narrow = sample(fitted(), priors={"thread.modulus": {"value": 100e9, "sd": 0.5e9}}, seed=1, **QUICK)
    m = narrow.marginals["thread.modulus"]
    assert abs(m.mean - 100e9) < 1e9
    assert m.sd < 0.6e9
    assert "thread.modulus: 100.00 ± 0.50 GPa (replaces that of muscle.toml)" in str(narrow)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"sampler": "gibbs"}, "unknown sampler 'gibbs'. Valid names are `emcee`, `nuts`."),
        ({"ess": 0}, "`ess` must be at least 1; got 0"),
        (
            {"priors": {"thread.modulo": {}}},
            "'thread.modulo' is not a free parameter of this fit. Did you mean",
        ),
        (
            {"priors": {"thread.modulus": {"low": 1.0}}},
            "bounds of `thread.modulus` must be ascending and within",
        ),
    ],
)
def test_invalid_problem_is_refused(arguments, message):
    with pytest.raises(BadInput, match=message):
        sample(fitted(), **arguments)


def test_soft_loss_is_refused():
    with pytest.raises(BadInput, match="a posterior needs a likelihood; got a soft loss"):
        sample(dataclasses.replace(fitted(), loss="soft"))


@pytest.mark.slow
def test_prior_is_a_normalised_density():
    at = drawn().density.space
    # Along one parameter, with the others at their starts, the density of u integrates to one.
    for k in range(at.size):
        u = (
            jnp.linspace(-12, 12, 4001)
            if jnp.isfinite(at.sd[k])
            else jnp.linspace(-30, 30, 4001) / at.width[k]
        )
        points = jnp.zeros((u.size, at.size)).at[:, k].set(u)
        log_density = jax.vmap(at.compute_log_prior)(points)
        alone = log_density - log_density[u.size // 2] + _alone(at, k)
        assert abs(np.trapezoid(np.exp(alone), u) - 1) < 1e-3


def _alone(at, k):
    """Return the log-density of parameter k at u = 0, in u."""
    low, high, z, width = (float(a[k]) for a in (at.low, at.high, at.origin, at.width))
    share = float(expit(z))
    if not np.isfinite(at.sd[k]):
        return np.log(share * (1 - share) * width)
    value = float(at.to_values(np.zeros(at.size))[k])
    slope = value * np.log(high / low) if at.log_scale[k] else high - low
    density = np.exp(-0.5 * ((value - at.mean[k]) / at.sd[k]) ** 2) / at.sd[k] / np.sqrt(2 * np.pi)
    return np.log(density * slope * share * (1 - share) * width)

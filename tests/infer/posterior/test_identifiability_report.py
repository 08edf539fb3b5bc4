"""Report of two ridges: n E A, and thread length with modulus from diameters."""

from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pamjax
from pamjax.infer.fitting.determination import (
    DETERMINED,
    NOT_DETERMINED,
    PARTLY_DETERMINED,
    describe_sd_ratio,
)
from pamjax.infer.fitting.least_squares import solve_least_squares
from pamjax.infer.posterior.identifiability_report import (
    ParameterSummary,
    _classify_parameter,
    _describe_prior_share,
    _format_product,
)
from pamjax.infer.posterior.profile import LikelihoodProfile, ProfileProblem, compute_profile
from pamjax.infer.problem.parameter_space import FreeParameter, build_space
from pamjax.model.parameters import find_meaning
from tests.infer.posterior.test_sample import drawn, fitted

MUSCLE = """\
[muscle]
rest_length = "235.744 mm"
length = "235.744 mm"
threads = 144
thread_area = {area}
thread_length = {length}
turns = 1.09

[thread]
modulus = {{value = "90 GPa", sd = "30 GPa"}}

[sensors]
diameter = "0.01 mm"
"""
KNOWN = '{value = "251.2 mm", sd = "0.1 mm"}'
UNKNOWN = '{value = "251.2 mm", sd = "0.8 mm"}'


def case(folder, pressures, **quantities):
    """Return diameters for 85 GPa and 251.3 mm by the closed form."""
    folder.mkdir()
    (folder / "muscle.toml").write_text(MUSCLE.format(**quantities))
    rest, thread, turns = 0.235744, 0.2513, 1.09
    rows = ["pressure [kPa],diameter [mm]"]
    for p in pressures:
        pull = 1e3 * p * rest * thread / (2 * np.pi * turns**2 * 144 * 0.0858e-6 * 85e9)
        diameter = np.sqrt((thread / (1 - pull)) ** 2 - rest**2) / (np.pi * turns)
        rows.append(f"{p},{1e3 * diameter:.4f}")
    (folder / "recording.csv").write_text("\n".join(rows) + "\n")
    return pamjax.read_case(folder)


def verdicts(case):
    return pamjax.sample(case, ess=200, rhat=1.1, max_draws=1000).verdicts


@pytest.mark.slow
def test_only_the_product_of_modulus_and_area_is_determined(tmp_path):
    area = '{value = "0.0858 mm^2", sd = "0.03 mm^2"}'
    verdict_by_name = verdicts(case(tmp_path / "a", (138, 276, 414, 552, 689), area=area, length=KNOWN))
    for name in ("thread.modulus", "muscle.thread_area"):
        assert verdict_by_name[name].kind == "determined only in combination"
        assert "thread.modulus × muscle.thread_area" in verdict_by_name[name].detail or (
            "muscle.thread_area × thread.modulus" in verdict_by_name[name].detail
        )
    assert verdict_by_name["muscle.thread_length"].kind == DETERMINED


@pytest.mark.slow
def test_length_and_modulus_are_confounded_at_one_pressure(tmp_path):
    verdict_by_name = verdicts(case(tmp_path / "b", (680, 684, 689), area='"0.0858 mm^2"', length=UNKNOWN))
    verdict = verdict_by_name["thread.modulus"]
    assert verdict.kind == "determined only in combination"
    assert "is not detectable" in verdict.detail
    # A longer thread is compensated by a higher stiffness.
    assert verdict.detail.count("+") == 2


@pytest.mark.slow
def test_five_diameters_determine_length_and_modulus_but_not_turns():
    kinds = {name: v.kind for name, v in drawn().verdicts.items()}
    assert kinds == {
        "muscle.thread_length": DETERMINED,
        "muscle.turns": NOT_DETERMINED,
        "thread.modulus": DETERMINED,
    }


@pytest.mark.slow
def test_profile_of_a_parabola_agrees_with_least_squares():
    # Two sd to each side, where the posterior is nearly Gaussian.
    along = drawn().verdicts["muscle.thread_length"].profile
    e = drawn().fit.estimates["muscle.thread_length"]
    assert abs((along.high - along.low) / 4 / e.sd - 1) < 0.1
    assert along.rise.min() == 0


@pytest.mark.parametrize("ratio", [0.3, 0.48, 0.52, 0.9, 0.97])
def test_sample_and_fit_use_the_same_words(ratio):
    summary = ParameterSummary(0.0, 5.0, False, "1", 2.0, prior_sd=0.4, determined_alone=True)
    draws = 2.0 + 0.4 * ratio * np.tile([-1.0, 1.0], 50)
    kind, detail = _describe_prior_share(draws, summary)
    assert describe_sd_ratio(ratio).startswith(kind)
    assert (
        detail
        == {
            DETERMINED: "",
            PARTLY_DETERMINED: f"sd {100 * ratio:.0f} % of the prior sd",
            NOT_DETERMINED: "posterior equals prior",
        }[kind]
    )


@pytest.mark.parametrize(
    ("draws", "kind"),
    [
        # In a wide range, a small value with a small sd is not at its limit.
        (lambda rng: np.abs(rng.normal(0.12, 0.018, 4000)), DETERMINED),
        (lambda rng: np.abs(rng.normal(0.0, 0.018, 4000)), "at a limit"),
        (lambda rng: rng.exponential(0.1, 4000), "at a limit"),
        (lambda rng: 5 - rng.exponential(0.1, 4000), "at a limit"),
        (lambda rng: rng.uniform(0, 5, 4000), DETERMINED),
        (lambda rng: 5 * np.sqrt(rng.uniform(0, 1, 4000)), DETERMINED),
    ],
)
def test_parameter_is_at_a_limit_if_its_draws_accumulate_there(draws, kind):
    summary = ParameterSummary(
        low=0.0,
        high=5.0,
        log_scale=False,
        unit="1",
        value=0.1,
        prior_sd=5 / np.sqrt(12),
        determined_alone=True,
    )
    # The profile reports a determined parameter; the draws show whether it is at a limit.
    along = LikelihoodProfile(values=np.arange(3.0), rise=np.zeros(3), low=0.05, high=0.2)
    assert _classify_parameter(summary, draws(np.random.default_rng(2)), along)[0] == kind


class LinearDataset(eqx.Module):
    """A dataset whose two force residuals are linear in the parameters; the diameters fit exactly."""

    rows: SimpleNamespace = eqx.field(static=True)
    jacobian: jax.Array
    truth: jax.Array
    channel_weights: jax.Array
    whitening: None = None

    def compute_weighted_residuals(self, values):
        return self.jacobian @ (values - self.truth), jnp.zeros(2)

    def whiten_form_errors(self, white):
        return white


def test_profile_near_the_limit_of_a_wide_range_has_two_ends():
    """0.13 ± 0.035 N in a range of 500 N, correlated with another parameter."""
    truth = {"braid_friction.constant": 0.13, "braid_friction.coefficient": 0.2}
    prior_sd = {"braid_friction.constant": np.inf, "braid_friction.coefficient": 1.0}
    space = build_space([FreeParameter(n, find_meaning(n), truth[n], sd) for n, sd in prior_sd.items()])
    jacobian = jnp.array([[60.0, 20.0], [20.0, 20.0]])
    rows = SimpleNamespace(pressure=np.zeros(2))
    dataset: Any = LinearDataset(rows, jacobian, jnp.array(list(truth.values())), jnp.ones(2))
    solution = solve_least_squares((dataset,), space, space.to_point(truth))
    profile = compute_profile(
        ProfileProblem((dataset,), space, "square", solution), "braid_friction.constant"
    )
    # The sd that includes the uncertainty of the other parameter; without it, 0.016 N.
    sd = np.sqrt(np.linalg.inv(np.asarray(jacobian.T @ jacobian) + np.diag([0.0, 1.0]))[0, 0])
    assert profile.low == pytest.approx(0.13 - 2 * sd, abs=0.1 * sd)
    assert profile.high == pytest.approx(0.13 + 2 * sd, abs=0.1 * sd)


def test_ridge_of_a_product_is_reported_as_a_product():
    assert _format_product(["a", "b"], np.array([1.0, -1.02])) == "a / b"
    assert _format_product(["a", "b", "c"], np.array([1.0, 0.5, 0.95])) == "a × b^0.5 × c"


@pytest.mark.slow
def test_report_compares_with_the_stated_values():
    # Five diameters determine the modulus to 4 GPa, as the other computations do.
    priors = {"thread.modulus": {"value": 84e9, "sd": 3e9}}
    verdict = pamjax.sample(fitted(), priors=priors, ess=200, rhat=1.1, seed=1).verdicts["thread.modulus"]
    assert verdict.kind == PARTLY_DETERMINED
    assert drawn().verdicts["thread.modulus"].kind == DETERMINED


def test_profile_uses_the_priors_of_the_other_parameters():
    # With known turns, five diameters determine the length much better.
    priors = {"muscle.turns": {"value": 1.09, "sd": 1e-5}}
    post = pamjax.sample(fitted(), priors=priors, ess=200, rhat=1.1, seed=1)
    loose, held = (p.verdicts["muscle.thread_length"].profile for p in (drawn(), post))
    assert held.high - held.low < 0.5 * (loose.high - loose.low)

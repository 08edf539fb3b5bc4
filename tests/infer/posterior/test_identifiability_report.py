"""Report of two ridges: n E A, and thread length with modulus from diameters."""

from types import SimpleNamespace

import jax
import numpy as np
import pytest

import pamjax
from pamjax.infer.fitting.determination import DETERMINED, MOSTLY_PRIOR, NOT_DETERMINED
from pamjax.infer.posterior import profile as profiles
from pamjax.infer.posterior.identifiability_report import (
    ParameterSummary,
    _classify_parameter,
    _format_product,
)
from pamjax.infer.posterior.profile import LikelihoodProfile
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


def case(folder, pressures, **said):
    """Return diameters for 85 GPa and 251.3 mm by the closed form."""
    folder.mkdir()
    (folder / "muscle.toml").write_text(MUSCLE.format(**said))
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
    found = verdicts(case(tmp_path / "a", (138, 276, 414, 552, 689), area=area, length=KNOWN))
    for name in ("thread.modulus", "muscle.thread_area"):
        assert found[name].kind == "only in combination"
        assert "thread.modulus × muscle.thread_area" in found[name].detail or (
            "muscle.thread_area × thread.modulus" in found[name].detail
        )
    assert found["muscle.thread_length"].kind == DETERMINED


@pytest.mark.slow
def test_length_and_modulus_are_confounded_at_one_pressure(tmp_path):
    found = verdicts(case(tmp_path / "b", (680, 684, 689), area='"0.0858 mm^2"', length=UNKNOWN))
    said = found["thread.modulus"]
    assert said.kind == "only in combination"
    assert "is not detectable" in said.detail
    # A longer thread is compensated by a higher stiffness.
    assert said.detail.count("+") == 2


@pytest.mark.slow
def test_five_diameters_determine_length_and_modulus_but_not_turns():
    kinds = {name: v.kind for name, v in drawn().verdicts.items()}
    assert kinds == {
        "muscle.thread_length": DETERMINED,
        "muscle.turns": NOT_DETERMINED,
        "thread.modulus": DETERMINED,
    }


def test_profile_of_a_parabola_agrees_with_least_squares():
    # Two sd to each side, where the posterior is nearly Gaussian.
    along = drawn().verdicts["muscle.thread_length"].profile
    e = drawn().fit.estimates["muscle.thread_length"]
    assert abs((along.high - along.low) / 4 / e.sd - 1) < 0.1
    assert along.rise.min() == 0


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
    told = ParameterSummary(
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
    assert _classify_parameter(told, draws(np.random.default_rng(2)), along)[0] == kind


def test_profile_works_near_the_limit_of_a_wide_range(monkeypatch):
    """0.13 ± 0.05 N in a range of 500 N: near its limit, and bounded on both sides."""
    about = find_meaning("braid_friction.constant")
    at = build_space([FreeParameter("braid_friction.constant", about, 0.13, np.inf)])
    top = at.to_point({"braid_friction.constant": 0.13})
    slope = jax.grad(lambda u: at.to_values(u)[0])(top)
    monkeypatch.setattr(profiles, "compute_sd_in_u", lambda _: 0.05 / np.asarray(slope))
    monkeypatch.setattr(
        profiles,
        "_solve_with_fixed",
        lambda _, k, u: (0.5 * float(((at.to_values(u)[k] - 0.13) / 0.05) ** 2), u),
    )
    problem = profiles.ProfileProblem((), at, "square", SimpleNamespace(u=top))  # pyright: ignore[reportArgumentType]
    found = profiles.compute_profile(problem, "braid_friction.constant")
    assert found.low == pytest.approx(0.03, abs=0.01)
    assert found.high == pytest.approx(0.23, abs=0.01)


def test_ridge_of_a_product_is_reported_as_a_product():
    assert _format_product(["a", "b"], np.array([1.0, -1.02])) == "a / b"
    assert _format_product(["a", "b", "c"], np.array([1.0, 0.5, 0.95])) == "a × b^0.5 × c"


def test_report_compares_with_the_stated_values():
    # Five diameters determine the modulus to 4 GPa, as the other computations do.
    told = {"thread.modulus": {"value": 84e9, "sd": 3e9}}
    found = pamjax.sample(fitted(), priors=told, ess=200, rhat=1.1, seed=1).verdicts["thread.modulus"]
    assert found.kind == MOSTLY_PRIOR
    assert drawn().verdicts["thread.modulus"].kind == DETERMINED


def test_profile_uses_the_priors_of_the_other_parameters():
    # With known turns, five diameters determine the length much better.
    told = {"muscle.turns": {"value": 1.09, "sd": 1e-5}}
    post = pamjax.sample(fitted(), priors=told, ess=200, rhat=1.1, seed=1)
    loose, held = (p.verdicts["muscle.thread_length"].profile for p in (drawn(), post))
    assert held.high - held.low < 0.5 * (loose.high - loose.low)

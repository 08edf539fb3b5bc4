"""Fits recover the parameters of simulated muscles, and report correct standard deviations."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import lmfit
import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.joint_space import build_joint_space
from pamjax.infer.fitting.least_squares import (
    inflate_information,
    linearise_problem,
    soften_residual,
    solve_least_squares,
    stack_residuals,
)
from pamjax.infer.fitting.report import describe_contradicted_values
from pamjax.infer.fitting.reweight import add_whitening
from pamjax.infer.problem.dataset import build_dataset
from pamjax.records.reading.muscle_toml import Sensors
from pamjax.records.reading.quantity import MeasuredValue
from tests.agreement import RECOVERED, ROUNDING, agree
from tests.infer.made import RAMPS, SD, SENSORS, TRUE, made, sds_off

QUICK = {"starts": 1, "fold_count": 2}
EXACT = Sensors()


@pytest.fixture(scope="module")
def standard_fit():
    """Return the fit of the standard case."""
    return fit(made(), **QUICK)


def in_space(case, law="elastic"):
    at, (rename,) = build_joint_space([case], law, ())
    return at, (build_dataset(case, law, at, rename),)


@pytest.mark.parametrize("law", ["inelastic", "elastic", "toe", "exponential-toe", "recruitment-toe"])
def test_noise_free_residuals_vanish_at_the_true_parameters(law):
    at, members = in_space(made(law, bench=EXACT, off=(0, 0, 0)), law)
    values = jnp.array([TRUE[n] for n in at.names])
    assert members[0].rows.force_weight.sum() > 0
    for misfit in members[0].compute_standardised_residuals(values):
        agree(misfit, 0.0, 1e-7, scale=1.0)


@pytest.mark.parametrize(
    ("law", "channels"),
    [
        ("inelastic", ("force", "diameter")),
        ("elastic", ("force", "diameter")),
        ("elastic", ("force",)),
        ("elastic", ("diameter",)),
        pytest.param("toe", ("force", "diameter"), marks=pytest.mark.slow),
        pytest.param("exponential-toe", ("force", "diameter"), marks=pytest.mark.slow),
        pytest.param("recruitment-toe", ("force", "diameter"), marks=pytest.mark.slow),
    ],
)
def test_true_parameters_are_recovered(law, channels):
    fitted = fit(made(law, seed=3, channels=channels), law, **QUICK)
    off = sds_off(fitted)
    assert fitted.converged
    assert set(off) >= {"muscle.thread_length", "muscle.turns"}
    assert max(map(abs, off.values())) < RECOVERED, off


def test_stated_values_differ_from_the_truth(standard_fit):
    # Negative control: the stated values differ from the truth by many sd of the fit.
    moved = [abs(e.prior - TRUE[n]) / e.sd for n, e in standard_fit.estimates.items()]
    assert min(moved) > 2 * RECOVERED


def test_rest_length_without_effect_is_not_fitted():
    at, _ = in_space(made(rest_length=MeasuredValue(TRUE["muscle.rest_length"], 1e-3)))
    assert at.names == ("muscle.thread_length", "muscle.turns", "thread.modulus")


def test_same_seed_gives_the_same_result(standard_fit):
    again = fit(made(), **QUICK)
    assert {n: e.value for n, e in again.estimates.items()} == {
        n: e.value for n, e in standard_fit.estimates.items()
    }
    assert str(again) == str(standard_fit)


def test_all_starts_agree(standard_fit):
    several = fit(made(), starts=4, fold_count=2, seed=5)
    assert several.agreeing_starts == several.starts == 4
    for name, e in several.estimates.items():
        assert abs(e.value - standard_fit.estimates[name].value) < 1e-3 * e.sd


def closed_form(length, turns, modulus, pressure, at):
    """Return force and diameter with linear threads by the closed form in NumPy."""
    stiffness = modulus * TRUE["muscle.threads"] * TRUE["muscle.thread_area"]
    thread = length / (1 - pressure * at * length / (2 * np.pi * turns**2 * stiffness))
    return (
        pressure * (3 * at**2 - thread**2) / (4 * np.pi * turns**2),
        np.sqrt(thread**2 - at**2) / (np.pi * turns),
    )


def test_fit_agrees_with_lmfit(standard_fit):
    (dataset,) = standard_fit.datasets
    rows = dataset.rows
    trust = np.asarray(dataset.channel_weights)

    def misfit(p):
        force, diameter = closed_form(
            p["length"], p["turns"], p["modulus"], np.asarray(rows.pressure), np.asarray(rows.length)
        )
        by_data = [
            trust[0] * (rows.force - force) * rows.force_weight,
            trust[1] * (rows.diameter - diameter) * rows.diameter_weight,
        ]
        priors = [
            (p[key] - e.prior) / e.prior_sd
            for key, e in zip(("length", "turns", "modulus"), standard_fit.estimates.values(), strict=True)
        ]
        return np.concatenate([*(np.asarray(r) for r in by_data), priors])

    start = lmfit.Parameters()
    for key, e in zip(("length", "turns", "modulus"), standard_fit.estimates.values(), strict=True):
        start.add(key, e.prior)
    oracle = lmfit.minimize(misfit, start, scale_covar=False, xtol=1e-12, ftol=1e-12)
    for mine, theirs in zip(standard_fit.estimates.values(), oracle.params.values(), strict=True):
        assert abs(mine.value - theirs.value) < 1e-4 * mine.sd
        # The reference uses finite differences.
        agree(mine.sd, theirs.stderr, 1e-3)
    agree(standard_fit.correlation[0, 1], oracle.params["length"].correl["turns"], 1e-3)


@pytest.mark.slow
def test_joint_fit_reduces_the_sd_of_the_modulus():
    cases = [made(name=n, seed=k, off=(0.7, -0.6 * k, 1.0)) for k, n in enumerate(("left", "right"))]
    together = fit(cases, None, ["thread.modulus"], **QUICK)
    assert list(together.estimates) == [
        "left/muscle.thread_length",
        "left/muscle.turns",
        "thread.modulus",
        "right/muscle.thread_length",
        "right/muscle.turns",
    ]
    sd = together.estimates["thread.modulus"].sd
    alone = [fit(case, **QUICK).estimates["thread.modulus"].sd for case in cases]
    assert sd < 0.8 * min(alone)
    assert abs(together.estimates["thread.modulus"].value - TRUE["thread.modulus"]) < RECOVERED * sd
    assert together.correlation.shape == (5, 5)


@pytest.mark.parametrize(
    ("cases", "arguments", "text"),
    [
        ([], {}, "a fit needs at least one case; got none."),
        ([made()], {"law": "tow"}, "unknown thread law 'tow'. Did you mean `toe`?"),
        (
            [made()],
            {"share": ["thread.moduls"]},
            "'thread.moduls' is not a free parameter, so it cannot be shared. Did you mean `thread.modulus`?",
        ),
        ([made(), made()], {}, "cases that are fitted together need different names; got 'made' twice."),
        (
            [made(name="a"), made(name="b", off=(0, 0, 0))],
            {"share": ["thread.modulus"]},
            r"a shared parameter \(thread.modulus\) must have one prior; got another value or sd in b/",
        ),
        (
            [made(name="a"), made(name="b", turns=MeasuredValue(1.09))],
            {"share": ["muscle.turns"]},
            r"a shared parameter \(muscle.turns\) must have one prior; got no sd, or no such parameter",
        ),
        (
            [made(baseline="inelastic"), made(name="b")],
            {},
            "share one thread law; got elastic and inelastic in",
        ),
        (
            [made(channels=())],
            {},
            "a fit needs a measured force or diameter; got neither in made/recording.csv.",
        ),
        ([made()], {"starts": 0}, "`starts` must be at least 1; got 0."),
        ([made()], {"fold_count": 1}, "`fold_count` must be at least 2; got 1."),
        ([made()], {"seed": -1}, "`seed` must be at least 0; got -1."),
    ],
)
def test_invalid_fit_is_refused(cases, arguments, text):
    with pytest.raises(BadInput, match=text):
        fit(cases, **arguments)


def test_muscle_without_free_parameters_is_refused():
    known = {name: MeasuredValue(TRUE[f"muscle.{name}"]) for name in ("thread_length", "turns")}
    with pytest.raises(BadInput, match="a fit needs a free parameter; got every value stated without"):
        fit(made(**known), "inelastic")


def with_wrong_forces(case):
    """Return the case with 2 % of its forces doubled."""
    force = case.recording.force.copy()
    wrong = np.random.default_rng(2).choice(case.recording.n, case.recording.n // 50, replace=False)
    force[wrong] *= 2
    return dataclasses.replace(case, recording=dataclasses.replace(case.recording, force=force))


@pytest.mark.slow
def test_soft_loss_is_robust_to_outliers(standard_fit):
    moved = {}
    for loss in ("square", "soft"):
        fitted = fit(with_wrong_forces(made()), loss=loss, **QUICK)
        moved[loss] = max(
            abs(fitted.estimates[n].value - e.value) / e.sd for n, e in standard_fit.estimates.items()
        )
        if loss == "soft":
            assert max(map(abs, sds_off(fitted).values())) < RECOVERED
            # Outliers do not affect its sd either.
            assert all(fitted.estimates[n].sd < 2 * e.sd for n, e in standard_fit.estimates.items())
    assert moved["soft"] < 1.5
    assert moved["square"] > 4


def test_soft_loss_is_quadratic_near_zero_and_linear_far_away():
    r = np.array([-1e3, -1e-3, 0.0, 1e-3, 1e3])
    agree(soften_residual(jnp.asarray(r)) ** 2, 2 * (np.sqrt(1 + r**2) - 1), 1e-9, scale=1e-6)
    assert np.all(np.sign(soften_residual(jnp.asarray(r))) == np.sign(r))


@pytest.mark.slow
def test_ruler_errors_are_estimated_and_parameters_without_sd_are_fixed():
    ruler = dataclasses.replace(SENSORS, length=1e-3, length_per_level=True)
    case = made(plan=RAMPS, bench=ruler, sensors=ruler, seed=4, turns=MeasuredValue(TRUE["muscle.turns"]))
    fitted = fit(case, **QUICK)
    assert [n for n in fitted.estimates if n in TRUE] == ["muscle.thread_length", "thread.modulus"]
    assert fitted.cases[0].numbers["muscle.turns"] == TRUE["muscle.turns"]
    written = np.unique(case.recording.length)
    true = np.sort(TRUE["muscle.rest_length"] * (1 - np.array(RAMPS.contractions)))
    errors = [fitted.estimates[f"length_error.{k + 1}"] for k in range(5)]
    assert max(abs(e.value - x) / e.sd for e, x in zip(errors, true - written, strict=True)) < RECOVERED
    assert max(map(abs, sds_off(fitted).values())) < RECOVERED
    assert "5 length settings have errors of" in str(fitted)


def with_slack(case):
    """Return the case with zero force wherever the model would push."""
    recording = case.recording
    force = np.where(np.isnan(recording.force), 0.5 * np.sin(np.arange(recording.n)), recording.force)
    return dataclasses.replace(case, recording=dataclasses.replace(recording, force=force))


def test_slack_rows_do_not_bias_the_fit():
    # With a long thread, the force is zero above a contraction of a sixth.
    case = with_slack(made(true={"muscle.thread_length": 0.34}, thread_length=MeasuredValue(0.3405, 0.8e-3)))
    at, members = in_space(case)
    (dataset,) = members
    assert dataset.rows.is_slack.sum() > 20
    true = TRUE | {"muscle.thread_length": 0.34}
    fitted = fit(case, **QUICK)
    assert max(map(abs, sds_off(fitted, true).values())) < RECOVERED
    # Negative control: with full weight they would.
    blind = eqx.tree_at(lambda m: m.rows.is_slack, dataset, jnp.zeros_like(dataset.rows.is_slack))
    dragged = at.to_named_values(solve_least_squares((blind,), at, jnp.zeros(at.size)).u)
    assert abs(float(dragged["muscle.turns"]) - 1.09) > 10 * fitted.estimates["muscle.turns"].sd


def test_parameter_at_its_limit_has_no_sd():
    # A bench that records half the diameter: no number of turns within its limits explains it.
    case = made(turns=MeasuredValue(199.0, 500.0), off=(0, 0, 0))
    recording = dataclasses.replace(
        case.recording, diameter=case.recording.diameter / 1e3, force=np.full(case.recording.n, np.nan)
    )
    fitted = fit(dataclasses.replace(case, recording=recording), **QUICK)
    turns = fitted.estimates["muscle.turns"]
    assert turns.at_limit
    assert turns.sd is None
    assert "muscle.turns" in str(fitted)
    assert "AT ITS UPPER LIMIT (0.05 to 200)" in str(fitted)


@pytest.mark.slow
def test_undetermined_parameter_is_reported():
    # Without pressure the threads have no load: their stiffness is not determined.
    case = made(modulus=None, off=(0, 0, 0))
    recording = dataclasses.replace(case.recording, pressure=0.0 * case.recording.pressure)
    fitted = fit(dataclasses.replace(case, recording=recording), "elastic", **QUICK)
    stiffness = fitted.estimates["thread.stiffness"]
    assert stiffness.sd_ratio > 0.5
    assert "not determined by the data (posterior equals prior); uniform prior" in str(fitted)
    assert np.isfinite(fitted.correlation).all()


def test_conflict_with_a_prior_is_reported():
    fitted = fit(made(off=(0, 5.0, 0)), **QUICK)
    assert "shift -5.0 sd, CONTRADICTS ITS PRIOR" in str(fitted)
    (sentence,) = describe_contradicted_values(fitted)
    assert "5.0 sd from the stated value (1.1150 ± 0.0050). Check this value in muscle.toml." in sentence
    assert f"note: {sentence}" in str(fitted)


def test_padding_and_held_out_rows_have_no_effect():
    at, (dataset,) = in_space(made())
    n = made().recording.n
    assert dataset.rows.training_mask.shape == (256,)
    assert float(dataset.rows.training_mask.sum()) == n
    everything = stack_residuals((dataset,), at, jnp.zeros(at.size))
    agree(everything[n:256], 0.0, ROUNDING, scale=1.0)


@pytest.mark.parametrize("loss", ["square", "soft"])
def test_solution_is_linearised_where_the_minimiser_ends(loss):
    """The minimiser's own Jacobian is that of the returned point, not of a later or rejected step."""
    space, datasets = in_space(made(seed=3))
    solution = solve_least_squares(datasets, space, jnp.zeros(space.size), loss)
    expected = linearise_problem(datasets, space, solution.u, loss)
    for name in ("cost", "information", "prior_information", "slope"):
        value = np.asarray(getattr(expected, name))
        agree(getattr(solution, name), value, 1e-9, scale=float(np.abs(value).max()))
    # Negative control: at another point all but the priors differ.
    elsewhere = linearise_problem(datasets, space, solution.u + 0.1, loss)
    assert (
        np.abs(elsewhere.information - solution.information).max() > 1e-6 * np.abs(expected.information).max()
    )


def test_information_of_each_dataset_is_divided_by_its_inflation():
    space, (dataset,) = in_space(made(seed=3))
    filtered = add_whitening(made(seed=3), dataset)
    assert filtered.whitening is not None
    inflated = eqx.tree_at(lambda d: d.whitening.variance_inflation, filtered, jnp.asarray(4.0))
    datasets = (dataset, filtered)
    solution = linearise_problem(datasets, space, jnp.zeros(space.size))
    expected = solution.dataset_information[0] + solution.dataset_information[1] / 4
    changed = inflate_information(solution, (dataset, inflated))
    scale = float(np.abs(expected).max())
    agree(changed.information, expected, ROUNDING, scale=scale)
    agree(solution.information, solution.dataset_information.sum(axis=0), ROUNDING, scale=scale)


def test_sd_agrees_with_the_curvature_of_the_misfit(standard_fit):
    # Half the sum of squares increases by 1/2 at one sd, with the other parameters refitted.
    k = list(SD).index("thread.modulus")
    e = standard_fit.estimates["thread.modulus"]

    def cost(modulus):
        space = standard_fit.space
        limits = space.mean.at[k].set(modulus), space.sd.at[k].set(1e-6 * e.sd)
        fixed = eqx.tree_at(lambda s: (s.mean, s.sd), space, limits)
        ended = solve_least_squares(standard_fit.datasets, fixed, standard_fit.solution.u)
        own = 0.5 * float(space.compute_prior_residual(ended.u)[k]) ** 2
        tie = 0.5 * float(fixed.compute_prior_residual(ended.u)[k]) ** 2
        return float(ended.cost) - tie + own

    rise = 0.5 * (cost(e.value + e.sd) + cost(e.value - e.sd)) - float(standard_fit.solution.cost)
    assert rise == pytest.approx(0.5, rel=0.02)

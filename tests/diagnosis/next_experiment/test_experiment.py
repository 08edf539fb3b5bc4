"""The predicted power of a protocol agrees with simulated experiments, and ties get the right protocol."""

import numpy as np
import pytest

from pamjax.benchmark.inject_effect import inject_effects
from pamjax.diagnosis.detect.score_test import compute_score_directions
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.next_experiment.experiment import (
    Experiment,
    choose_experiment,
    evaluate_protocols,
    fit_best_rival,
    fit_rival,
)
from pamjax.diagnosis.next_experiment.power import LinearisedModel, compute_power_and_limit
from pamjax.diagnosis.next_experiment.testbed import SimulatedTestbed
from pamjax.diagnosis.refit.model_fit import fit_model, switch_on_candidate
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.planning.compare_pair import fit_baseline
from tests.agreement import SOLVED, agree
from tests.diagnosis.bank import build_setup


def linear(rng, rows=60):
    """Return two models that fit a recording of a line equally well, and a protocol that separates them."""
    make = lambda n, k: rng.standard_normal((n, k))  # noqa: E731
    first = 0.1 * make(40, 3), 0.1 * make(40, 2)
    # The first recording and priors with sd 2 determine the parameters of B.
    new = 0.15 * make(rows, 3), 0.15 * make(rows, 2)
    return first, new, np.full(3, 2.0), np.full(2, 2.0)


def least(delta, new, known):
    """Return the χ² of δ after a refit of the parameters with their priors, by stacked least squares."""
    root = np.linalg.cholesky(known).T
    stacked, wanted = np.concatenate([new, root]), np.concatenate([delta, np.zeros(len(root))])
    move = np.linalg.lstsq(stacked, wanted, rcond=None)[0]
    return float(np.sum((wanted - stacked @ move) ** 2))


def side(first, new, prior):
    return LinearisedModel(new.T, first.T @ first + np.diag(1 / prior**2))


def test_refit_agrees_with_least_squares():
    rng = np.random.default_rng(2)
    (first, _), (new, _), prior, _ = linear(rng)
    delta = rng.standard_normal(len(new)) + new @ np.array([3.0, -2.0, 2.0])
    model = side(first, new, prior)
    agree(model.compute_refit_chi2(delta), least(delta, new, model.information), SOLVED)
    assert model.compute_refit_chi2(delta) < 0.99 * delta @ delta


def test_parameters_are_drawn_from_their_posterior():
    rng = np.random.default_rng(4)
    (first, _), (new, _), prior, _ = linear(rng)
    model = side(first, new, prior)
    shown = np.cov(model.sample_predictions(rng, 200_000).T)
    want = new @ np.linalg.inv(model.information) @ new.T
    agree(shown, want, 0.03, scale=np.abs(want).max())


def simulated(a_by, b_by, delta, known_a, known_b, rng, draws=4000):
    """Return the rate at which a true A is chosen, with the limit from a true B; both models are refitted."""
    gains = []
    for truth, by, known in ((delta, a_by, known_a), (0 * delta, b_by, known_b)):
        gain = []
        for _ in range(draws):
            # The first recording determines the true parameters with this uncertainty.
            off = np.linalg.solve(np.linalg.cholesky(known).T, rng.standard_normal(len(known)))
            seen = truth + by @ off + rng.standard_normal(delta.size)
            # Predictions: A gives δ + its changes, B gives 0 + its changes.
            gain.append(least(seen, b_by, known_b) - least(seen - delta, a_by, known_a))
        gains.append(np.array(gain))
    return float(np.mean(gains[0] > np.quantile(gains[1], 0.95)))


@pytest.mark.parametrize("size", [0.05, 0.15, 0.3])
def test_predicted_power_agrees_with_simulated_experiments(size):
    rng = np.random.default_rng(5)
    (first_a, first_b), (new_a, new_b), prior_a, prior_b = linear(rng)
    delta = size * rng.standard_normal(60) + 0.7 * (new_b.sum(axis=1) - new_a.sum(axis=1))
    a, b = side(first_a, new_a, prior_a), side(first_b, new_b, prior_b)
    shown = simulated(new_a, new_b, delta, a.information, b.information, rng, draws=1500)
    assert abs(compute_power_and_limit(delta, a, b)[0] - shown) < 0.05
    # Negative control: with fixed parameters the predicted power is different.
    sure = LinearisedModel(a.jacobian, 1e9 * a.information), LinearisedModel(b.jacobian, 1e9 * b.information)
    assert size > 0.1 or abs(compute_power_and_limit(delta, *sure)[0] - shown) > 0.05


def test_power_has_its_limits():
    rng = np.random.default_rng(6)
    (first_a, first_b), (new_a, new_b), prior_a, prior_b = linear(rng)
    a, b = side(first_a, new_a, prior_a), side(first_b, new_b, prior_b)
    assert compute_power_and_limit(np.zeros(60), a, b)[0] == 0.05
    assert compute_power_and_limit(np.full(60, 30.0), a, b)[0] == 1.0


def test_cheapest_sufficient_protocol_is_chosen_else_the_most_powerful():
    offer = [Experiment(n, ("a", "b"), p, m) for n, p, m in (("x", 0.95, 9), ("y", 0.99, 20), ("z", 0.5, 1))]
    assert choose_experiment(offer, DEFAULT_SETTINGS).protocol == "x"
    assert (
        choose_experiment([*offer[2:], Experiment("w", ("a", "b"), 0.6, 90)], DEFAULT_SETTINGS).protocol
        == "w"
    )


def tied(name, rival):
    """Return a recording with a concealed effect, refitted with its mechanism and with a rival."""
    rng, setup = np.random.default_rng(3), build_setup()
    envelope = inject_effects(1, rng, setup=setup, only=name, smallest=3.0, largest=4.0)
    problem = build_library_problem(envelope.case)
    used = np.ones(problem.n, bool)
    bare = fit_model(problem, used, (), problem.neutral)
    shown = compute_score_directions(
        problem, bare.noise, bare.estimate, [f for f in build_candidates(problem) if f.id == name]
    )
    best = max(shown, key=lambda s: s.chi2_reduction)
    start = switch_on_candidate(problem, bare.estimate.values, best.candidate, best.amplitudes)
    model = fit_model(problem, used, (best.candidate,), start)
    other = fit_rival(problem, model, name, rival)
    assert other is not None
    return evaluate_protocols(SimulatedTestbed.from_fit(problem, model), model, other, (name, rival))


@pytest.mark.slow
def test_form_at_its_limit_does_not_represent_its_mechanism():
    envelope = inject_effects(1, np.random.default_rng(2), only="braid_locking", smallest=0.5, largest=2.0)
    problem = build_library_problem(envelope.case)
    baseline, offered = (
        fit_baseline(problem),
        [form for form in build_candidates(problem) if form.id == "braid_locking"],
    )
    true = np.array([envelope.true_values[name] for name in problem.names])
    best = float(np.sum(baseline.noise.whiten(problem.measured - problem.predict(true)) ** 2))
    # As good as the true model, up to the χ² of its few fitted parameters.
    assert fit_best_rival(problem, baseline, offered).estimate.chi2_with_priors < best + 10
    # Negative control: there is an effect to detect.
    assert baseline.estimate.chi2_with_priors > best + 100


@pytest.mark.slow
def test_protocol_that_alone_separates_a_tie_is_recommended():
    gains = {e.id: e.power for e in tied("force_gain", "pressure_gain")}
    assert gains.pop("X10") > 0.99
    assert max(gains.values()) < 0.15
    # In the same program: an offset and a dead band, which a vented muscle separates immediately.
    best = choose_experiment(tied("pressure_offset", "contact_pressure"), DEFAULT_SETTINGS)
    assert (best.id, best.power) == ("X1", pytest.approx(1.0, abs=0.01))
    # Reports write it within a sentence.
    assert best.protocol.endswith("min)")
    assert best.minutes < 5

"""Promised power is what simulated experiments show, and what only one protocol tells apart is sent there."""

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
    fit_best_candidate,
    fit_rival,
)
from pamjax.diagnosis.next_experiment.power import LinearisedModel, compute_power
from pamjax.diagnosis.next_experiment.testbed import SimulatedTestbed
from pamjax.diagnosis.refit.candidate_fit import fit_candidate, switch_on_candidate
from pamjax.planning.discriminate import fit_baseline
from tests.agreement import SOLVED, agree


def linear(rng, rows=60):
    """Two models of a line recording that fit it alike, and a new protocol on which they differ."""
    make = lambda n, k: rng.standard_normal((n, k))  # noqa: E731
    first = 0.1 * make(40, 3), 0.1 * make(40, 2)
    # B's numbers are known so far from the first recording and from priors of width 2.
    new = 0.15 * make(rows, 3), 0.15 * make(rows, 2)
    return first, new, np.full(3, 2.0), np.full(2, 2.0)


def least(delta, new, known):
    """χ² left of δ after numbers moved freely against what is known of them, by stacked least squares."""
    root = np.linalg.cholesky(known).T
    stacked, wanted = np.concatenate([new, root]), np.concatenate([delta, np.zeros(len(root))])
    move = np.linalg.lstsq(stacked, wanted, rcond=None)[0]
    return float(np.sum((wanted - stacked @ move) ** 2))


def side(first, new, prior):
    return LinearisedModel(new.T, first.T @ first + np.diag(1 / prior**2))


def test_what_a_refit_takes_up_is_least_squares():
    rng = np.random.default_rng(2)
    (first, _), (new, _), prior, _ = linear(rng)
    delta = rng.standard_normal(len(new)) + new @ np.array([3.0, -2.0, 2.0])
    one = side(first, new, prior)
    agree(one.compute_refit_chi2(delta), least(delta, new, one.information), SOLVED)
    assert one.compute_refit_chi2(delta) < 0.99 * delta @ delta


def test_numbers_are_drawn_as_uncertain_as_they_are():
    rng = np.random.default_rng(4)
    (first, _), (new, _), prior, _ = linear(rng)
    one = side(first, new, prior)
    shown = np.cov(one.sample_predictions(rng, 200_000).T)
    want = new @ np.linalg.inv(one.information) @ new.T
    agree(shown, want, 0.03, scale=np.abs(want).max())


def simulated(a_by, b_by, delta, known_a, known_b, rng, draws=4000):
    """Chance that A is chosen where it is true, with the limit set where B is; both refitted each time."""
    gains = []
    for truth, by, known in ((delta, a_by, known_a), (0 * delta, b_by, known_b)):
        gain = []
        for _ in range(draws):
            # The first recording knows the true numbers only so far.
            off = np.linalg.solve(np.linalg.cholesky(known).T, rng.standard_normal(len(known)))
            seen = truth + by @ off + rng.standard_normal(delta.size)
            # Predictions: A's is δ + its moves, B's is 0 + its moves.
            gain.append(least(seen, b_by, known_b) - least(seen - delta, a_by, known_a))
        gains.append(np.array(gain))
    return float(np.mean(gains[0] > np.quantile(gains[1], 0.95)))


@pytest.mark.parametrize("size", [0.05, 0.15, 0.3])
def test_promised_power_is_what_simulated_experiments_show(size):
    rng = np.random.default_rng(5)
    (first_a, first_b), (new_a, new_b), prior_a, prior_b = linear(rng)
    delta = size * rng.standard_normal(60) + 0.7 * (new_b.sum(axis=1) - new_a.sum(axis=1))
    a, b = side(first_a, new_a, prior_a), side(first_b, new_b, prior_b)
    shown = simulated(new_a, new_b, delta, a.information, b.information, rng, draws=1500)
    assert abs(compute_power(delta, a, b) - shown) < 0.05
    # What a refit takes up matters: numbers that cannot move promise something else.
    sure = LinearisedModel(a.jacobian, 1e9 * a.information), LinearisedModel(b.jacobian, 1e9 * b.information)
    assert size > 0.1 or abs(compute_power(delta, *sure) - shown) > 0.05


def test_power_has_its_ends():
    rng = np.random.default_rng(6)
    (first_a, first_b), (new_a, new_b), prior_a, prior_b = linear(rng)
    a, b = side(first_a, new_a, prior_a), side(first_b, new_b, prior_b)
    assert compute_power(np.zeros(60), a, b) == 0.05
    assert compute_power(np.full(60, 30.0), a, b) == 1.0


def test_the_cheapest_that_is_enough_is_chosen_and_else_the_most_powerful():
    offer = [Experiment(n, ("a", "b"), p, m) for n, p, m in (("x", 0.95, 9), ("y", 0.99, 20), ("z", 0.5, 1))]
    assert choose_experiment(offer).protocol == "x"
    assert choose_experiment([*offer[2:], Experiment("w", ("a", "b"), 0.6, 90)]).protocol == "w"


def tied(name, rival):
    """A recording with concealed physics, refitted with its name and with a rival in its place."""
    envelope = inject_effects(1, np.random.default_rng(3), only=name, smallest=3.0, largest=4.0)
    found = build_library_problem(envelope.case)
    used = np.ones(found.n, bool)
    bare = fit_candidate(found, used, (), found.neutral)
    shown = compute_score_directions(
        found, bare.noise, bare.estimate, [f for f in build_candidates(found) if f.id == name]
    )
    best = max(shown, key=lambda s: s.chi2_reduction)
    start = switch_on_candidate(found, bare.estimate.values, best.candidate, best.amplitudes)
    model = fit_candidate(found, used, (best.candidate,), start)
    other = fit_rival(found, model, name, rival)
    assert other is not None
    return evaluate_protocols(SimulatedTestbed.from_fit(found, model), model, other, (name, rival))


@pytest.mark.slow
def test_a_form_that_sticks_at_its_limit_does_not_stand_for_its_mechanism():
    envelope = inject_effects(1, np.random.default_rng(2), only="braid_locking", smallest=0.5, largest=2.0)
    found = build_library_problem(envelope.case)
    baseline, offered = (
        fit_baseline(found),
        [form for form in build_candidates(found) if form.id == "braid_locking"],
    )
    true = np.array([envelope.true_values[name] for name in found.names])
    best = float(np.sum(baseline.noise.whiten(found.measured - found.predict(true)) ** 2))
    # As good as the truth, by the χ² of a few numbers that the truth has not fitted.
    assert fit_best_candidate(found, baseline, offered).estimate.cost < best + 10
    # Able to fail: there is something to be found.
    assert baseline.estimate.cost > best + 100


@pytest.mark.slow
def test_what_only_one_protocol_tells_apart_is_sent_there():
    gains = {e.id: e.power for e in tied("force_gain", "pressure_gain")}
    assert gains.pop("X10") > 0.99
    assert max(gains.values()) < 0.15
    # In the same compiled program: a zero and a dead band, which venting tells apart at once.
    best = choose_experiment(tied("pressure_offset", "contact_pressure"))
    assert (best.id, best.power) == ("X1", pytest.approx(1.0, abs=0.01))
    assert best.minutes < 5

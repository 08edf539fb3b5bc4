"""Choice between the forms of a mechanism, on simulated drifts of the load cell and on friction."""

import numpy as np
import pytest

from pamjax.benchmark.inject_effect import inject_effects
from pamjax.benchmark.setups import build_reference_setup
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.diagnosis.select.mechanism_forms import choose_forms
from pamjax.diagnosis.select.mechanism_refits import fit_with_candidate, refit_fully
from tests.diagnosis.bank import BankRecording, replace_recording, simulate_bank
from tests.diagnosis.searches import build_search

pytestmark = pytest.mark.slow

STRAIGHT = {"force_drift.rate"}

#: Parameters of friction that are not in its textbook form.
MOVES = {"braid_friction.stretch", "braid_friction.asymmetry"}


def fit_drift(drift):
    """Return a search in a recording with a drift (N) over relative time, and the fit of a straight drift."""
    case = simulate_bank(BankRecording(1, only="force_offset", smallest=0.01, largest=0.01)).case
    time = case.recording.time
    relative_time = (time - time[0]) / np.ptp(time)
    case = replace_recording(case, force=case.recording.force + drift(relative_time))
    search = build_search(build_library_problem(case))
    (direction,) = (
        d for d in search.score_candidates(search.baseline) if set(d.candidate.free_parameters) == STRAIGHT
    )
    rough_fit = fit_with_candidate(search.problem, search.baseline, direction)
    return search, refit_fully(search.problem, [rough_fit])[0]


def fit_friction(**form):
    """Return a search in strokes with friction of a given form, and the fit of the textbook form."""
    case = inject_effects(
        1, np.random.default_rng(0), setup=build_reference_setup(), only="force_offset",
        smallest=0.01, largest=0.01,
    ).case  # fmt: skip
    problem = build_library_problem(case)
    start = build_search(problem).baseline.estimate.values
    values = start.copy()
    for name, value in ({"coefficient": 3.0, "presliding": 5e-4} | form).items():
        values[problem.index(f"braid_friction.{name}")] = value
    force, diameter = problem.predict(values) - problem.predict(start)
    with_friction = replace_recording(
        case, force=case.recording.force + force, diameter=case.recording.diameter + diameter
    )
    search = build_search(build_library_problem(with_friction))
    textbook = [
        d
        for d in search.score_candidates(search.baseline)
        if d.candidate.id == "braid_friction" and not MOVES & set(d.candidate.shape)
    ]
    trials = [fit_with_candidate(search.problem, search.baseline, d) for d in textbook]
    return search, refit_fully(search.problem, trials)[0]


def get_form(fit: ModelFit) -> set[str]:
    return set(fit.mechanisms[-1].free_parameters)


def test_another_form_of_the_same_mechanism_replaces_a_worse_one():
    search, straight = fit_drift(lambda t: 60 * (1 - np.exp(-t / 0.1)))
    chosen = choose_forms(search.problem, straight, search.candidates)
    assert chosen.ids == ("force_drift",)
    assert "force_drift.warmup" in get_form(chosen)
    assert chosen.bic < straight.bic - 1000


@pytest.mark.parametrize("stretch", [0.0, 1.0])
def test_share_of_the_stretch_that_causes_sliding_is_found(stretch):
    """Friction on the bladder follows the length alone, that of turning crossings the stretch too."""
    search, textbook = fit_friction(stretch=stretch)
    chosen = choose_forms(search.problem, textbook, search.candidates)
    is_textbook = not MOVES & get_form(chosen)
    assert chosen.estimate.values[search.problem.index("braid_friction.stretch")] == pytest.approx(
        stretch, abs=0.2
    )
    assert is_textbook or chosen.bic < textbook.bic - (100 if stretch == 0.0 else 0)


@pytest.mark.parametrize("asymmetry", [0.8, -0.8])
def test_friction_in_one_direction_is_found(asymmetry):
    search, textbook = fit_friction(asymmetry=asymmetry)
    chosen = choose_forms(search.problem, textbook, search.candidates)
    assert chosen.estimate.values[search.problem.index("braid_friction.asymmetry")] == pytest.approx(
        asymmetry, abs=0.15
    )
    assert chosen.bic < textbook.bic - 100


def test_the_form_with_fewer_parameters_stays_if_it_fits_as_well():
    search, straight = fit_drift(lambda t: 60 * t)
    assert get_form(choose_forms(search.problem, straight, search.candidates)) == STRAIGHT

"""Tests at the end of a search: which mechanisms stay."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax import diagnose
from pamjax.diagnosis.form_errors.columns import compute_effect
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.select.mechanism_refits import fit_without_mechanism
from pamjax.diagnosis.select.search import prune_mechanisms, swap_mechanisms
from tests.diagnosis.bank import BankRecording, diagnose_bank, replace_recording, simulate_bank
from tests.diagnosis.searches import build_search, fit_ids

pytestmark = pytest.mark.slow

#: Largest difference of the rubber's force from its equation, as a share of its effect.
SHARE = 0.3

#: Friction, N: its rms is below the standard deviation of the force noise.
FRICTION = 1.5


def search_changed_rubber(friction):
    """Return a search in a recording with rubber of another form, and a small friction of the braid."""
    definition = BankRecording(1, seed=5, only="bladder_elasticity", smallest=25.0, largest=25.0)
    diagnosis, recording = diagnose_bank(definition), simulate_bank(definition).case.recording
    rubber = compute_effect(
        diagnosis.problem, diagnosis.model.estimate.values, diagnosis.model.mechanisms[0]
    )[0]
    x = 2 * (recording.length - recording.length.min()) / np.ptp(recording.length) - 1
    direction = np.sign(np.gradient(recording.length))
    force = recording.force + SHARE * (1.5 * x**2 - 0.5) * rubber + friction * direction
    case = replace_recording(simulate_bank(definition).case, force=force)
    search = build_search(build_library_problem(case))
    # The friction is even. Friction in one direction would fit a part of the other form of the rubber.
    even = [c for c in search.candidates if "braid_friction.asymmetry" not in c.shape]
    return replace(search, candidates=even)


def test_a_small_mechanism_stays_beside_a_large_one_of_another_form():
    search = search_changed_rubber(FRICTION)
    fit = fit_ids(search, ["bladder_elasticity", "braid_friction"])
    # Without form errors, friction explains too little of what rubber leaves.
    reduced_fit = fit_without_mechanism(search.problem, fit, 1)
    assert not search.is_worthwhile(reduced_fit, fit, may_be_small=True)
    assert set(prune_mechanisms(search, fit, may_be_small=True).ids) == {
        "bladder_elasticity",
        "braid_friction",
    }


def test_a_mechanism_without_an_effect_is_removed():
    search = search_changed_rubber(0.0)
    fit = fit_ids(search, ["bladder_elasticity", "braid_friction"])
    assert prune_mechanisms(search, fit, may_be_small=True).ids == ("bladder_elasticity",)
    # A diagnosis has friction in all forms, and does not name it either.
    (mechanism,) = diagnose(search.problem.case).named_mechanisms
    assert mechanism.id == "bladder_elasticity"


@pytest.mark.parametrize("others", [[], ["force_offset"]])
def test_a_mechanism_is_replaced_when_the_noise_is_known(others):
    # The noise at the baseline, with all of the misfit, can prefer relaxation.
    definition = BankRecording(1, only="braid_friction", smallest=8.0, largest=8.0)
    search = build_search(build_library_problem(simulate_bank(definition).case))
    fit = fit_ids(search, ["viscoelastic_creep", *others])
    assert set(swap_mechanisms(search, fit).ids) >= {"braid_friction"}

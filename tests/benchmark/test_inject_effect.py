"""What is concealed is in the recording, in the form that was asked for."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.benchmark.inject_effect import inject_effects, remove_amplitudes
from pamjax.benchmark.setups import build_reference_setup
from pamjax.diagnosis.library.library_problem import build_library_problem


def departure(only: str, share: float) -> float:
    """By how much of its effect a concealed mechanism departs from its equation, rms."""
    made = [
        inject_effects(1, np.random.default_rng(5), only=only, smallest=8.0, largest=8.0, form_error=one)
        for one in (0.0, share)
    ]
    found = build_library_problem(made[0].case)
    values = np.array([made[0].true_values[name] for name in found.names])
    effect = found.predict(values) - found.predict(remove_amplitudes(found, values, made[0].candidates[0]))
    off = made[1].noise_free - made[0].noise_free
    return float(np.sqrt(np.nanmean(off[0] ** 2) / np.nanmean(effect[0] ** 2)))


@pytest.mark.slow
def test_an_effect_departs_from_its_equation_by_the_share_that_was_asked_for():
    assert 0.15 < departure("bladder_elasticity", 0.3) < 0.6


@pytest.mark.slow
def test_a_wrong_zero_stays_a_zero():
    assert departure("force_offset", 0.3) == 0.0


@pytest.mark.slow
def test_no_muscle_pushes():
    """Rubber in the wall wins over little pressure: what is concealed is then a slack muscle."""
    setup = build_reference_setup()
    soft = replace(setup, plan=replace(setup.plan, pressure=0.3 * setup.plan.pressure))
    rng = np.random.default_rng(2)
    made = inject_effects(1, rng, setup=soft, only="bladder_elasticity", smallest=40.0, largest=40.0)
    assert np.nanmin(made.noise_free[0]) == 0.0
    pushed = build_library_problem(replace(made.case, recording=soft.plan))
    values = np.array([made.true_values[name] for name in pushed.names])
    assert np.nanmin(pushed.predict(values)[0]) < -5.0


@pytest.mark.slow
def test_what_the_lab_states_is_concealed_as_the_lab_states_it():
    """The threads' stretch is stated: it is as large as that, or not concealed at all."""
    setup = build_reference_setup()
    rigid = replace(setup, entry=replace(setup.entry, baseline="inelastic"))

    def made(wanted):
        rng = np.random.default_rng(2)
        return inject_effects(1, rng, setup=rigid, only="braid_elasticity", smallest=wanted, largest=wanted)

    small, too_large = made(3.0), made(25.0)
    found = build_library_problem(small.case)
    k = found.index("braid_elasticity.compliance")
    assert small.effect_ids == ("braid_elasticity",)
    assert abs(small.true_values["braid_elasticity.compliance"] - found.start[k]) <= 2 * found.prior_sd[k]
    assert too_large.effect_ids == ()

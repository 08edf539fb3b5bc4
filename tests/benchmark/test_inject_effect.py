"""What is concealed is in the recording, in the form that was asked for."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.benchmark.inject_effect import absent, conceal
from pamjax.benchmark.setups import known
from pamjax.diagnosis.library.library_problem import problem


def departure(only: str, share: float) -> float:
    """By how much of its effect a concealed mechanism departs from its equation, rms."""
    made = [
        conceal(1, np.random.default_rng(5), only=only, smallest=8.0, largest=8.0, form_error=one)
        for one in (0.0, share)
    ]
    found = problem(made[0].case)
    values = np.array([made[0].true[name] for name in found.names])
    effect = found.shows(values) - found.shows(absent(found, values, made[0].forms[0]))
    off = made[1].clean - made[0].clean
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
    setup = known()
    soft = replace(setup, plan=replace(setup.plan, pressure=0.3 * setup.plan.pressure))
    rng = np.random.default_rng(2)
    made = conceal(1, rng, setup=soft, only="bladder_elasticity", smallest=40.0, largest=40.0)
    assert np.nanmin(made.clean[0]) == 0.0
    pushed = problem(replace(made.case, recording=soft.plan))
    values = np.array([made.true[name] for name in pushed.names])
    assert np.nanmin(pushed.shows(values)[0]) < -5.0


@pytest.mark.slow
def test_what_the_lab_states_is_concealed_as_the_lab_states_it():
    """The threads' stretch is stated: it is as large as that, or not concealed at all."""
    setup = known()
    rigid = replace(setup, entry=replace(setup.entry, baseline="inelastic"))

    def made(wanted):
        rng = np.random.default_rng(2)
        return conceal(1, rng, setup=rigid, only="braid_elasticity", smallest=wanted, largest=wanted)

    small, too_large = made(3.0), made(25.0)
    found = problem(small.case)
    k = found.place("braid_elasticity.compliance")
    assert small.concealed == ("braid_elasticity",)
    assert abs(small.true["braid_elasticity.compliance"] - found.start[k]) <= 2 * found.sd[k]
    assert too_large.concealed == ()

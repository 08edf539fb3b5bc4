"""Concealed effects of simulated recordings have the requested form and size."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.benchmark import inject_effect
from pamjax.benchmark.inject_effect import inject_effects, remove_amplitudes
from pamjax.benchmark.setups import build_reference_setup
from pamjax.diagnosis.library.library_problem import build_library_problem


def departure(only: str, share: float) -> float:
    """Return the rms difference between a concealed effect and its equation, relative to the effect."""
    made = [
        inject_effects(
            1, np.random.default_rng(5), only=only, smallest=8.0, largest=8.0, form_error=form_share
        )
        for form_share in (0.0, share)
    ]
    problem = build_library_problem(made[0].case)
    values = np.array([made[0].true_values[name] for name in problem.names])
    effect = problem.predict(values) - problem.predict(
        remove_amplitudes(problem, values, made[0].candidates[0])
    )
    off = made[1].noise_free - made[0].noise_free
    return float(np.sqrt(np.nanmean(off[0] ** 2) / np.nanmean(effect[0] ** 2)))


@pytest.mark.slow
def test_form_error_has_the_requested_size():
    assert 0.15 < departure("bladder_elasticity", 0.3) < 0.6


@pytest.mark.slow
def test_offset_has_no_form_error():
    assert departure("force_offset", 0.3) == 0.0


@pytest.mark.slow
def test_simulated_force_is_never_negative():
    """At low pressure the rubber exceeds the pull of pressure; the muscle is then slack."""
    setup = build_reference_setup()
    soft = replace(setup, plan=replace(setup.plan, pressure=0.3 * setup.plan.pressure))
    rng = np.random.default_rng(2)
    made = inject_effects(1, rng, setup=soft, only="bladder_elasticity", smallest=40.0, largest=40.0)
    assert np.nanmin(made.noise_free[0]) == 0.0
    pushed = build_library_problem(replace(made.case, recording=soft.plan))
    values = np.array([made.true_values[name] for name in pushed.names])
    assert np.nanmin(pushed.predict(values)[0]) < -5.0


@pytest.mark.slow
def test_concealed_thread_stretch_agrees_with_muscle_toml():
    """The stretch of the threads is stated: the concealed one has this size, or it is absent."""
    setup = build_reference_setup()
    rigid = replace(setup, muscle_toml=replace(setup.muscle_toml, baseline="inelastic"))

    def made(wanted):
        rng = np.random.default_rng(2)
        return inject_effects(1, rng, setup=rigid, only="braid_elasticity", smallest=wanted, largest=wanted)

    small, too_large = made(3.0), made(25.0)
    problem = build_library_problem(small.case)
    k = problem.index("braid_elasticity.compliance")
    assert small.effect_ids == ("braid_elasticity",)
    assert abs(small.true_values["braid_elasticity.compliance"] - problem.start[k]) <= 2 * problem.prior_sd[k]
    assert too_large.effect_ids == ()


@pytest.mark.slow
@pytest.mark.parametrize("injected", ["braid_friction", None])
def test_further_forms_of_a_mechanism_change_no_draw_of_others(injected, monkeypatch):
    def simulate():
        drawn = inject_effects(1, np.random.default_rng(8), only=injected)
        return drawn.effect_ids, drawn.case.recording.force

    ids, force = simulate()
    plain_candidates = inject_effect.build_candidates

    def build_with_copies(problem):
        candidates = plain_candidates(problem)
        return candidates + 5 * [c for c in candidates if c.id not in ids]

    monkeypatch.setattr(inject_effect, "build_candidates", build_with_copies)
    changed_ids, changed_force = simulate()
    assert changed_ids == ids
    assert np.array_equal(changed_force, force)

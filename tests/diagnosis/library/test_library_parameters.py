"""Limits of parameters that follow from the recording."""

import jax.numpy as jnp
import numpy as np

from pamjax.model.mechanisms.mullins_softening import MullinsSoftening
from pamjax.model.state import Cylinder
from pamjax.model.wall import rubber_volume
from tests.agreement import agree
from tests.diagnosis.bank import build_plan_problem


def test_cyclic_softening_uses_at_most_half_of_the_energy_of_a_recording():
    problem = build_plan_problem()
    sizes = [
        jnp.asarray(problem.start[problem.index(f"mullins_softening.{name}")])
        for name in ("inner_diameter", "thickness", "length")
    ]
    rubber = MullinsSoftening(inner_diameter=sizes[0], thickness=sizes[1], length=sizes[2])
    length = jnp.asarray(problem.case.recording.length)
    thread, turns = (jnp.full(length.shape, value) for value in problem.case.muscle_toml.braid)
    energy = np.asarray(rubber.strains(Cylinder()(length, thread, turns), jnp.asarray(0.0)))[0]
    limit = 0.5 * np.abs(np.diff(energy)).sum() / float(rubber_volume(rubber))
    assert 0.1 < limit < 50.0
    agree(problem.high[problem.index("mullins_softening.cyclic_energy")], limit, 1e-3)


def test_a_branch_relaxes_and_threads_slide_within_the_recording():
    """Slower relaxation, and friction that never slides, would be an elastic wall and a spring."""
    problem = build_plan_problem()
    recording = problem.case.recording
    duration = float(np.ptp(recording.time))
    assert 20.0 < duration < 1e4
    agree(problem.high[problem.index("viscoelastic_creep.time_long")], duration, 1e-9)
    agree(problem.high[problem.index("viscoelastic_creep.time_short")], min(60.0, duration), 1e-9)
    give = problem.high[problem.index("braid_friction.give")]
    sliding_range = max(np.ptp(recording.length), give * np.ptp(recording.pressure))
    agree(problem.high[problem.index("braid_friction.presliding")], sliding_range / 4, 1e-9)
    assert np.all(problem.low < problem.high)
    assert np.all((problem.low <= problem.start) & (problem.start <= problem.high))

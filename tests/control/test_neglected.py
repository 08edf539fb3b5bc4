"""Neglected effects of a command have the size that a simulated bench shows."""

import numpy as np
import pytest

from pamjax.control.inverse import Inverse
from pamjax.control.neglected import compute_friction_half_loop, list_neglected
from pamjax.model.bench import Bench, record_bench
from pamjax.model.history import build_time_history
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.mechanisms.braid_friction import BraidFriction
from pamjax.model.mechanisms.contact_pressure import ContactPressure
from pamjax.model.mechanisms.force_offset import ForceOffset
from pamjax.model.mechanisms.pressure_drop import PressureDrop
from pamjax.model.mechanisms.rig_compliance import RigCompliance
from pamjax.model.mechanisms.viscoelastic_creep import ViscoelasticCreep
from pamjax.model.muscle import Muscle
from pamjax.model.thread import LinearThread
from tests.agreement import SOLVED, agree

THREADS = BraidElasticity(4e-6)
FRICTION = BraidFriction(coefficient=0.4, constant=3.0, exponent=0.8, reach=0.7, angle=0.4, give=1e-9)
STATIC = build_time_history(None, np.ones(3, dtype=bool))


def bench(*mechanisms):
    return Bench(0.2512, 1.09, (THREADS, *mechanisms))


# A simulated recording computes friction at the full pressure. The difference is about a thousandth.
@pytest.mark.parametrize(
    ("mechanisms", "tolerance"), [((FRICTION,), SOLVED), ((ContactPressure(4e4), FRICTION), 2e-3)]
)
@pytest.mark.slow
def test_friction_is_half_the_width_of_the_loop(mechanisms, tolerance):
    friction_bench, pressure = bench(*mechanisms), 300e3
    lengthening = np.linspace(0.19, 0.23, 81)
    length = np.concatenate([lengthening, lengthening[-2::-1], lengthening[1:]])
    run = build_time_history(0.1 * np.arange(length.size), np.arange(length.size) == 0)
    force = np.asarray(record_bench(friction_bench, np.full(length.size, pressure), length, run).states.force)
    # The middle of the shortening and of the next lengthening: every element is at its limit.
    half_loop = (force[200] - force[120]) / 2
    assert half_loop > 1.0
    agree(compute_friction_half_loop(friction_bench, pressure, length[120]), half_loop, tolerance)
    with pytest.raises(AssertionError):
        agree(compute_friction_half_loop(friction_bench, 1.01 * pressure, length[120]), half_loop, tolerance)


def test_only_friction_has_a_loop_at_zero_speed():
    assert compute_friction_half_loop(bench(ViscoelasticCreep(3e5)), 300e3, 0.21) == 0.0
    assert compute_friction_half_loop(Muscle(0.2357, 0.2512, 1.09, LinearThread(2.5e5)), 300e3, 0.21) == 0.0


def test_neglected_mechanisms_are_named():
    mechanisms = PressureDrop(1e8), ForceOffset(2.0), RigCompliance(1e-7), ContactPressure(4e4), FRICTION
    assert list_neglected(bench(*mechanisms)) == (
        ("pressure_drop", "braid_friction"),
        ("force_offset", "rig_compliance"),
    )
    assert list_neglected(Muscle(0.2357, 0.2512, 1.09, LinearThread(2.5e5))) == ((), ())


def test_contact_pressure_acts_at_zero_speed():
    pressed, pressure, length = bench(ContactPressure(4e4)), np.array([1e5, 3e5, 5e5]), np.full(3, 0.21)
    force, _ = Inverse(pressed, (5e4, 6e5), (0.19, 0.23)).force(pressure, length)
    agree(force, record_bench(pressed, pressure, length, STATIC).states.force, SOLVED)
    bare, _ = Inverse(bench(), (5e4, 6e5), (0.19, 0.23)).force(pressure, length)
    assert np.all(bare - force > 20.0)

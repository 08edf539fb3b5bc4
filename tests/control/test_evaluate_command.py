"""All numbers of one command: closed forms of the inelastic muscle, and the half loop of friction."""

import math

import numpy as np

from pamjax.control.evaluate_command import evaluate_command
from pamjax.control.inverse import CommandLimit, inverse
from pamjax.control.neglected import compute_friction_half_loop
from pamjax.model.bench import Bench
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.mechanisms.braid_friction import BraidFriction
from pamjax.model.muscle import Muscle
from pamjax.model.thread import Inextensible
from tests.agreement import SOLVED, agree

REST, THREAD, TURNS = 0.2357, 0.2512, 1.09
SCALE = 4 * math.pi * TURNS**2
PRESSURES, LENGTHS = (20e3, 650e3), (0.17, REST)
#: An inelastic muscle: F = P (3 L² − B²) / (4π n²).
PRESSURE, LENGTH = 300e3, 0.2
FORCE = PRESSURE * (3 * LENGTH**2 - THREAD**2) / SCALE


def test_numbers_of_an_inelastic_muscle_are_those_of_gaylord():
    muscle = inverse(Muscle(REST, THREAD, TURNS, Inextensible()), PRESSURES, LENGTHS)
    for by_length, given, value in ((True, LENGTH, PRESSURE), (False, PRESSURE, LENGTH)):
        numbers = evaluate_command(muscle, FORCE, given, by_length)
        assert numbers.command.status[0] == CommandLimit.OK
        agree(numbers.command.value[0], value, SOLVED)
        agree(numbers.reached_force, FORCE, SOLVED)
        agree(numbers.command.stiffness[0], 6 * PRESSURE * LENGTH / SCALE, SOLVED)
        agree(numbers.stiffness_slopes, [6 * LENGTH / SCALE, 6 * PRESSURE / SCALE], SOLVED)
        assert numbers.half_loop == 0
    agree(numbers.command.slope_by_force[0], SCALE / (6 * PRESSURE * LENGTH), SOLVED)


def test_an_impossible_command_has_the_force_of_the_nearest_one():
    muscle = inverse(Muscle(REST, THREAD, TURNS, Inextensible()), PRESSURES, LENGTHS)
    numbers = evaluate_command(muscle, 1e6, LENGTH, True)
    assert numbers.command.status[0] == CommandLimit.TOO_STRONG
    agree(numbers.reached_force, PRESSURES[1] * FORCE / PRESSURE, SOLVED)


def test_half_loop_is_that_of_the_friction():
    friction = BraidFriction(coefficient=0.4, constant=3.0, exponent=0.8, reach=0.7, angle=0.4, give=1e-9)
    bench = Bench(THREAD, TURNS, (BraidElasticity(4e-6), friction))
    numbers = evaluate_command(inverse(bench, PRESSURES, LENGTHS), 400.0, LENGTH, True)
    pressure = numbers.command.value[:1]
    expected = compute_friction_half_loop(bench, pressure, np.array([LENGTH]))
    assert expected[0] > 1
    agree(numbers.half_loop, expected[0], SOLVED)

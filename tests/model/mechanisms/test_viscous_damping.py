"""A damper: force along the motion; effects of its speed, pressure and exponent."""

import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.model.mechanisms.viscous_damping import ViscousDamping
from tests.agreement import SOLVED, agree
from tests.model.mechanisms.triangle import one_run, past

TIME = np.arange(9.0)


def damped(damper, speed, pressure=1e5):
    """Return the stress along the length at a constant speed (m/s): a force, N."""
    length = 0.2 + speed * TIME
    went = past(length, pressure)
    strains = damper.strains(went.state, went.pressure).T
    agree(strains[:, 0], length, SOLVED)
    return damper.stresses(one_run(TIME), jnp.asarray(strains), went)[:, 0]


@pytest.mark.parametrize("speed", [1e-3, -1e-3])
def test_damping_acts_against_the_motion(speed):
    """Section E6: 2 kN s/m gives 2 N more at 1 mm/s during lengthening, and 2 N less during shortening."""
    agree(damped(ViscousDamping(2e3), speed), 2e3 * speed, SOLVED)


def test_positive_pressure_increases_the_coefficient():
    # (c + b P) v = (1000 + 0.02 × 100 000) N s/m × 1 mm/s = 3 N; without pressure 1 N.
    damper = ViscousDamping(1e3, pressed=0.02)
    agree(damped(damper, 1e-3), 3.0, SOLVED)
    agree(damped(damper, 1e-3, pressure=-1e4), 1.0, SOLVED)


@pytest.mark.parametrize(
    ("power", "speed", "force"), [(0.5, 4e-3, 4.0), (2.0, 4e-3, 32.0), (2.0, -4e-3, -32.0)]
)
def test_exponent_changes_the_law_around_one_millimetre_per_second(power, speed, force):
    # c v |v/v1|^(m−1) = 2e3 × 4e-3 × 4^(m−1): 8/2 and 8 × 4 newtons, but for the corner at 0.02 mm/s,
    # where the ratio is (v² + 0.02²) / (1 + 0.02²): a difference of a thousandth at most.
    agree(damped(ViscousDamping(2e3, power=power), speed), force, 1e-3)
    corner = ((16 + 4e-4) / (1 + 4e-4)) ** (0.5 * (power - 1))
    agree(damped(ViscousDamping(2e3, power=power), speed), 2e3 * speed * corner, SOLVED)


@pytest.mark.parametrize("asymmetry", [0.4, -1.0])
def test_asymmetry_increases_damping_in_one_direction(asymmetry):
    # At a constant speed: c (1 + a) v for lengthening, c (1 − a) v for shortening, but for the rounding.
    damper = ViscousDamping(2e3, asymmetry=asymmetry)
    sign = 1e-3 / np.hypot(1e-3, 2e-5)
    for speed in (1e-3, -1e-3):
        agree(damped(damper, speed), 2e3 * speed * (1 + asymmetry * np.sign(speed) * sign), SOLVED, 2.0)


@pytest.mark.parametrize("asymmetry", [-1.0, 0.3, 1.0])
def test_damper_never_supplies_power(asymmetry):
    damper = ViscousDamping(2e3, asymmetry=asymmetry)
    for speed in (-1e-2, -1e-5, 1e-5, 1e-2):
        assert np.all(damped(damper, speed) * speed >= 0)
    # Beyond its limits it would.
    assert np.all(damped(ViscousDamping(2e3, asymmetry=1.5), -1e-2) * -1e-2 < 0)


def test_damping_is_zero_at_rest():
    # Rounded at rest: c v [(v² + s²) / (v1² + s²)]^((m−1)/2) with v = s = 0.02 mm/s, v1 = 1 mm/s, m = 1/2.
    agree(damped(ViscousDamping(2e3, power=0.2), 0.0), 0.0, SOLVED, 1.0)
    slow = 2e3 * 2e-5 * (2 * 4e-10 / (1e-6 + 4e-10)) ** -0.25
    agree(damped(ViscousDamping(2e3, power=0.5), 2e-5), slow, SOLVED)

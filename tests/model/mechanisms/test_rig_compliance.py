"""Compliance of the rig: the muscle is shorter than recorded."""

import math

from pamjax.model.mechanisms.rig_compliance import RigCompliance
from tests.agreement import ROUNDING, agree


def test_rig_displacement_is_proportional_to_force():
    # c F = 2e-7 m/N × 3000 N; a muscle that pushes lengthens the frame.
    agree(RigCompliance(2e-7).deflection(3000.0), 0.6e-3, ROUNDING)
    agree(RigCompliance(2e-7).deflection(-100.0), -0.02e-3, ROUNDING)


def test_seat_closes_under_a_positive_force():
    # s [1 − e^(−F/Fs)] = 3 s / 4 at F = Fs ln 4.
    rig = RigCompliance(0.0, 2e-3, 50.0)
    agree(rig.deflection(50 * math.log(4)), 1.5e-3, ROUNDING)
    agree(rig.deflection(-50.0), 0.0, ROUNDING, 1e-3)
    both = RigCompliance(1e-6, 2e-3, 50.0)
    agree(both.deflection(50 * math.log(2)), 1e-3 + 50e-6 * math.log(2), ROUNDING)

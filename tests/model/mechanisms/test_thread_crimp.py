"""Crimp: a strain that saturates with load."""

import math

from pamjax.model.mechanisms.thread_crimp import ThreadCrimp
from tests.agreement import ROUNDING, agree


def test_loaded_threads_are_longer_by_the_straightened_crimp():
    # c [1 − e^(−T/Tc)] = c (1 − 1/4) at T = Tc ln 4, and c (1 − 1/2) at T = Tc ln 2.
    crimp = ThreadCrimp(4e-3, 500.0)
    agree(crimp.strain(500 * math.log(4)), 3e-3, ROUNDING)
    agree(crimp.strain(500 * math.log(2)), 2e-3, ROUNDING)
    agree(ThreadCrimp(4e-3, 1000.0).strain(1000 * math.log(2)), 2e-3, ROUNDING)

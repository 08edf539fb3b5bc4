"""Linear threads: strain is compliance times load."""

from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from tests.agreement import ROUNDING, agree, printed


def test_loaded_threads_are_longer_by_compliance_times_load():
    # ε = C T = 3e-6 /N × 2000 N.
    agree(BraidElasticity(3e-6).strain(2000.0), 6e-3, ROUNDING)


def test_stretch_of_the_kevlar_muscle():
    """Section 7.3: 144 threads of 80 GPa and 0.0858 mm² at 38.2 N each stretch by 1.40 mm of 251.206 mm."""
    threads = BraidElasticity(1 / (144 * 80e9 * 0.0858e-6))
    printed(251.206 * float(threads.strain(144 * 38.2)), "1.40")

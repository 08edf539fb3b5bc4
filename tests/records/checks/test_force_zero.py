"""A load cell with a wrong zero is reported if the muscle is slack in some rows."""

from pathlib import Path

import numpy as np
import pytest

from pamjax.records.case import build_case
from tests.records.conftest import MUSCLE, THREAD, TURNS


def read(zero, vented=0.0, noise=0.5, threshold=60e3):
    """Return the warnings about the zero of a muscle that is slack below a pressure, at two lengths."""
    random, rows = np.random.default_rng(3), []
    for cycle, length in enumerate((0.2, 0.18, 0.17), 1):
        for pressure in np.r_[np.linspace(vented, 3e5, 60), np.linspace(3e5, vented, 60)]:
            area = (3 * length**2 - THREAD**2) / (4 * np.pi * TURNS**2)
            force = area * max(pressure - threshold * (length < 0.2), 0.0) + zero + noise * random.normal()
            rows.append(f"{pressure / 1e3:.3f},{1e3 * length:.1f},{force:.3f},{cycle}")
    text = "time [s],pressure [kPa],length [mm],force [N],cycle\n" + "".join(
        f"{0.5 * k:.1f},{row}\n" for k, row in enumerate(rows)
    )
    toml = MUSCLE + f'[sensors]\nforce = "{noise} N"\n'
    warnings = build_case(toml.encode(), text.encode(), Path("case"), "carry", "relaxed").warnings
    return [w for w in warnings if "zero of the load cell" in w]


@pytest.mark.parametrize("zero", [-8.0, 6.0])
def test_wrong_zero_is_reported_with_its_size(zero):
    (warning,) = read(zero)
    assert float(warning.partition("force is ")[2].split()[0]) == pytest.approx(zero, abs=0.5)
    assert "`pamjax import` has the entry `zero`" in warning


@pytest.mark.parametrize("zero", [0.0, 1.0])
def test_zero_within_its_noise_is_not_reported(zero):
    assert read(zero) == []


def test_at_a_low_pressure_only_a_push_is_an_error():
    # This muscle is never vented. With a threshold of zero, it pulls at its lowest pressure.
    assert read(0.0, vented=20e3, threshold=0.0) == []
    (warning,) = read(-8.0, vented=20e3)
    assert "slack" in warning

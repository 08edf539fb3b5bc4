"""The saved improved model has the uncertainty of each parameter, and the ruler errors."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pamjax.diagnosis.library.library_problem import COMPLIANCE_PARAMETER
from pamjax.diagnosis.saved_model import build_model_document

NAMES = ("muscle.turns", COMPLIANCE_PARAMETER, "length_error.1", "length_error.2")
VALUES = np.array([1.2, 1e-6, 4e-4, -7e-4])
SD = np.array([0.01, 2e-7, 1e-4, 3e-4])


def refitted():
    """Return a refitted braid with elastic threads, whose lengths were set by ruler."""
    recording = SimpleNamespace(
        usable=np.array([True, True]), pressure=np.array([0.0, 3e5]), length=np.array([0.18, 0.2])
    )
    case = SimpleNamespace(
        name="rig", checksum="0", gaps="rest", before="vented", folder=Path("nowhere"), recording=recording
    )
    found = SimpleNamespace(case=case, names=NAMES, law="inelastic")
    at = SimpleNamespace(free=(0, 1, 2, 3), values=VALUES)
    chosen = [SimpleNamespace(id="braid_elasticity")]
    return found, SimpleNamespace(estimate=at, mechanisms=chosen, within_model_covariance=np.diag(SD**2))


def test_ruler_errors_are_saved_separately_from_the_muscle():
    kept = build_model_document(*refitted())
    told = kept["parameters"]["length_error.2"]
    assert (told["value"], told["sd"], told["unit"]) == (pytest.approx(-0.7), pytest.approx(0.3), "mm")
    assert kept["correlation"]["names"] == [
        "muscle.turns",
        "thread.stiffness",
        "length_error.1",
        "length_error.2",
    ]
    assert set(kept["cases"]["rig"]["muscle"]["numbers"]) == {"muscle.turns", "thread.stiffness"}


def test_thread_stiffness_is_saved_with_its_relative_sd():
    kept = build_model_document(*refitted())
    stiffness = kept["parameters"]["thread.stiffness"]
    assert stiffness["sd"] / stiffness["value"] == pytest.approx(0.2)
    assert kept["cases"]["rig"]["muscle"]["law"] == "elastic"
    assert kept["cases"]["rig"]["muscle"]["mechanisms"] == []

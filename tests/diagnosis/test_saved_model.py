"""The saved improved model has the uncertainty of each parameter, and the ruler errors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_parameters import COMPLIANCE_PARAMETER
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.saved_model import build_model_document
from pamjax.records.case import Case
from tests.diagnosis.bank import build_setup
from tests.diagnosis.plain_fits import build_fit

#: Estimates of free parameters with their sd, SI.
ESTIMATES = {
    "muscle.turns": (1.2, 0.01),
    COMPLIANCE_PARAMETER: (1e-6, 2e-7),
    "length_error.1": (4e-4, 1e-4),
    "length_error.2": (-7e-4, 3e-4),
}


def build_document():
    """Return the document of a braid with elastic threads, whose two lengths were set by ruler."""
    setup = build_setup()
    sensors = replace(setup.muscle_toml.sensors, length=5e-4, length_per_level=True)
    low, high = setup.plan.length.min(), setup.plan.length.max()
    recording = replace(setup.plan, length=np.where(np.arange(setup.plan.n) < 200, high, low))
    muscle_toml = replace(setup.muscle_toml, sensors=sensors)
    problem = build_library_problem(Case("rig", Path("nowhere"), muscle_toml, recording, "0"))
    free = [problem.index(name) for name in ESTIMATES]
    values = problem.neutral.copy()
    values[free] = [value for value, _ in ESTIMATES.values()]
    sd = np.array([sd for _, sd in ESTIMATES.values()])
    (elastic,) = (c for c in build_candidates(problem) if c.id == "braid_elasticity")
    fit = build_fit(
        values, free, mechanisms=(elastic,), residual=np.zeros(4), jacobian=np.diag(1 / sd),
        prior_sd=np.full(4, np.inf),
    )  # fmt: skip
    return build_model_document(problem, fit)


def test_ruler_errors_are_saved_separately_from_the_muscle():
    document = build_document()
    error = document["parameters"]["length_error.2"]
    assert (error["value"], error["sd"], error["unit"]) == (pytest.approx(-0.7), pytest.approx(0.3), "mm")
    assert document["correlation"]["names"] == [
        "muscle.turns",
        "thread.stiffness",
        "length_error.1",
        "length_error.2",
    ]
    numbers = document["cases"]["rig"]["muscle"]["numbers"]
    assert numbers["muscle.turns"] == 1.2
    assert not [name for name in numbers if name.startswith("length_error")]


def test_thread_stiffness_is_saved_with_its_relative_sd():
    document = build_document()
    stiffness = document["parameters"]["thread.stiffness"]
    assert stiffness["sd"] / stiffness["value"] == pytest.approx(0.2)
    muscle = document["cases"]["rig"]["muscle"]
    assert muscle["law"] == "elastic"
    assert muscle["mechanisms"] == []
    assert muscle["numbers"]["thread.stiffness"] == pytest.approx(1e6)
    assert COMPLIANCE_PARAMETER not in muscle["numbers"]

"""Errors of manufacture: usual shares, tolerance of a tube, stated values; their scatter in a file."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pamjax.sizing.calibration import CalibrationTransfer
from pamjax.sizing.problem import build_problem, list_choices
from pamjax.sizing.requirements import build_task
from pamjax.sizing.scatter import PARAMETER_UNITS, build_scatter_document
from pamjax.sizing.specification.parts import list_tubes
from pamjax.sizing.specification.schema import Tolerance
from pamjax.sizing.specification.spec import read_spec
from pamjax.sizing.tolerances import DEFAULT_SHARES, BuildErrors, choose_errors
from tests.agreement import ROUNDING, agree
from tests.sizing.specification.test_parts import SPEC

DIMENSIONS = {"rest_length": 0.2, "thread_length": 0.25, "turns": 2.0, "wall": 1e-3}
#: Relative error of a standard deviation from 4096 points of a Sobol sequence.
SCATTER_TOLERANCE = 0.01


@pytest.fixture(scope="module")
def problem():
    spec = read_spec(SPEC, stock=True)
    return build_problem(spec, build_task(spec), list_choices(spec)[0], CalibrationTransfer())


def test_default_errors_are_shares_of_the_dimensions(problem):
    errors = choose_errors(Tolerance(), problem.choice, DIMENSIONS)
    agree(errors.position, DEFAULT_SHARES["position"] * DIMENSIONS["rest_length"], ROUNDING)
    for name, dimension in DIMENSIONS.items():
        agree(getattr(errors, name), DEFAULT_SHARES[name] * dimension, ROUNDING)
    assert errors.pressure == DEFAULT_SHARES["pressure"]
    assert errors.stated == ()


def test_default_shares_are_those_of_the_measured_muscle():
    """Half widths of Chambers and Wereley over √3, rounded."""
    half_widths = {"rest_length": 0.8 / 235.7, "thread_length": 0.8 / 251.2, "turns": 0.005 / 1.09}
    for name, half_width in half_widths.items():
        assert DEFAULT_SHARES[name] == pytest.approx(half_width / math.sqrt(3), rel=0.1)


def test_tube_and_stated_tolerance_replace_the_default(problem):
    tube = list_tubes()[0]
    choice = replace(problem.choice, tube=tube)
    agree(choose_errors(Tolerance(), choice, DIMENSIONS).wall, tube.wall_tolerance / math.sqrt(3), ROUNDING)
    stated = choose_errors(Tolerance.model_construct(wall=1e-5, turns=0.0), choice, DIMENSIONS)
    assert (stated.wall, stated.turns, set(stated.stated)) == (1e-5, 0.0, {"wall", "turns"})


def test_scatter_of_a_design_has_the_standard_deviations_of_its_errors(problem):
    errors = BuildErrors(thread_length=0.5e-3, turns=0.01, wall=5e-5)
    numbers = dict.fromkeys(PARAMETER_UNITS, 1.0)
    design = SimpleNamespace(problem=problem, transfer=CalibrationTransfer(), errors=errors, seed=0)
    document = build_scatter_document(design, numbers)
    sds = {name: entry["sd"] for name, entry in document["parameters"].items()}
    rubber, thread = problem.choice.bladder.modulus, problem.choice.thread.modulus
    expected = {
        "muscle.thread_length": 0.5e-3,
        "muscle.turns": 0.01,
        "thread.stiffness": _compute_deviation(thread) / thread.value,
        "bladder_elasticity.modulus": _compute_deviation(rubber),
        "bladder_elasticity.inner_diameter": 1e-4,
        "bladder_elasticity.thickness": 5e-5,
    }
    for name, sd in expected.items():
        agree(sds[name], sd, SCATTER_TOLERANCE)
    names, matrix = document["correlation"]["names"], np.array(document["correlation"]["matrix"])
    bore, wall, turns = (
        names.index(n)
        for n in ("bladder_elasticity.inner_diameter", "bladder_elasticity.thickness", "muscle.turns")
    )
    assert matrix[bore, wall] == -1.0
    assert abs(matrix[turns, wall]) < 0.05
    assert np.linalg.eigvalsh(matrix).min() > -1e-5


def test_an_exact_dimension_has_no_scatter(problem):
    design = SimpleNamespace(problem=problem, transfer=CalibrationTransfer(), errors=BuildErrors(), seed=0)
    document = build_scatter_document(design, dict.fromkeys(PARAMETER_UNITS, 1.0))
    assert document["parameters"]["muscle.turns"]["sd"] == 0.0
    assert np.isfinite(document["correlation"]["matrix"]).all()


def _compute_deviation(known_range):
    """Return the root mean square distance of a uniform value from the typical one."""
    variance = (known_range.high - known_range.low) ** 2 / 12
    return math.sqrt(variance + ((known_range.high + known_range.low) / 2 - known_range.value) ** 2)

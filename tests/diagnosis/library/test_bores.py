"""The inner diameter of a bladder that is not stated is estimated with each of its effects."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.refit.model_fit import fit_model
from pamjax.records.reading.muscle_toml import Bladder
from pamjax.records.reading.quantity import MeasuredValue
from tests.agreement import ROUNDING, agree
from tests.diagnosis.bank import build_plan_problem, replace_readings

RUBBER = ("bladder_elasticity", "mullins_softening", "viscoelastic_creep")


def get_bore(id):
    return f"{id}.inner_diameter"


@pytest.mark.parametrize("id", RUBBER)
def test_unstated_bore_has_a_wide_prior_and_a_stated_one_its_own(id):
    problem = build_plan_problem()
    k = problem.index(get_bore(id))
    agree(problem.prior_sd[k], 0.1 * problem.start[k], ROUNDING)
    bladder = Bladder(inner_diameter=MeasuredValue(15e-3, 0.2e-3))
    stated = replace(problem.case, muscle_toml=replace(problem.case.muscle_toml, bladder=bladder))
    agree(build_library_problem(stated).prior_sd[k], 0.2e-3, ROUNDING)


@pytest.mark.parametrize("id", RUBBER)
def test_candidates_of_the_rubber_estimate_the_bore(id):
    for candidate in build_candidates(build_plan_problem()):
        if candidate.id == id:
            relaxes_force = candidate.amplitudes == ("viscoelastic_creep.force",)
            assert (get_bore(id) in candidate.shape) != relaxes_force


@pytest.mark.slow
def test_softening_of_another_tube_leaves_no_misfit():
    problem = build_plan_problem()
    k = problem.index(get_bore("mullins_softening"))
    values = problem.set_shape(
        problem.neutral,
        {
            "mullins_softening.cyclic_modulus": 2e5,
            "mullins_softening.cyclic_energy": 3.0,
            get_bore("mullins_softening"): 0.8 * problem.start[k],
        },
    )
    rng = np.random.default_rng(1)
    clean = problem.predict(values)
    sensors = problem.case.muscle_toml.sensors
    sd = np.array([sensors.force, sensors.diameter])[:, None]
    recording = replace_readings(problem, clean + sd * rng.standard_normal(clean.shape))
    candidate = next(c for c in build_candidates(recording) if "mullins_softening.cyclic_energy" in c.shape)
    fixed = replace(candidate, shape={n: v for n, v in candidate.shape.items() if "diameter" not in n})
    start = problem.set_shape(values, {get_bore("mullins_softening"): problem.start[k]})
    everywhere = np.ones(recording.n, dtype=bool)
    estimated, assumed = (fit_model(recording, everywhere, [c], start) for c in (candidate, fixed))
    assert estimated.excess_chi2 < 3 * np.sqrt(2 * estimated.noise.size)
    # Control: with the usual share of the braid, the misfit is far beyond noise.
    assert assumed.excess_chi2 > 10 * np.sqrt(2 * assumed.noise.size)
    agree(estimated.estimate.values[k], values[k], 0.05)

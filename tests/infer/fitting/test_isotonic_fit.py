"""Fits of a free contraction: a simulated recording with known parameters, in length."""

import dataclasses
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.identifiability import check_identifiability
from pamjax.infer.fitting.io import build_fit_document, build_xarray_dataset
from pamjax.infer.problem.dataset import build_history
from pamjax.infer.problem.informative_samples import find_informative_samples
from pamjax.model.assembly import assemble_bench
from pamjax.model.isotonic import predict_length
from pamjax.records.dataframe import case_from
from pamjax.records.protocol import Protocol
from pamjax.records.reading.muscle_toml import Sensors
from pamjax.records.simulate import simulate
from tests.agreement import RECOVERED

RUBBER = ("bladder_elasticity",)
IDS = (*RUBBER, "braid_friction")
TRUE = {
    "muscle.rest_length": 0.2,
    "muscle.thread_length": 0.2143,
    "muscle.turns": 1.2,
    "bladder_elasticity.modulus": 4e5,
    "bladder_elasticity.inner_diameter": 0.018,
    "bladder_elasticity.thickness": 0.001,
    "braid_friction.coefficient": 1.0,
    "braid_friction.presliding": 1e-3,
}
LENGTH_SD = 0.1e-3
PROTOCOL = Protocol(
    kind="ramps",
    pressures=["6 bar"],
    loads=["0 N", "30 N"],
    cycles=2,
    duration="20 s",
    rate="1 Hz",
    diameter_every=0,
)
MUSCLE = {
    "muscle": {
        "rest_length": "200 mm",
        "thread_length": {"value": "214 mm", "sd": "0.5 mm"},
        "turns": 1.2,
    },
    "bladder": {"inner_diameter": "18 mm", "thickness": "1 mm"},
    "test": {"measured": "length"},
}
QUICK = {"starts": 1, "fold_count": 2}


def simulate_recording(ids, seed=1):
    true = {k: v for k, v in TRUE.items() if k.partition(".")[0] in ("muscle", *ids)}
    bench = assemble_bench("inelastic", ids, true)
    sensors = Sensors(length=LENGTH_SD)
    return simulate(bench, PROTOCOL.build_schedule(0.2), sensors, seed=seed)


def build_case(recording, **sensors):
    return case_from(recording.to_frame(), MUSCLE | ({"sensors": sensors} if sensors else {}), name="free")


@pytest.fixture(scope="module")
def recording():
    return simulate_recording(RUBBER)


@pytest.fixture(scope="module")
def fitted(recording):
    return fit(build_case(recording, length="0.1 mm"), "inelastic", mechanisms=RUBBER, **QUICK)


@pytest.mark.slow
def test_known_parameters_are_recovered(fitted):
    assert fitted.converged
    for name in ("muscle.thread_length", "bladder_elasticity.modulus"):
        estimate = fitted.estimates[name]
        assert abs(estimate.value - TRUE[name]) < RECOVERED * estimate.sd, name
    assert fitted.estimates["bladder_elasticity.modulus"].is_determined


@pytest.mark.slow
def test_impossible_lengths_are_reported(fitted):
    assert "impossible" not in str(fitted)
    (case_fit,) = fitted.cases
    held_out = case_fit.held_out_prediction["length"].copy()
    row = np.flatnonzero(find_informative_samples(case_fit.case, "length"))[0]
    held_out[row] = 26.7
    case_fit = dataclasses.replace(case_fit, held_out_prediction={"length": held_out})
    note = str(dataclasses.replace(fitted, cases=(case_fit,)))
    assert re.search(r"note: 1 of \d+ predicted held-out lengths are impossible", note)


@pytest.mark.slow
def test_known_friction_is_recovered():
    case = build_case(simulate_recording(IDS), length="0.1 mm")
    rubbed = fit(case, "inelastic", mechanisms=IDS, **QUICK)
    for name in ("bladder_elasticity.modulus", "braid_friction.coefficient"):
        estimate = rubbed.estimates[name]
        assert abs(estimate.value - TRUE[name]) < RECOVERED * estimate.sd, name
    assert rubbed.cases[0].rmse["length"] == pytest.approx(LENGTH_SD, rel=0.15)


@pytest.mark.slow
def test_errors_and_noise_are_lengths(fitted):
    (case_fit,) = fitted.cases
    assert set(case_fit.rmse) == set(case_fit.noise) == {"length"}
    assert case_fit.rmse["length"] == pytest.approx(LENGTH_SD, rel=0.15)
    assert case_fit.noise["length"].sd == pytest.approx(LENGTH_SD, rel=0.01)
    assert case_fit.held_out_score is not None
    assert case_fit.held_out_score.rmse["length"] == pytest.approx(LENGTH_SD, rel=0.2)
    assert "force is set and length is measured: an error of 0.0" in str(fitted)
    assert "length" in build_fit_document(fitted)["cases"]["free"]["rmse"]
    dataset = build_xarray_dataset(case_fit)
    assert {"length_model", "length_residual", "force"} <= set(dataset)
    assert np.nanmax(dataset["force"]) == pytest.approx(30.0)


def test_unknown_noise_of_the_length_is_estimated():
    """Without a mechanism, a fit compiles in a few seconds."""
    (case_fit,) = fit(build_case(simulate_recording(())), "inelastic", **QUICK).cases
    assert case_fit.noise["length"].sd == pytest.approx(LENGTH_SD, rel=0.2)


@pytest.mark.slow
def test_missing_friction_leaves_a_loop():
    case = build_case(simulate_recording(IDS), length="0.1 mm")
    (case_fit,) = fit(case, "inelastic", mechanisms=RUBBER, **QUICK).cases
    assert case_fit.noise["length"].rms_over_noise > 1.5


def test_rows_of_a_free_contraction_are_informative(recording):
    isotonic = build_case(recording, length="0.1 mm")
    # At zero pressure the length at a set force is arbitrary.
    informative = find_informative_samples(isotonic, "length")
    usable = isotonic.recording.usable
    assert informative[usable].sum() == (isotonic.recording.pressure[usable] > 6e3).sum()
    parameters, _ = check_identifiability(isotonic, "inelastic")
    assert parameters[0].sd_ratio < 0.1


@pytest.mark.slow
def test_friction_increases_the_length_noise_after_a_reversal():
    """The noise model neglects this part: the docstring of `sensor_noise.py` states its size."""
    # Without pressure a load has no equilibrium, and the memories keep its NaN: simulate one load alone.
    schedule = PROTOCOL.model_copy(update={"loads": PROTOCOL.loads[:1]}).build_schedule(0.2)
    recording = simulate(assemble_bench("inelastic", IDS, TRUE), schedule, Sensors())
    pressure, length, force = (jnp.asarray(getattr(recording, k)) for k in ("pressure", "length", "force"))
    history = build_history(build_case(recording), size=recording.n)
    bench = assemble_bench("inelastic", IDS, TRUE)

    @jax.jit
    @jax.vmap
    def compute_residual(measured_length):
        return measured_length - predict_length(bench, pressure, measured_length, force, history).length

    noise = LENGTH_SD * np.random.default_rng(0).standard_normal((200, recording.n))
    sd_ratios = np.std(compute_residual(length + noise), axis=0) / LENGTH_SD
    assert np.mean(np.isfinite(sd_ratios)) > 0.9
    sd_ratios = sd_ratios[np.isfinite(sd_ratios)]
    assert np.median(sd_ratios) == pytest.approx(1.0, abs=0.1)
    assert np.mean(sd_ratios > 1.3) < 0.3
    assert 2.5 < np.max(sd_ratios) < 3.5

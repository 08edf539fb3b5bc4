"""The planned runs of an isotonic rig are simulated and fitted: the fitted sd is the planned one.

pamjax simulates and fits the recordings of a rig with exact zeros and gains. For a rig with uncertain zeros,
gains and compliance, this file does both, for inextensible threads in closed form.
"""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from pamjax.infer.fitting.fit import fit
from pamjax.model.assembly import assemble
from pamjax.planning.plan import plan
from pamjax.planning.rig_capabilities import read_capabilities
from pamjax.planning.runs import PlannedRun
from pamjax.records.dataframe import case_from
from pamjax.records.protocol import Schedule
from pamjax.records.reading.muscle_toml import read_muscle_toml
from pamjax.records.simulate import simulate

REST, THREADS, AREA = 0.2, 120, 0.07e-6
TOML = """
[muscle]
name = "free"
rest_length = "200 mm"
thread_length = {value = "214 mm", sd = "2 mm"}
turns = {value = 1.2, sd = 0.02}
"""
ELASTIC = """
threads = 120
thread_area = "0.07 mm^2"
[thread]
modulus = {value = "70 GPa", sd = "15 GPa"}
"""
SENSORS = """
[test]
measured = "length"
[sensors]
length = "0.1 mm"
pressure = "1 kPa"
"""
DRAWS = 6

#: Limits of fitted / planned sd, rms over the draws. A plan averages the variance over the prior.
#: The variance of the modulus is proportional to its fourth power, and its prior has an sd of 21 %.
#: So the rms of six draws scatters by 0.17, and three times this is allowed.
MODULUS_LIMITS = 0.5, 1.5
#: The other sds scarcely depend on the drawn values. A fit estimates the autocorrelation: some per cent.
LIMITS = 0.85, 1.15
#: The rms of six standard normal errors is within these limits in 999 of 1,000 cases.
ERROR_LIMITS = 0.22, 2.0

#: In closed form the noise is known and threads do not stretch: only the linearisation differs.
CLOSED_FORM_DRAWS, CLOSED_FORM_LIMITS = 40, (0.95, 1.05)
#: The rms of 40 standard normal errors is within these limits in 999 of 1,000 cases.
CLOSED_FORM_ERROR_LIMITS = 0.65, 1.38


def rms(values):
    return np.sqrt(np.mean(np.square(values), axis=0))


def is_within(ratios, limits):
    """Return whether the rms of ratios to the planned sd is within the limits."""
    return limits[0] < rms(ratios) < limits[1]


def draw_truth(result, rng):
    """Return values of the muscle's parameters, drawn from the priors within 1.5 sd."""
    return {
        name: expected.value + expected.current_sd * np.clip(rng.standard_normal(), -1.5, 1.5)
        for name, expected in result.expected_sds.items()
    }


def collect_commands(runs):
    """Return pressure, Pa, and set force, N, of all samples."""
    return tuple(np.concatenate([getattr(run, name) for run in runs]) for name in ("pressure", "load"))


def list_planned_runs(result):
    return [run for count, run in result.chosen_runs for _ in range(count)]


def choose_uninformative_runs(result):
    """Return as many samples as planned, in one hold without a load at a fifth of the highest pressure."""
    pressure = np.full(result.rows, 0.2 * result.prior.capabilities.max_pressure)
    return [PlannedRun("one hold", pressure, np.nan * pressure, result.minutes, {}, load=0.0 * pressure)]


def fit_runs(result, toml, runs, seed):
    """Return (fitted sd, error) of each parameter, both over the planned sd, by pamjax."""
    true = draw_truth(result, np.random.default_rng(seed))
    pressure, load = collect_commands([run for run in runs if run.pressure.size])
    cycle = np.concatenate([np.full(run.pressure.size, k + 1) for k, run in enumerate(runs)])
    n = pressure.size
    has_diameter = np.full(n, "diameter" in result.prior.capabilities.channels)
    schedule = Schedule(np.arange(n) * 1.0, pressure, np.full(n, REST), cycle, has_diameter, load)
    numbers = {"muscle.rest_length": REST, "muscle.threads": THREADS * 1.0, "muscle.thread_area": AREA}
    sensors = result.prior.muscle_toml.sensors
    recording = simulate(assemble("elastic", true | numbers), schedule, sensors, seed=seed)
    case = case_from(recording.to_frame(), tomllib.loads(toml), name="free")
    estimates = fit(case, "elastic", starts=1, fold_count=2).estimates
    return [
        (
            estimates[name].sd / expected.expected_sd,
            (estimates[name].value - true[name]) / expected.expected_sd,
        )
        for name, expected in result.expected_sds.items()
    ]


@pytest.mark.slow
@pytest.mark.parametrize("diameter", ["", 'diameter = "0.1 mm"\n'])
def test_planned_sd_of_the_modulus_is_reached(diameter):
    toml = TOML + ELASTIC + SENSORS + diameter
    muscle_toml = read_muscle_toml(toml.encode())
    channels = ("length", "diameter") if diameter else ("length",)
    rig = read_capabilities(muscle_toml, None, channels, pressure="600 kPa", minutes=30.0)
    result = plan(muscle_toml, replace(rig, error_sds={}), "thread.modulus", "4 %")
    outcomes = np.array(
        [fit_runs(result, toml, list_planned_runs(result), seed) for seed in range(DRAWS)]
    )  # draws, parameters, (sd, error)
    assert next(iter(result.expected_sds)) == "thread.modulus"
    for k, limits in enumerate([MODULUS_LIMITS, LIMITS, LIMITS]):
        assert is_within(outcomes[:, k, 0], limits)
        assert is_within(outcomes[:, k, 1], ERROR_LIMITS)
    # Control: as many samples without the plan's pressures and forces determine far less.
    other = np.array([fit_runs(result, toml, choose_uninformative_runs(result), seed) for seed in range(2)])
    assert not is_within(other[:, 0, 0], MODULUS_LIMITS)
    assert not is_within(other[:, 1, 0], LIMITS)


def predict_recorded(names, values, pressure, load):
    """Return the recorded length of inextensible threads, m, with the errors of the rig."""
    number = dict(zip(names, values, strict=True))
    true_pressure = (pressure - number["pressure_offset.offset"]) / (1 + number["pressure_gain.gain"])
    ratio = 4 * np.pi * number["muscle.turns"] ** 2 * load / true_pressure
    length = np.sqrt((ratio + number["muscle.thread_length"] ** 2) / 3)
    return length + number["length_offset.offset"] + number["rig_compliance.compliance"] * load


def fit_closed_form(result, runs, seed):
    """Return (fitted sd, error) of each parameter of the muscle, both over the planned sd."""
    rng, prior = np.random.default_rng(seed), result.prior
    names, mean, sd = prior.space.names, prior.mean.copy(), prior.scale.copy()
    true = mean + sd * rng.standard_normal(mean.size)
    for name, check_sd in [item for run in runs for item in run.direct_sds.items() if item[0] in names]:
        k = names.index(name)
        # A check measures the error of a sensor: a narrower prior.
        share, seen = sd[k] ** 2 / (sd[k] ** 2 + check_sd**2), true[k] + check_sd * rng.standard_normal()
        mean[k], sd[k] = mean[k] + share * (seen - mean[k]), check_sd * np.sqrt(share)
    pressure, load = collect_commands([run for run in runs if run.pressure.size])
    # Near zero pressure the pressure sensor may read zero, and the length is arbitrary.
    is_inflated = pressure > 0.03 * pressure.max()
    pressure, load = pressure[is_inflated], load[is_inflated]
    truth = predict_recorded(names, true, pressure, load)
    is_lifted = truth <= REST
    pressure, load, truth = pressure[is_lifted], load[is_lifted], truth[is_lifted]
    rig = prior.capabilities
    recorded = truth + rig.length_sd * rng.standard_normal(truth.size)
    read_pressure = pressure + rig.pressure_sd * rng.standard_normal(truth.size)
    step = 1e-3 * pressure
    by_pressure = (
        predict_recorded(names, mean, pressure + step, load)
        - predict_recorded(names, mean, pressure - step, load)
    ) / (2 * step)
    noise = np.hypot(rig.length_sd, rig.pressure_sd * by_pressure)

    def compute_residual(u):
        misfit = (predict_recorded(names, mean + sd * u, read_pressure, load) - recorded) / noise
        return np.concatenate([misfit, u])

    solution = least_squares(compute_residual, np.zeros(mean.size), xtol=1e-12)
    fitted_sd = np.sqrt(np.diag(np.linalg.inv(solution.jac.T @ solution.jac))) * sd
    return [
        (
            fitted_sd[k] / expected.expected_sd,
            (mean[k] + sd[k] * solution.x[k] - true[k]) / expected.expected_sd,
        )
        for name, expected in result.expected_sds.items()
        for k in [names.index(name)]
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("goal", "to"), [("muscle.turns", "0.003"), ("all", None)])
def test_planned_sd_with_errors_of_the_rig_is_reached(goal, to):
    muscle_toml = read_muscle_toml((TOML + SENSORS).encode())
    result = plan(muscle_toml, read_capabilities(muscle_toml, pressure="600 kPa"), goal, to)
    runs = list_planned_runs(result)
    outcomes = np.array([fit_closed_form(result, runs, seed) for seed in range(CLOSED_FORM_DRAWS)])
    for k in range(len(result.expected_sds)):
        assert is_within(outcomes[:, k, 0], CLOSED_FORM_LIMITS)
        assert is_within(outcomes[:, k, 1], CLOSED_FORM_ERROR_LIMITS)
    # Control: as many samples at one pressure and force, without the plan's checks.
    other = np.array([fit_closed_form(result, choose_uninformative_runs(result), seed) for seed in range(3)])
    assert not is_within(other[:, 0, 0], CLOSED_FORM_LIMITS)

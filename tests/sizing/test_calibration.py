"""Transfer of a calibration to a muscle of another size; cost of materials; bundles of muscles."""

import json
import math

import numpy as np
import pytest
import xarray as xr

from pamjax.infer.fitting.load import load_muscle
from pamjax.model.mechanisms.end_taper import EndTaper
from pamjax.model.mechanisms.thread_crimp import ThreadCrimp
from pamjax.sizing.calibration import CalibrationTransfer, transfer_calibration
from pamjax.sizing.candidate import build_bench, evaluate_many, locate_output
from pamjax.sizing.chance_constraints import draw_builds
from pamjax.sizing.problem import build_problem, list_choices
from pamjax.sizing.requirements import build_task
from pamjax.sizing.specification.schema import Calibration
from pamjax.sizing.specification.spec import PACKING_RATIOS, read_spec
from pamjax.sizing.tolerances import BuildErrors
from tests.agreement import ROUNDING, agree

SPEC = {
    "supply": {"pressure": "600 kPa"},
    "force": [{"at_least": "400 N", "contraction": 0.1}],
    "envelope": {"length": "250 mm"},
    "threads": {"kinds": "pet", "counts": 72, "diameters": "0.3 mm"},
    "bladders": {"kinds": "latex"},
}
ENTRY = """
[muscle]
name = "measured"
rest_length = "200 mm"
thread_length = {value = "215 mm", sd = "0.2 mm"}
turns = {value = 1.2, sd = 0.005}
threads = 40
thread_area = "0.05 mm^2"
[thread]
modulus = {value = "12 GPa", sd = "2 GPa"}
"""

#: Parameters of the measured muscle, SI; the outer diameter of its rubber is 16 mm.
NUMBERS = {
    "muscle.rest_length": 0.2, "muscle.thread_length": 0.215, "muscle.turns": 1.2, "muscle.threads": 40.0,
    "muscle.thread_area": 0.05e-6, "thread.modulus": 12e9,
    "bladder_elasticity.modulus": 0.5e6, "bladder_elasticity.mooney": 0.2,
    "bladder_elasticity.inner_diameter": 0.012, "bladder_elasticity.thickness": 0.002,
    "bladder_elasticity.length": 0.2,
    "thread_crimp.crimp": 0.004, "thread_crimp.load": 30.0,
    "end_taper.share": 0.4, "end_taper.radius": 0.006,
    "force_offset.offset": 3.0,
}  # fmt: skip
IDS = ("bladder_elasticity", "thread_crimp", "end_taper", "force_offset")


@pytest.fixture
def folder(tmp_path):
    """Return a folder with the model.json of a measured muscle."""
    case = {
        "muscle": {"law": "elastic", "mechanisms": list(IDS), "numbers": NUMBERS},
        "muscle_toml": ENTRY,
        "calibrated": {"pressure": {"low": 1e5, "high": 5e5}, "length": {"low": 0.16, "high": 0.2}},
    }
    (tmp_path / "model.json").write_text(json.dumps({"schema": "pamjax.fit/1", "cases": {"measured": case}}))
    return tmp_path


def transfer_from(folder, **entries):
    spec = read_spec(SPEC)
    calibration = Calibration(**({"muscle": "model.json", "thread": "pet", "bladder": "latex"} | entries))
    return spec, transfer_calibration(calibration, folder, "spec.toml", spec.threads, spec.bladders)


def build_problems(entries, transfer=None):
    spec = read_spec(entries)
    task = build_task(spec)
    return [
        build_problem(spec, task, choice, transfer or CalibrationTransfer()) for choice in list_choices(spec)
    ]


def coordinates(rest, thread, turns, outside, wall):
    angle = math.asin(rest / thread)
    assert turns is None or math.isclose(turns, thread * math.cos(angle) / (math.pi * outside), rel_tol=1e-6)
    return np.array([math.log(rest), angle, math.log(outside), math.log(wall), math.log(5e5)])


def test_crimp_and_taper_scale_with_the_muscle(folder):
    _, transfer = transfer_from(folder)
    assert set(transfer.ids) == {"thread_crimp", "end_taper"}
    assert "force_offset" in transfer.sources[-1]
    (problem,) = build_problems(SPEC, transfer)
    measured = load_muscle(folder / "model.json").muscle
    (taper,), (crimp,) = measured.find_mechanisms(EndTaper), measured.find_mechanisms(ThreadCrimp)
    for diameter_ratio, area_ratio in ((1.0, 1.0), (2.0, 1.0), (1.0, 3.0)):
        c = coordinates(0.2, 0.215, None, diameter_ratio * 0.016, 0.002)
        build = problem.build._replace(threads=40.0, thread_area=area_ratio * 0.05e-6)
        bench = build_bench(c, build, transfer.ids, transfer.numbers)
        (new_taper,), (new_crimp,) = bench.find_mechanisms(EndTaper), bench.find_mechanisms(ThreadCrimp)
        # The radius of the fitting scales with the muscle; crimp straightens at the same stress.
        agree([new_taper.share, new_taper.radius], [taper.share, diameter_ratio * taper.radius], ROUNDING)
        agree([new_crimp.crimp, new_crimp.load], [crimp.crimp, area_ratio * crimp.load], ROUNDING)


def test_posterior_draws_keep_their_correlation(folder):
    rng = np.random.default_rng(3)
    unit = rng.standard_normal((4000, 3))
    thread = 12e9 * (1 + 0.1 * unit[:, 0])
    shear = 0.5e6 * (1 + 0.05 * (0.8 * unit[:, 0] + 0.6 * unit[:, 1]))
    crimp = 0.004 * np.exp(0.2 * unit[:, 2])
    samples = {"thread.modulus": thread, "bladder_elasticity.modulus": shear, "thread_crimp.crimp": crimp}
    data = {name: (("chain", "draw"), values[None]) for name, values in samples.items()}
    xr.Dataset(data).to_netcdf(folder / "posterior.nc", group="posterior", engine="h5netcdf")
    _, transfer = transfer_from(folder, posterior="posterior.nc")
    (problem,) = build_problems(SPEC, transfer)
    draws = draw_builds(problem, transfer, BuildErrors(), 4000, 0)
    agree(draws.build.modulus.mean(), 12e9, 5 * 0.1 / math.sqrt(4000))
    agree(draws.build.modulus.std(), 0.1 * 12e9, 0.1)
    agree(draws.build.shear.std(), 0.05 * 0.5e6, 0.1)
    assert np.corrcoef(draws.build.modulus, draws.build.shear)[0, 1] == pytest.approx(0.8, abs=0.05)
    assert set(np.round(draws.numbers["thread_crimp.crimp"], 12)) <= set(np.round(crimp, 12))
    # A property without calibration is drawn over the range of its sources.
    assert np.ptp(draws.build.strength) > 0
    assert abs(np.corrcoef(draws.build.modulus, draws.build.strength)[0, 1]) < 0.08


def test_misfit_of_a_diagnosis_becomes_a_model_error_of_the_force(folder):
    diagnosis = {
        "improvement": {"held_out": {"force": {"rmse_equations": 5.0}}},
        "noise": {"force": {"sd": 3.0}},
    }
    (folder / "diagnosis.json").write_text(json.dumps(diagnosis))
    _, transfer = transfer_from(folder)
    blocked = 5e5 * (3 * 0.2**2 - 0.215**2) / (4 * math.pi * 1.2**2)
    agree(transfer.discrepancy, 4.0 / blocked, ROUNDING)
    (problem,) = build_problems(SPEC, transfer)
    draws = draw_builds(problem, transfer, BuildErrors(), 4000, 0)
    agree(draws.build.force_error.std(), 4.0 / blocked, 0.1)
    # A misfit within the noise gives no model error.
    diagnosis["improvement"]["held_out"]["force"]["rmse_equations"] = 2.0
    (folder / "diagnosis.json").write_text(json.dumps(diagnosis))
    assert transfer_from(folder)[1].discrepancy == 0


@pytest.fixture(scope="module")
def priced():
    """Return the problems of one, two and three muscles with prices, and the outputs of one candidate."""
    prices = {"thread": [{"name": "pet", "price": 20.0}], "bladder": [{"name": "latex", "price": 5.0}]}
    problems = build_problems(SPEC | prices | {"minimise": "cost", "parallel": [1, 2, 3]})
    c = coordinates(0.22, 0.236, None, 0.02, 0.0015)
    return problems, [evaluate_many(c[None], p.build, p.numbers, p.task.points, p.ids)[0] for p in problems]


def test_cost_is_mass_times_price_of_thread_and_rubber(priced):
    problems, outputs = priced
    build = problems[0].build
    yarn = build.threads * 0.236 * build.thread_area * build.density
    rubber = math.pi / 4 * (0.02**2 - 0.017**2) * 0.22 * build.rubber_density
    agree(outputs[0][locate_output("mass")], yarn + rubber, 1e-9)
    agree(outputs[0][locate_output("cost")], 20 * yarn + 5 * rubber, 1e-9)


def test_bundle_has_the_total_force_and_the_diameter_of_its_circle(priced):
    _, outputs = priced
    for count, y in enumerate(outputs, 1):
        for name in ("mass", "air", "cost"):
            agree(y[locate_output(name)], count * outputs[0][locate_output(name)], ROUNDING)
        agree(y[locate_output("force", 1)], count * outputs[0][locate_output("force", 1)], ROUNDING)
        agree(
            y[locate_output("bundle")],
            PACKING_RATIOS[count - 1] * outputs[0][locate_output("widest")],
            ROUNDING,
        )
    # Optimal packings: a row of two, a triangle of three, a square of four, six around one.
    agree([PACKING_RATIOS[k - 1] for k in (2, 3, 4, 7)], [2, 1 + 2 / math.sqrt(3), 1 + math.sqrt(2), 3], 2e-5)


@pytest.mark.slow
def test_two_muscles_for_twice_the_force_cost_twice():
    from pamjax.sizing.enumerate import search_choices

    prices = {"thread": [{"name": "pet", "price": 20.0}], "bladder": [{"name": "latex", "price": 5.0}]}
    values = []
    for count in (1, 2):
        pull = [{"at_least": f"{400 * count} N", "contraction": 0.1}]
        entries = SPEC | prices | {"minimise": "cost", "parallel": count, "force": pull}
        results, _ = search_choices(build_problems(entries), starts=4, seed=0)
        values.append(results[0].optimum.log_objective)
    agree(values[1], values[0] + math.log(2), 1e-4, scale=1.0)

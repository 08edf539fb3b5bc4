"""What a measured muscle hands on to one of another size; what cost and bundles are worth."""

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
from pamjax.sizing.schema import Calibration
from pamjax.sizing.spec import PACKING_RATIOS, read_spec
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

#: Of the measured muscle, SI: 16 mm wide outside the rubber.
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
    """A model.json of a measured muscle, with what its diagnosis left."""
    case = {
        "muscle": {"law": "elastic", "mechanisms": list(IDS), "numbers": NUMBERS},
        "muscle_toml": ENTRY,
        "calibrated": {"pressure": {"low": 1e5, "high": 5e5}, "length": {"low": 0.16, "high": 0.2}},
    }
    (tmp_path / "model.json").write_text(json.dumps({"schema": "pamjax.fit/1", "cases": {"measured": case}}))
    return tmp_path


def handed_on(folder, **words):
    spec = read_spec(SPEC)
    words = {"muscle": "model.json", "thread": "pet", "bladder": "latex"} | words
    return spec, transfer_calibration(Calibration(**words), folder, "spec.toml", spec.threads, spec.bladders)


def posed(said, handed=None):
    spec = read_spec(said)
    asked = build_task(spec)
    return [
        build_problem(spec, asked, choice, handed or CalibrationTransfer()) for choice in list_choices(spec)
    ]


def coordinates(rest, thread, turns, outside, wall):
    angle = math.asin(rest / thread)
    assert turns is None or math.isclose(turns, thread * math.cos(angle) / (math.pi * outside), rel_tol=1e-6)
    return np.array([math.log(rest), angle, math.log(outside), math.log(wall), math.log(5e5)])


def test_crimp_and_ends_keep_their_shape_in_another_size(folder):
    _, handed = handed_on(folder)
    assert set(handed.ids) == {"thread_crimp", "end_taper"}
    assert "force_offset" in handed.sources[-1]
    (one,) = posed(SPEC, handed)
    measured = load_muscle(folder / "model.json").muscle
    (taper,), (crimp,) = measured.find_mechanisms(EndTaper), measured.find_mechanisms(ThreadCrimp)
    for wider, more in ((1.0, 1.0), (2.0, 1.0), (1.0, 3.0)):
        c = coordinates(0.2, 0.215, None, wider * 0.016, 0.002)
        made = one.build._replace(threads=40.0, thread_area=more * 0.05e-6)
        other = build_bench(c, made, handed.ids, handed.numbers)
        (ends,), (waves,) = other.find_mechanisms(EndTaper), other.find_mechanisms(ThreadCrimp)
        # A fitting grows with the muscle; a wave straightens at the same stress.
        agree([ends.share, ends.radius], [taper.share, wider * taper.radius], ROUNDING)
        agree([waves.crimp, waves.load], [crimp.crimp, more * crimp.load], ROUNDING)


def test_posterior_draws_stay_together(folder):
    rng = np.random.default_rng(3)
    unit = rng.standard_normal((4000, 3))
    thread = 12e9 * (1 + 0.1 * unit[:, 0])
    shear = 0.5e6 * (1 + 0.05 * (0.8 * unit[:, 0] + 0.6 * unit[:, 1]))
    crimp = 0.004 * np.exp(0.2 * unit[:, 2])
    drawn = {"thread.modulus": thread, "bladder_elasticity.modulus": shear, "thread_crimp.crimp": crimp}
    data = {name: (("chain", "draw"), values[None]) for name, values in drawn.items()}
    xr.Dataset(data).to_netcdf(folder / "posterior.nc", group="posterior", engine="h5netcdf")
    spec, handed = handed_on(folder, posterior="posterior.nc")
    (one,) = posed(SPEC, handed)
    doubt = draw_builds(one, handed, spec.entries.tolerance, 4000, 0)
    agree(doubt.build.modulus.mean(), 12e9, 5 * 0.1 / math.sqrt(4000))
    agree(doubt.build.modulus.std(), 0.1 * 12e9, 0.1)
    agree(doubt.build.shear.std(), 0.05 * 0.5e6, 0.1)
    assert np.corrcoef(doubt.build.modulus, doubt.build.shear)[0, 1] == pytest.approx(0.8, abs=0.05)
    assert set(np.round(doubt.numbers["thread_crimp.crimp"], 12)) <= set(np.round(crimp, 12))
    # What is not calibrated is drawn over the range of its sources.
    assert np.ptp(doubt.build.strength) > 0
    assert abs(np.corrcoef(doubt.build.modulus, doubt.build.strength)[0, 1]) < 0.08


def test_what_a_diagnosis_leaves_is_a_share_of_the_blocked_force(folder):
    left = {"improvement": {"held_out": {"force": {"rmse_after": 5.0}}}, "noise": {"force": {"sd": 3.0}}}
    (folder / "diagnosis.json").write_text(json.dumps(left))
    spec, handed = handed_on(folder)
    blocked = 5e5 * (3 * 0.2**2 - 0.215**2) / (4 * math.pi * 1.2**2)
    agree(handed.discrepancy, 4.0 / blocked, ROUNDING)
    (one,) = posed(SPEC, handed)
    doubt = draw_builds(one, handed, spec.entries.tolerance, 4000, 0)
    agree(doubt.build.force_error.std(), 4.0 / blocked, 0.1)
    # Nothing is left where the misfit is noise.
    left["improvement"]["held_out"]["force"]["rmse_after"] = 2.0
    (folder / "diagnosis.json").write_text(json.dumps(left))
    assert handed_on(folder)[1].discrepancy == 0


@pytest.fixture(scope="module")
def priced():
    """One, two and three muscles of priced materials, and what each shows of one candidate."""
    prices = {"thread": [{"name": "pet", "price": 20.0}], "bladder": [{"name": "latex", "price": 5.0}]}
    problems = posed(SPEC | prices | {"minimise": "cost", "parallel": [1, 2, 3]})
    c = coordinates(0.22, 0.236, None, 0.02, 0.0015)
    return problems, [evaluate_many(c[None], p.build, p.numbers, p.task.points, p.ids)[0] for p in problems]


def test_cost_is_that_of_thread_and_rubber_by_weight(priced):
    problems, shown = priced
    made = problems[0].build
    yarn = made.threads * 0.236 * made.thread_area * made.density
    rubber = math.pi / 4 * (0.02**2 - 0.017**2) * 0.22 * made.rubber_density
    agree(shown[0][locate_output("mass")], yarn + rubber, 1e-9)
    agree(shown[0][locate_output("cost")], 20 * yarn + 5 * rubber, 1e-9)


def test_a_bundle_pulls_as_all_its_muscles_and_is_as_wide_as_its_circle(priced):
    _, shown = priced
    for many_, y in enumerate(shown, 1):
        for name in ("mass", "air", "cost"):
            agree(y[locate_output(name)], many_ * shown[0][locate_output(name)], ROUNDING)
        agree(y[locate_output("force", 1)], many_ * shown[0][locate_output("force", 1)], ROUNDING)
        agree(
            y[locate_output("bundle")],
            PACKING_RATIOS[many_ - 1] * shown[0][locate_output("widest")],
            ROUNDING,
        )
    # Two, three and four circles touch in a row, a triangle, a square; seven as six around one.
    agree([PACKING_RATIOS[k - 1] for k in (2, 3, 4, 7)], [2, 1 + 2 / math.sqrt(3), 1 + math.sqrt(2), 3], 2e-5)


@pytest.mark.slow
def test_two_muscles_for_twice_the_force_are_one_twice():
    from pamjax.sizing.enumerate import search_choices

    room = {"thread": [{"name": "pet", "price": 20.0}], "bladder": [{"name": "latex", "price": 5.0}]}
    values = []
    for count in (1, 2):
        pull = [{"at_least": f"{400 * count} N", "contraction": 0.1}]
        said = SPEC | room | {"minimise": "cost", "parallel": count, "force": pull}
        tried, _ = search_choices(posed(said), starts=4, seed=0)
        values.append(tried[0].optimum.log_objective)
    agree(values[1], values[0] + math.log(2), 1e-4, scale=1.0)

"""The search: exact slopes, multipliers that are prices, two solvers, and what is told where nothing fits."""

import copy

import numpy as np
import pytest

import pamjax
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.sizing.calibration import CalibrationTransfer, transfer_calibration
from pamjax.sizing.chance_constraints import draw_builds, estimate_probability, meet_probability
from pamjax.sizing.enumerate import search_choices
from pamjax.sizing.io import save_design
from pamjax.sizing.optimise import search_optimum
from pamjax.sizing.pareto import compute_front
from pamjax.sizing.problem import build_problem, list_choices
from pamjax.sizing.requirements import build_task
from pamjax.sizing.schema import Calibration
from pamjax.sizing.spec import read_spec
from tests.agreement import SOLVED, agree

SPEC = {
    "name": "test",
    "supply": {"pressure": "600 kPa"},
    "force": [{"at_least": "400 N", "contraction": 0.1}],
    "free_contraction": 0.2,
    "envelope": {"length": "250 mm", "diameter": "40 mm"},
    "threads": {"kinds": "pet", "counts": 72, "diameters": "0.3 mm"},
    "bladders": {"kinds": "latex"},
}

#: A change of one per cent, and what of the change of the objective its slope may miss: a curvature of one.
CHANGE, MISSED = 0.01, 0.02


def posed(said, handed=None):
    spec = read_spec(said)
    asked = build_task(spec)
    return spec, [
        build_problem(spec, asked, choice, handed or CalibrationTransfer()) for choice in list_choices(spec)
    ]


def solved(said):
    _, problems = posed(said)
    tried, _ = search_choices(problems, starts=4, seed=0)
    assert tried[0].optimum is not None
    return tried[0]


@pytest.fixture(scope="module")
def found():
    return solved(SPEC)


def changed(*path, to):
    said = copy.deepcopy(SPEC)
    at = said
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = to
    return said


@pytest.mark.slow
def test_slopes_are_exact(found):
    one, z = found.problem, found.optimum.z + 0.01 * (0.5 - found.optimum.z)
    _, slope, _, slopes = one.evaluate(z)
    for k in range(z.size):
        step = np.zeros(z.size)
        step[k] = 1e-5
        above, below = one.evaluate(z + step), one.evaluate(z - step)
        agree(slope[k], (above[0] - below[0]) / 2e-5, 1e-5, scale=1e-3)
        agree(slopes[:, k], (above[2] - below[2]) / 2e-5, 1e-5, scale=1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "path", "to", "sign"),
    [
        ("force 1", ("force", 0, "at_least"), "396 N", -1),
        ("length", ("envelope", "length"), "252.5 mm", -1),
        ("supply", ("supply", "pressure"), "606 kPa", -1),
    ],
)
def test_a_multiplier_is_what_one_per_cent_buys(found, key, path, to, sign):
    from pamjax.sizing.sensitivity import compute_prices

    by_key = {
        price.requirement.key: price.percent_saved for price in compute_prices(found.problem, found.optimum)
    }
    again = solved(changed(*path, to=to))
    bought = (again.optimum.log_objective - found.optimum.log_objective) / CHANGE
    if key == "supply":
        # The proof at rest is at the supply too, so that threads and mesh may take from it.
        assert -by_key[key] - MISSED <= bought <= MISSED
    else:
        agree(sign * by_key.get(key, 0.0), bought, MISSED, scale=1.0)


@pytest.mark.slow
def test_another_solver_with_exact_curvature_finds_the_same(found):
    other = search_optimum(found.problem, np.clip(found.optimum.z, 0.02, 0.98), "trust-constr")
    assert other.is_feasible
    agree(other.log_objective, found.optimum.log_objective, 1e-4)


@pytest.mark.slow
def test_what_cannot_be_is_told_with_what_would_do():
    said = changed("force", 0, "at_least", to="9 kN")
    design = pamjax.size(said)
    assert not design.feasible
    assert "no muscle of this catalogue does all of it" in str(design)
    by_key = {give.requirement.key: give for give in design.relaxations}
    enough = by_key["force 1"].relaxed_bound
    assert 400 < enough < 9000
    for share, feasible in ((0.98, True), (1.02, False)):
        again = changed("force", 0, "at_least", to=f"{share * enough:.6f} N")
        assert pamjax.size(again, margins=False).feasible == feasible


@pytest.mark.slow
def test_what_has_no_balance_comes_near_nothing():
    said = changed("force", 0, "at_least", to="900 N") | {
        "supply": {"pressure": "400 kPa"},
        "envelope": {"length": "180 mm", "fittings": "12 mm", "diameter": "15 mm"},
        "threads": {"kinds": "aramid", "counts": 48, "diameters": "0.2 mm"},
        "bladders": {"kinds": "silicone"},
    }
    design = pamjax.size(said)
    assert not design.feasible
    assert design.output("unsolved") == 0
    by_key = {give.requirement.key: give for give in design.relaxations}
    assert 50 < by_key["force 1"].relaxed_bound < 900
    again = changed("force", 0, "at_least", to=f"{0.95 * by_key['force 1'].relaxed_bound:.6f} N")
    assert pamjax.size(said | {"force": again["force"]}, margins=False).feasible


@pytest.mark.slow
def test_a_room_that_would_do_is_that_of_the_spec_with_its_fittings():
    said = {
        "supply": {"pressure": "2 bar"},
        "stroke": {"length": "80 mm", "load": "100 N"},
        "envelope": {"length": "300 mm", "fittings": "40 mm"},
        "threads": {"kinds": "aramid", "counts": [96, 144], "diameters": "0.3 mm"},
        "bladders": {"kinds": "latex"},
        "parallel": [2],
    }
    give = next(give for give in pamjax.size(said).relaxations if give.requirement.key == "length")
    assert give.relaxed_bound > 0.3
    for share, feasible in ((0.99, False), (1.01, True)):
        room = {"length": f"{1e3 * share * give.relaxed_bound:.3f} mm", "fittings": "40 mm"}
        assert pamjax.size(said | {"envelope": room}, margins=False).feasible == feasible


@pytest.mark.slow
def test_a_probability_is_kept_on_draws_it_did_not_see(found):
    said = SPEC | {"tolerance": {"thread_length": "0.5 mm", "turns": 0.01}}
    spec, (one,) = posed(said)
    doubt = draw_builds(one, CalibrationTransfer(), spec.entries.tolerance, 256, 0)
    sure = meet_probability(found, doubt, 0.9)
    fresh = draw_builds(one, CalibrationTransfer(), spec.entries.tolerance, 1024, 1)
    assert estimate_probability(found.problem, found.optimum.z, fresh) < 0.5
    # Four standard errors of a probability from the draws it was found on.
    assert estimate_probability(one, sure.optimum.z, fresh) > 0.9 - 4 * np.sqrt(0.9 * 0.1 / 256)
    assert sure.optimum.log_objective > found.optimum.log_objective


@pytest.mark.slow
def test_a_front_is_the_best_of_all_choices_at_each_cap():
    _, problems = posed(changed("threads", "counts", to=[48, 96]) | {"minimise": "diameter"})
    tried, _ = search_choices(problems, starts=2, seed=0)
    found = compute_front(tried, "pressure")
    assert len(found.values) > 5
    assert (np.diff(found.values, axis=0) * [1, -1] > 0).all()
    for least, cap in found.values[1:-1:2]:
        each = [
            search_optimum(one.problem.copy_with(caps={"pressure": cap}), one.optimum.z)
            for one in tried
            if one.optimum
        ]
        best = min(np.exp(answer.log_objective) for answer in each if answer.is_feasible)
        assert least <= best * (1 + 1e-6)


@pytest.mark.slow
def test_a_calibrated_muscle_hands_on_its_materials(tmp_path):
    design = pamjax.size(SPEC, margins=False)
    save_design(design, tmp_path)
    path = tmp_path / "model.json"
    text = path.read_text()
    shear = float(design.problem.build.shear)
    path.write_text(
        text.replace(f'"bladder_elasticity.modulus": {shear}', f'"bladder_elasticity.modulus": {1.2 * shear}')
    )
    spec = read_spec(SPEC)
    words = Calibration(muscle="model.json", discrepancy="2 %")
    handed = transfer_calibration(words, tmp_path, "spec.toml", spec.threads, spec.bladders)
    agree(handed.thread_modulus, design.problem.build.modulus, SOLVED)
    agree(handed.shear, 1.2 * shear, SOLVED)
    assert handed.discrepancy == pytest.approx(0.02)
    _, (one,) = posed(SPEC, handed)
    agree(one.build.shear, 1.2 * shear, SOLVED)
    doubt = draw_builds(one, handed, spec.entries.tolerance, 64, 0)
    assert np.ptp(doubt.build.shear) == 0
    assert np.ptp(doubt.build.strength) > 0
    assert doubt.build.force_error.std() == pytest.approx(0.02, rel=0.5)
    (rubber,), (thread,) = (
        design.bench.find_mechanisms(BladderElasticity),
        design.bench.find_mechanisms(BraidElasticity),
    )
    agree(rubber.length, design.numbers["rest_length"], SOLVED)
    agree(
        1 / float(thread.compliance),
        72 * design.numbers["thread_area"] * design.problem.build.modulus,
        SOLVED,
    )


@pytest.mark.slow
def test_a_muscle_from_nowhere_is_refused(tmp_path):
    spec = read_spec(SPEC)
    with pytest.raises(pamjax.BadInput, match="there is no file"):
        transfer_calibration(
            Calibration(muscle="no.json"), tmp_path, "spec.toml", spec.threads, spec.bladders
        )
    with pytest.raises(pamjax.BadInput, match="a calibration names a `muscle`"):
        transfer_calibration(Calibration(), tmp_path, "spec.toml", spec.threads, spec.bladders)

"""The optimisation: exact slopes, multipliers as shadow prices, two solvers, and infeasible specs."""

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
from pamjax.sizing.specification.schema import Calibration
from pamjax.sizing.specification.spec import read_spec
from pamjax.sizing.tolerances import BuildErrors
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

#: Relative change of a bound, and tolerance of the linear prediction of its effect (a curvature of one).
CHANGE, CURVATURE_TOLERANCE = 0.01, 0.02


def build_problems(entries, transfer=None):
    spec = read_spec(entries)
    task = build_task(spec)
    return spec, [
        build_problem(spec, task, choice, transfer or CalibrationTransfer()) for choice in list_choices(spec)
    ]


def solve(entries):
    _, problems = build_problems(entries)
    results, _ = search_choices(problems, starts=4, seed=0)
    assert results[0].optimum is not None
    return results[0]


@pytest.fixture(scope="module")
def result():
    return solve(SPEC)


def change_entry(*path, to):
    entries = copy.deepcopy(SPEC)
    table = entries
    for key in path[:-1]:
        table = table[key]
    table[path[-1]] = to
    return entries


@pytest.mark.slow
def test_slopes_are_exact(result):
    problem, z = result.problem, result.optimum.z + 0.01 * (0.5 - result.optimum.z)
    _, slope, _, slopes = problem.evaluate(z)
    for k in range(z.size):
        step = np.zeros(z.size)
        step[k] = 1e-5
        above, below = problem.evaluate(z + step), problem.evaluate(z - step)
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
def test_multiplier_predicts_the_effect_of_a_changed_bound(result, key, path, to, sign):
    from pamjax.sizing.sensitivity import compute_requirement_sensitivities

    by_key = {
        sensitivity.requirement.key: sensitivity.percent_saved
        for sensitivity in compute_requirement_sensitivities(result.problem, result.optimum)
    }
    changed_result = solve(change_entry(*path, to=to))
    change = (changed_result.optimum.log_objective - result.optimum.log_objective) / CHANGE
    if key == "supply":
        # The supply pressure also loads threads and mesh at rest length, which reduces the effect.
        assert -by_key[key] - CURVATURE_TOLERANCE <= change <= CURVATURE_TOLERANCE
    else:
        agree(sign * by_key.get(key, 0.0), change, CURVATURE_TOLERANCE, scale=1.0)


@pytest.mark.slow
def test_trust_constr_agrees_with_slsqp(result):
    other = search_optimum(result.problem, np.clip(result.optimum.z, 0.02, 0.98), "trust-constr")
    assert other.is_feasible
    agree(other.log_objective, result.optimum.log_objective, 1e-4)


@pytest.mark.slow
def test_relaxation_makes_an_infeasible_spec_feasible():
    entries = change_entry("force", 0, "at_least", to="9 kN")
    design = pamjax.size(entries, stock=False)
    assert not design.feasible
    assert "no muscle of this catalogue meets all requirements" in str(design)
    by_key = {relaxation.requirement.key: relaxation for relaxation in design.relaxations}
    relaxed_force = by_key["force 1"].relaxed_bound
    assert 400 < relaxed_force < 9000
    for share, feasible in ((0.98, True), (1.02, False)):
        relaxed_entries = change_entry("force", 0, "at_least", to=f"{share * relaxed_force:.6f} N")
        assert pamjax.size(relaxed_entries, inelastic_and_front=False, stock=False).feasible == feasible


@pytest.mark.slow
def test_nearest_muscle_has_an_equilibrium():
    entries = change_entry("force", 0, "at_least", to="900 N") | {
        "supply": {"pressure": "400 kPa"},
        "envelope": {"length": "180 mm", "fittings": "12 mm", "diameter": "15 mm"},
        "threads": {"kinds": "aramid", "counts": 48, "diameters": "0.2 mm"},
        "bladders": {"kinds": "silicone"},
    }
    design = pamjax.size(entries, stock=False)
    assert not design.feasible
    assert design.output("unsolved") == 0
    by_key = {relaxation.requirement.key: relaxation for relaxation in design.relaxations}
    assert 50 < by_key["force 1"].relaxed_bound < 900
    relaxed_force = f"{0.95 * by_key['force 1'].relaxed_bound:.6f} N"
    relaxed_entries = change_entry("force", 0, "at_least", to=relaxed_force)
    assert pamjax.size(
        entries | {"force": relaxed_entries["force"]}, inelastic_and_front=False, stock=False
    ).feasible


@pytest.mark.slow
def test_relaxed_length_includes_the_fittings():
    entries = {
        "supply": {"pressure": "2 bar"},
        "stroke": {"length": "80 mm", "load": "100 N"},
        "envelope": {"length": "300 mm", "fittings": "40 mm"},
        "threads": {"kinds": "aramid", "counts": 144, "diameters": "0.3 mm"},
        "bladders": {"kinds": "latex"},
        "parallel": [2],
        "probability": 0,
    }
    relaxations = pamjax.size(entries, stock=False).relaxations
    relaxation = next(item for item in relaxations if item.requirement.key == "length")
    assert relaxation.relaxed_bound > 0.3
    for share, feasible in ((0.99, False), (1.01, True)):
        envelope = {"length": f"{1e3 * share * relaxation.relaxed_bound:.3f} mm", "fittings": "40 mm"}
        assert (
            pamjax.size(entries | {"envelope": envelope}, inelastic_and_front=False, stock=False).feasible
            == feasible
        )


@pytest.mark.slow
def test_required_probability_holds_on_independent_draws(result):
    _, (problem,) = build_problems(SPEC)
    errors = BuildErrors(thread_length=0.5e-3, turns=0.01)
    draws = draw_builds(problem, CalibrationTransfer(), errors, 256, 0)
    assured, _ = meet_probability(result, draws, 0.9)
    independent_draws = draw_builds(problem, CalibrationTransfer(), errors, 1024, 1)
    assert estimate_probability(result.problem, result.optimum.z, independent_draws) < 0.5
    # Four standard errors of a probability that is estimated from 256 draws.
    probability = estimate_probability(problem, assured.optimum.z, independent_draws)
    assert probability > 0.9 - 4 * np.sqrt(0.9 * 0.1 / 256)
    assert assured.optimum.log_objective > result.optimum.log_objective


@pytest.mark.slow
def test_front_is_the_optimum_over_all_choices_under_each_cap():
    _, problems = build_problems(change_entry("threads", "counts", to=[48, 96]) | {"minimise": "diameter"})
    results, _ = search_choices(problems, starts=2, seed=0)
    front = compute_front(results, "pressure")
    assert len(front.values) > 5
    assert (np.diff(front.values, axis=0) * [1, -1] > 0).all()
    for diameter, cap in front.values[1:-1:2]:
        optima = [
            search_optimum(result.problem.copy_with(caps={"pressure": cap}), result.optimum.z)
            for result in results
            if result.optimum
        ]
        best = min(np.exp(optimum.log_objective) for optimum in optima if optimum.is_feasible)
        assert diameter <= best * (1 + 1e-6)


@pytest.mark.slow
def test_materials_of_a_calibrated_muscle_are_transferred(tmp_path):
    design = pamjax.size(SPEC, inelastic_and_front=False, stock=False)
    save_design(design, tmp_path)
    path = tmp_path / "model.json"
    text = path.read_text()
    shear = float(design.problem.build.shear)
    path.write_text(
        text.replace(f'"bladder_elasticity.modulus": {shear}', f'"bladder_elasticity.modulus": {1.2 * shear}')
    )
    spec = read_spec(SPEC)
    calibration = Calibration(muscle="model.json", discrepancy="2 %")
    transfer = transfer_calibration(calibration, tmp_path, "spec.toml", spec.threads, spec.bladders)
    agree(transfer.thread_modulus, design.problem.build.modulus, SOLVED)
    agree(transfer.shear, 1.2 * shear, SOLVED)
    assert transfer.discrepancy == pytest.approx(0.02)
    _, (problem,) = build_problems(SPEC, transfer)
    agree(problem.build.shear, 1.2 * shear, SOLVED)
    draws = draw_builds(problem, transfer, BuildErrors(), 64, 0)
    assert np.ptp(draws.build.shear) == 0
    assert np.ptp(draws.build.strength) > 0
    assert draws.build.force_error.std() == pytest.approx(0.02, rel=0.5)
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
def test_calibration_without_a_file_is_refused(tmp_path):
    spec = read_spec(SPEC)
    with pytest.raises(pamjax.BadInput, match=r"no\.json does not exist"):
        transfer_calibration(
            Calibration(muscle="no.json"), tmp_path, "spec.toml", spec.threads, spec.bladders
        )
    with pytest.raises(pamjax.BadInput, match="a calibration needs a `muscle`"):
        transfer_calibration(Calibration(), tmp_path, "spec.toml", spec.threads, spec.bladders)

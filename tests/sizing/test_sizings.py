"""Three example sizings: compared with a grid search of another program, and with simulations."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

import pamjax
from pamjax.infer.fitting.load import load_muscle
from pamjax.model.bench import record_bench
from pamjax.model.history import build_time_history
from pamjax.sizing import chance_constraints as chance
from pamjax.sizing.candidate import evaluate_many
from pamjax.sizing.io import build_design_document, save_design
from pamjax.sizing.problem import compute_bounds
from tests.agreement import KEPT, SOLVED, ZOOMED, agree
from tests.benchmarks.keep import arguments, keep
from tests.sizing import by_grid

HOME = Path(__file__).parents[2] / "fits" / "sizing"
NAMES = ("elbow-orthosis", "lift-2kN", "gripper-3mm")
#: Names of the specs whose design reaches the required probability.
REACHED = {"elbow orthosis", "2 kN lift", "3 mm gripper"}


@pytest.fixture(scope="module", params=NAMES)
def design(request):
    return pamjax.size(
        read_smaller_spec(request.param),
        starts=3,
        inelastic_and_front=request.param == "lift-2kN",
        stock=False,
    )


def read_smaller_spec(name):
    """Return an example with at most two thread counts and diameters; the chosen muscle is the same."""
    entries = tomllib.loads((HOME / f"{name}.toml").read_text("utf-8"))
    threads = entries["threads"]
    return entries | {"threads": threads | {key: threads[key][-2:] for key in ("counts", "diameters")}}


def compare_with_grid(design):
    """Return ln(objective) of the search and of the grid, and the grid's largest violation."""
    problem, entries = design.problem, design.spec.entries
    low, high, _ = compute_bounds(design.spec, design.task, design.choice)
    value = design.chosen_result.optimum.log_objective
    if entries.probability:
        # The grid has no chance constraints: compare it with the search without them.
        value = next(
            result.optimum for result in design.results if result.problem.choice == design.choice
        ).log_objective
    ends = [np.where([1, 0, 1, 1, 1], np.exp(x), x) for x in (low, high)]
    _, grid_value, violation = by_grid.best(entries, problem.build, design.spec.supply, *ends)
    return value, grid_value, violation


@pytest.mark.slow
def test_search_agrees_with_a_grid_of_another_program(design):
    assert design.feasible
    value, grid_value, violation = compare_with_grid(design)
    assert violation < KEPT
    # The grid may be worse than the search by its resolution.
    assert value - KEPT * 30 <= grid_value <= value + ZOOMED


@pytest.mark.slow
def test_simulated_muscle_meets_the_requirements(design, tmp_path):
    save_design(design, tmp_path)
    loaded = load_muscle(tmp_path / "model.json")
    document = json.loads((tmp_path / "design.json").read_text())
    places = [place for place in document["points"] if place["required_force"] is not None]
    pressure, length = (np.array([place[key] for place in places]) for key in ("pressure", "length"))
    history = build_time_history(None, np.ones(len(places), dtype=bool))
    simulated = record_bench(loaded.muscle, pressure, length, history)
    assert (np.asarray(simulated.status) == 0).all()
    force = design.choice.parallel * np.asarray(simulated.force)
    agree(force, [place["force"] for place in places], SOLVED * 100)
    wanted = np.array([place["required_force"] for place in places])
    assert (force >= wanted - KEPT * np.maximum(wanted, force.max())).all()
    muscle_toml = load_muscle(tmp_path / "muscle").muscle_toml
    assert muscle_toml.thread_length.value == pytest.approx(design.numbers["thread_length"])


@pytest.mark.slow
def test_design_is_stationary_and_its_report_is_short(design):
    assert design.chosen_result.optimum.stationarity < 1e-6
    assert len(str(design).splitlines()) < 25
    assert design.spec.name in str(design)
    json.dumps(build_design_document(design), allow_nan=False)
    objectives = [result.optimum.log_objective for result in design.results if result.optimum is not None]
    assert (np.diff(objectives) >= 0).all()


@pytest.mark.slow
def test_required_probability_is_reached_also_in_fresh_draws(design):
    target = design.spec.entries.probability
    assert target == 0.9
    assert (design.probability >= target) == (design.spec.name in REACHED)
    assert design.misses_probability == (design.spec.name not in REACHED)
    fresh_draws = chance.draw_builds(
        design.problem, design.transfer, design.errors, chance.REPORT_DRAWS, design.seed + 100
    )
    fresh = chance.estimate_probability(design.problem, design.z, fresh_draws)
    standard_error = chance.compute_standard_error(design.probability)
    if design.spec.name in REACHED:
        assert fresh >= target - 4 * standard_error
    # The reported draws selected nothing, so that both estimates differ by their errors only.
    assert abs(fresh - design.probability) < 4 * np.sqrt(2) * standard_error


@pytest.mark.slow
def test_errors_of_the_inelastic_assumption_decrease_with_stiffness(design):
    """The stiffer the thread, the smaller the errors of force and diameter; the Pareto front is monotonic."""
    if not design.inelastic_errors:
        return
    by_thread = {error.thread: error for error in design.inelastic_errors}
    assert (
        by_thread["nylon"].missing_force
        > by_thread["pet"].missing_force
        > by_thread["aramid"].missing_force
        > 0
    )
    assert by_thread["nylon"].excess_diameter > by_thread["aramid"].excess_diameter > 0
    front = design.front.values
    assert (np.diff(front[:, 0]) >= 0).all()
    assert (np.diff(front[:, 1]) <= 0).all()


@pytest.mark.slow
def test_force_of_the_design_agrees_with_its_outputs(design):
    problem = design.problem
    y = evaluate_many(
        problem.to_coordinates(design.z)[None],
        problem.build,
        problem.numbers,
        design.task.points,
        problem.ids,
    )[0]
    agree(y, design.outputs, SOLVED, scale=1e-9)
    place = build_design_document(design)["points"][1]
    force = design.force(place["pressure"], place["contraction"])
    agree(force, place["force"], SOLVED * 100)


if __name__ == "__main__":
    # python -m tests.sizing.test_sizings [--json FILE]: excess of the grid over the search.
    file, figures = arguments()[1], {}
    for name in NAMES:
        value, grid_value, violation = compare_with_grid(
            pamjax.size(HOME / f"{name}.toml", inelastic_and_front=False, stock=False)
        )
        excess = 100 * (np.exp(grid_value - value) - 1)
        figures[f"{name}, grid above search [%]"] = excess
        print(
            f"{name}: the grid is {excess:.2f} % above the search; its largest violation is {violation:.1e}"
        )
    keep(file, figures)

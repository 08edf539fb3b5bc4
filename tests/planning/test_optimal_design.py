"""Selected runs are as good as the best of all designs, which can be enumerated for a small menu."""

from itertools import product

import numpy as np
import pytest

from pamjax.planning.optimal_design import RunMenu, build_variance_criterion, build_volume_criterion
from tests.agreement import SOLVED, agree


def menu(seed, criterion, goal=0.0, budget=8.0):
    """Return five runs of one to three minutes and a direct reading, at two truths, for three parameters."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((6, 2, 4, 3)) * np.exp(rng.standard_normal((6, 1, 1, 3)))
    each = np.einsum("rtni,rtnj->rtij", rows, rows)
    once = np.arange(6) == 5
    each[5] = np.diag([0.0, 0.0, 60.0])
    minutes = np.array([1.0, 1.5, 2.0, 2.5, 3.0, 3.0])
    return RunMenu(np.broadcast_to(np.eye(3), (2, 3, 3)), each, minutes, once, criterion, budget, goal)


def list_designs(run_menu):
    """Return every design within the budget."""
    most = [
        1 if once else int(run_menu.budget / m)
        for once, m in zip(run_menu.once_only, run_menu.minutes, strict=True)
    ]
    for counts in product(*(range(k + 1) for k in most)):
        if np.dot(counts, run_menu.minutes) <= run_menu.budget + 1e-9:
            yield np.array(counts)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    "criterion", [build_variance_criterion(0), build_volume_criterion([0, 1])], ids=["c", "D"]
)
def test_selection_is_nearly_the_best_design(seed, criterion):
    run_menu = menu(seed, criterion)
    chosen = run_menu.choose_runs()
    assert chosen @ run_menu.minutes <= run_menu.budget + 1e-9
    assert np.all(chosen[run_menu.once_only] <= 1)
    best = min(run_menu.compute_criterion(counts) for counts in list_designs(run_menu))
    assert best - 1e-12 <= run_menu.compute_criterion(chosen) <= 1.1 * best
    # Negative control: a design that repeats one run is much worse.
    assert (
        max(
            run_menu.compute_criterion(counts)
            for counts in list_designs(run_menu)
            if counts @ run_menu.minutes > 7
        )
        > 1.5 * best
    )


@pytest.mark.parametrize("seed", range(5))
def test_goal_is_reached_in_nearly_the_shortest_time(seed):
    free = menu(seed, build_variance_criterion(0))
    goal = 1.5 * min(free.compute_criterion(counts) for counts in list_designs(free))
    run_menu = menu(seed, build_variance_criterion(0), goal=goal)
    chosen = run_menu.choose_runs()
    assert run_menu.compute_criterion(chosen) <= goal
    fewest = min(
        c @ run_menu.minutes for c in list_designs(run_menu) if run_menu.compute_criterion(c) <= goal
    )
    assert chosen @ run_menu.minutes <= fewest + 1.0


def test_criteria_are_means_over_the_true_parameters():
    run_menu = menu(0, build_variance_criterion(1))
    information = run_menu.compute_information(np.array([1, 0, 2, 0, 0, 1]))
    inverse = [np.linalg.inv(matrix) for matrix in information]
    agree(build_variance_criterion(1)(information), np.mean([c[1, 1] for c in inverse]), SOLVED)
    volume = np.mean([np.log(np.linalg.det(c[:2, :2])) for c in inverse])
    agree(build_volume_criterion([0, 1])(information), np.exp(volume / 2), SOLVED)

"""Function `size`: design of a muscle from a spec."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pamjax.errors import BadInput, check_minimum, suggest_word
from pamjax.progress import Progress, ignore_progress
from pamjax.sizing import chance_constraints as chance
from pamjax.sizing import sensitivity
from pamjax.sizing.assure import Finalist, assure_probability
from pamjax.sizing.calibration import CalibrationTransfer, transfer_calibration
from pamjax.sizing.enumerate import ChoiceResult, search_choices
from pamjax.sizing.inelastic import compute_inelastic_errors
from pamjax.sizing.infeasible import find_conflict
from pamjax.sizing.optimise import METHODS
from pamjax.sizing.pareto import compute_front, select_second_objective
from pamjax.sizing.problem import build_problem, list_choices
from pamjax.sizing.requirements import SizingTask, build_task
from pamjax.sizing.result import Design
from pamjax.sizing.specification.spec import Spec, read_spec
from pamjax.sizing.stock import search_stock


def size(
    spec: str | Path | Mapping[str, Any],
    *,
    starts: int = 8,
    method: str = "slsqp",
    seed: int = 0,
    inelastic_and_front: bool = True,
    stock: bool = True,
    progress: Progress = ignore_progress,
) -> Design:
    """Return the geometry and material of a muscle that meets the requirements of a spec.

    All requirements hold together with the `probability` of the spec, by default 0.9.

    Args:
        spec: a TOML file, or a mapping with the same entries.
        starts: number of starting points for each of the best choices.
        method: "slsqp", or "trust-constr", which also uses exact second derivatives.
        seed: seed of the screening and of the random draws.
        stock: whether to use tubes and yarns of sizes that are sold; otherwise any diameter and wall.
        inelastic_and_front: whether to compute the errors of the inelastic assumption, and the front of two
            objectives.
        progress: called with the current step and the completed fraction.

    Returns:
        the design; if no muscle meets the spec, the nearest one with the necessary relaxations.

    Raises:
        BadInput: if the spec is invalid.

    >>> design = size(
    ...     {
    ...         "supply": {"pressure": "6 bar"},
    ...         "force": [{"at_least": "300 N", "contraction": 0.1}],
    ...         "envelope": {"length": "250 mm"},
    ...         "threads": {"kinds": "aramid", "counts": 48, "diameters": "0.3 mm"},
    ...         "bladders": {"kinds": "latex"},
    ...     },
    ...     inelastic_and_front=False,
    ...     stock=False,
    ... )
    >>> design.feasible, design.probability >= 0.9
    (True, True)
    """
    if method not in METHODS:
        raise BadInput.from_rule(
            f"`method` must be {' or '.join(METHODS)}", f"{method!r}", remedy=suggest_word(method, METHODS)
        )
    check_minimum("starts", starts, 1)
    check_minimum("seed", seed, 0)
    parsed_spec = read_spec(spec, stock)
    task = build_task(parsed_spec)
    transfer = transfer_calibration(
        parsed_spec.entries.calibration,
        parsed_spec.folder,
        parsed_spec.file,
        parsed_spec.threads,
        parsed_spec.bladders,
    )
    problems = [build_problem(parsed_spec, task, choice, transfer) for choice in list_choices(parsed_spec)]
    results, unsearched_count = search_choices(
        problems, starts=starts, seed=seed, method=method, progress=progress
    )
    if results[0].optimum is None:
        return _build_infeasible_design(parsed_spec, task, transfer, results, unsearched_count, seed, method)
    return _build_feasible_design(
        parsed_spec, task, transfer, results, unsearched_count, seed, method, inelastic_and_front, progress
    )


def _build_infeasible_design(
    spec: Spec,
    task: SizingTask,
    transfer: CalibrationTransfer,
    results: Sequence[ChoiceResult],
    unsearched_count: int,
    seed: int,
    method: str,
) -> Design:
    nearest_result, relaxations = find_conflict(results)
    return Design(
        spec,
        task,
        transfer,
        tuple(results),
        nearest_result,
        relaxations=tuple(relaxations),
        unsearched_count=unsearched_count,
        seed=seed,
        method=method,
    )


def _build_feasible_design(
    spec, task, transfer, results, unsearched_count, seed, method, inelastic_and_front, progress
) -> Design:
    entries = spec.entries
    pool, nominal = [result for result in results if result.optimum is not None], results[0]
    if spec.stock:
        stock_pool = search_stock(pool, spec, task, transfer, seed, progress)
        pool, misses_stock = stock_pool or pool, not stock_pool
    else:
        misses_stock = False
    has_sold_parts = spec.stock and not misses_stock
    finalists = [Finalist(result) for result in pool]
    if entries.probability:
        finalists = assure_probability(pool, transfer, spec, seed, progress)
    best_result = finalists[0].result
    optimum = best_result.optimum
    assert optimum is not None
    z = optimum.z
    errors = chance.choose_problem_errors(best_result, entries.tolerance)
    draws = chance.draw_reported_builds(best_result.problem, transfer, errors, seed)
    probability = chance.estimate_probability(best_result.problem, z, draws)
    if entries.probability:
        # The probability that selected this choice is too high, because the selection used it.
        finalists[0] = Finalist(best_result, probability)
    design = Design(
        spec,
        task,
        transfer,
        tuple(results),
        best_result,
        probability=probability,
        requirement_probabilities=chance.estimate_probabilities(best_result.problem, z, draws),
        requirement_sensitivities=tuple(
            sensitivity.compute_requirement_sensitivities(best_result.problem, optimum)
        ),
        property_sensitivities=sensitivity.compute_property_sensitivities(best_result.problem, optimum),
        active_limits=tuple(sensitivity.list_active_limits(best_result.problem, optimum)),
        unsearched_count=unsearched_count,
        seed=seed,
        method=method,
        misses_probability=probability < entries.probability,
        misses_stock=misses_stock,
        errors=errors,
        nominal=nominal,
        nominal_stock=pool[0] if has_sold_parts else None,
        finalists=tuple(finalists),
        choice_count=len(pool) if has_sold_parts else len(results),
        force_sds=chance.estimate_force_sds(best_result.problem, z, draws),
    )
    if not inelastic_and_front:
        return design
    progress("inelastic threads", 0.5)
    inelastic_errors = compute_inelastic_errors(spec, task, transfer, design.choice, seed)
    progress("two objectives", 0.9)
    best = [finalist.result for finalist in finalists if finalist.reaches(entries.probability)]
    pareto_front = compute_front(
        best or [best_result], select_second_objective(entries.minimise, entries.against)
    )
    return replace(design, inelastic_errors=tuple(inelastic_errors), front=pareto_front)

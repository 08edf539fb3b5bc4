"""Fit of a muscle to its recordings: `fit` returns a `result.Fit`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from pamjax.errors import check_minimum
from pamjax.infer.fitting.build_result import build_case_fit, build_estimates
from pamjax.infer.fitting.covariance import compute_sd_and_correlation
from pamjax.infer.fitting.cross_validation import cross_validate
from pamjax.infer.fitting.form_errors import FormSizes, check_form_errors, fit_form_errors
from pamjax.infer.fitting.joint_space import build_joint_space, choose_law, collect_meanings
from pamjax.infer.fitting.least_squares import (
    Loss,
    Solution,
    exchange_priors,
    inflate_information,
    solve_least_squares,
)
from pamjax.infer.fitting.prior_bounds import find_limits, solve_within_limits
from pamjax.infer.fitting.result import Fit
from pamjax.infer.fitting.reweight import (
    add_whitening,
    compute_mean_square,
    reweight_dataset,
    set_variance_inflation,
)
from pamjax.infer.problem.dataset import (
    Dataset,
    build_dataset,
)
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.infer.problem.prior_limits import MIN_MISFIT_MEAN_SQUARE
from pamjax.model.assembly import resolve_bench_law
from pamjax.model.registry import check_exclusive_pairs
from pamjax.progress import Progress, ignore_progress
from pamjax.records.blocks import find_blocks
from pamjax.records.case import Case, ensure_case
from pamjax.records.fixed_length import average_fixed_lengths

#: Two starts agree if their costs differ by less than this; a residual of one standard deviation costs 0.5.
_COST_TOLERANCE = 0.01

#: Maximum number of repeated fits with the noise of the previous residuals. The weights change the fit, and
#: so the residuals; with a large misfit, the iteration converges slowly.
_MAX_REWEIGHTINGS = 12

#: The repeats end when no channel's weight changes by more than this fraction.
_WEIGHT_TOLERANCE = 0.02


def fit(
    cases: Case | str | Path | Sequence[Case | str | Path],
    law: str | None = None,
    share: Sequence[str] = (),
    mechanisms: Sequence[str] = (),
    *,
    form_error: bool = False,
    loss: Loss = "square",
    starts: int = 4,
    fold_count: int = 5,
    seed: int = 0,
    progress: Progress = ignore_progress,
) -> Fit:
    """Return the calibration of a muscle on a recording, or of several muscles on several recordings.

    A parameter stated with a standard deviation is free, with a Gaussian prior. A parameter stated without
    one is fixed. The fit has no zero and gain errors of the rig, unless `mechanisms` includes them.

    Args:
        cases: one case or several, or their folders.
        law: thread law, a key of `THREAD_LAWS`; None uses the baseline of each muscle.toml.
        share: names of parameters that all cases have in common, such as "thread.modulus".
        mechanisms: ids of mechanisms in addition to the threads, such as "bladder_elasticity".
        form_error: whether real effects may differ from the equations of `mechanisms`.
        loss: "square", or "soft", which reduces the weight of outliers.
        starts: number of starting points of the minimiser.
        fold_count: number of folds of the cross-validation.
        seed: seed of the starting points and of the folds.
        progress: called with the current step and the completed fraction.

    Returns:
        the `Fit`; `print` shows its summary, `to_frame` returns its estimates as a table.

    Raises:
        BadInput: for an unknown law, an unknown shared parameter, a recording without force and diameter, or
            `form_error` without a mechanism that has one.

    Example:
        fit = pamjax.fit("mine", mechanisms=["bladder_elasticity"])
        print(fit)
        modulus = fit.estimates["thread.modulus"].value  # Pa
    """
    cases = _read_cases(cases)
    _check_counts(starts, fold_count, seed)
    law = choose_law(cases, law)
    if mechanisms:
        check_exclusive_pairs(mechanisms)
        law = resolve_bench_law(law, mechanisms)
    if form_error:
        check_form_errors(mechanisms, loss)
    space, renames = build_joint_space(cases, law, share, mechanisms)
    datasets = tuple(
        add_whitening(c, build_dataset(c, law, space, r, mechanisms))
        for c, r in zip(cases, renames, strict=True)
    )
    progress("fit, step 1 of 4: first fit", 0.0)
    solution = solve_least_squares(datasets, space, jnp.zeros(space.size), loss)
    datasets, solution = _estimate_weights(cases, datasets, space, solution, loss, progress)
    progress("fit, step 3 of 4: other starts", 0.5)
    agreeing_starts, best = _run_other_starts(datasets, space, solution, loss, starts, seed)
    if best is not solution:
        # The weights belong to the first solution.
        datasets, _ = reweight_datasets(cases, datasets, space, best, loss)
        best = solve_least_squares(datasets, space, best.u, loss)
    form_sizes: Sequence[FormSizes | None] = [None] * len(cases)
    if form_error:
        progress("form errors", 0.55)
        datasets, form_sizes, best = fit_form_errors(
            cases, datasets, space, best, lambda d, solution: reweight_datasets(cases, d, space, solution)[0]
        )
    datasets, fixed_space, solution = _limit_stated_values(cases, datasets, space, renames, best, loss)
    blocks_of_cases = [find_blocks(case.recording) for case in cases]
    folds, predictions = cross_validate(
        cases, datasets, blocks_of_cases, fixed_space, solution, loss, fold_count, seed,
        lambda fraction: progress("fit, step 4 of 4: cross-validation", 0.6 + 0.4 * fraction),
    )  # fmt: skip
    _, noise = reweight_datasets(cases, datasets, space, solution, loss)
    datasets, solution, at_limit = _quantify_uncertainty(datasets, space, fixed_space, solution, loss)
    sd, correlation = compute_sd_and_correlation(solution.total_information, solution.slope)
    progress("done", 1.0)
    return Fit(
        law=law,
        mechanisms=tuple(mechanisms),
        estimates=build_estimates(
            space, solution, sd, at_limit, collect_meanings(cases, law, renames, mechanisms)
        ),
        correlation=correlation,
        cases=tuple(
            build_case_fit(space, solution, *of_case)
            for of_case in zip(
                cases, datasets, noise, blocks_of_cases, folds, predictions, form_sizes, strict=True
            )
        ),
        converged=bool(solution.converged),
        steps=int(solution.steps),
        agreeing_starts=agreeing_starts,
        starts=starts,
        loss=loss,
        seed=seed,
        space=space,
        solution=solution,
        datasets=datasets,
        limited_space=fixed_space,
    )  # fmt: skip


def _read_cases(cases: Case | str | Path | Sequence[Case | str | Path]) -> list[Case]:
    """Return one case or several, with their fixed lengths averaged."""
    return [
        average_fixed_lengths(ensure_case(case))
        for case in ([cases] if isinstance(cases, Case | str | Path) else cases)
    ]


def _estimate_weights(
    cases: Sequence[Case],
    datasets: tuple[Dataset, ...],
    space: ParameterSpace,
    solution: Solution,
    loss: Loss,
    progress: Progress,
) -> tuple[tuple[Dataset, ...], Solution]:
    """Return datasets and solution after repeated fits, each with the noise of the previous residuals."""
    for k in range(_MAX_REWEIGHTINGS):
        progress("fit, step 2 of 4: noise", 0.3 + 0.2 * k / _MAX_REWEIGHTINGS)
        previous = datasets
        datasets, _ = reweight_datasets(cases, datasets, space, solution, loss)
        # With the starting weights, a misfit can drive a parameter to its bound.
        solution = solve_least_squares(datasets, space, space.move_inside_bounds(solution.u), loss)
        if k and _have_weights_converged(previous, datasets):
            break
    return datasets, solution


def _have_weights_converged(previous: Sequence[Dataset], current: Sequence[Dataset]) -> bool:
    changes = [
        float(np.abs(_summarise_weights(b) - _summarise_weights(a)).max())
        for a, b in zip(previous, current, strict=True)
    ]
    return max(changes) < _WEIGHT_TOLERANCE


def _summarise_weights(dataset: Dataset) -> np.ndarray:
    """Return logarithms of the weights of the channels, and the correlations of their filters."""
    if dataset.whitening is None:
        return np.log(np.asarray(dataset.channel_weights))
    rows = dataset.rows
    means = [float(np.mean(np.asarray(w))) for w in (rows.force_weight, rows.diameter_weight)]
    return np.concatenate([np.log(np.maximum(means, 1e-300)), np.asarray(dataset.whitening.correlation)])


def _limit_stated_values(
    cases: Sequence[Case],
    datasets: tuple[Dataset, ...],
    space: ParameterSpace,
    renames: Sequence[Mapping[str, str]],
    solution: Solution,
    loss: Loss,
) -> tuple[tuple[Dataset, ...], ParameterSpace, Solution]:
    """Return datasets, space and solution with stated values near their priors where the model misses a case.

    A stated value moves further only if the model then explains the recording.
    """
    misfits = [compute_mean_square(dataset, space, solution, loss) for dataset in datasets]
    names = {
        name
        for mean_square, rename in zip(misfits, renames, strict=True)
        for name in rename.values()
        if mean_square > MIN_MISFIT_MEAN_SQUARE
    }
    low, high = limits = find_limits(space, names)
    values = np.asarray(space.to_values(solution.u))
    if ((values >= low) & (values <= high)).all():
        return datasets, space, solution
    for _ in range(2):
        _, solution = solve_within_limits(datasets, space, solution, limits, loss)
        datasets, _ = reweight_datasets(cases, datasets, space, solution, loss)
    return datasets, *solve_within_limits(datasets, space, solution, limits, loss)


def _find_fixed_names(space: ParameterSpace, fixed_space: ParameterSpace) -> list[str]:
    """Return the names of the parameters that are fixed at a limit."""
    is_fixed = np.asarray(space.sd) != np.asarray(fixed_space.sd)
    return [name for name, fixed in zip(space.names, is_fixed, strict=True) if fixed]


def _quantify_uncertainty(
    datasets: tuple[Dataset, ...],
    space: ParameterSpace,
    fixed_space: ParameterSpace,
    solution: Solution,
    loss: Loss,
) -> tuple[tuple[Dataset, ...], Solution, set[str]]:
    """Return datasets and solution for the standard deviations, and the names of parameters at a limit."""
    at_limit = {*space.find_names_at_bound(solution.u), *_find_fixed_names(space, fixed_space)}
    # A value at its limit was fixed by a narrow prior, which is no information on it.
    if fixed_space is not space:
        solution = exchange_priors(solution, fixed_space, space)
    return *_inflate_variances(datasets, space, solution, loss), at_limit


def _inflate_variances(
    datasets: tuple[Dataset, ...], space: ParameterSpace, solution: Solution, loss: Loss
) -> tuple[tuple[Dataset, ...], Solution]:
    """Return datasets and solution with variances that include systematic misfit."""
    if all(dataset.whitening is None for dataset in datasets):
        return datasets, solution
    datasets = tuple(set_variance_inflation(dataset, space, solution, loss) for dataset in datasets)
    return datasets, inflate_information(solution, datasets)


def _check_counts(starts: int, fold_count: int, seed: int) -> None:
    for name, value, minimum in (("starts", starts, 1), ("fold_count", fold_count, 2), ("seed", seed, 0)):
        check_minimum(name, value, minimum)


def reweight_datasets(cases, datasets, space, solution, loss: Loss = "square"):
    """Return every dataset with weights from its noise, and the noise; see `reweight_dataset`."""
    pairs = [
        reweight_dataset(case, dataset, space, solution, loss)
        for case, dataset in zip(cases, datasets, strict=True)
    ]
    return tuple(dataset for dataset, _ in pairs), [noise for _, noise in pairs]


def _run_other_starts(
    datasets, space: ParameterSpace, solution: Solution, loss: Loss, starts: int, seed: int
) -> tuple[int, Solution]:
    """Return the number of starts that agree with the best solution, and that solution."""
    solutions = [solution]
    for key in jax.random.split(jax.random.key(seed), max(starts - 1, 0)):
        solutions.append(solve_least_squares(datasets, space, jax.random.normal(key, (space.size,)), loss))
    costs = np.array([float(candidate.cost) for candidate in solutions])
    costs = np.where(np.isfinite(costs), costs, np.inf)
    best = int(np.argmin(costs))
    # The first solution is kept unless another is better by more than rounding.
    if costs[0] <= costs[best] + _COST_TOLERANCE:
        best = 0
    return int(np.sum(costs <= costs[best] + _COST_TOLERANCE)), solutions[best]

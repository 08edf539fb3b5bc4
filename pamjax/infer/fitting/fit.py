"""Fit a muscle to its recordings: `fit` is the verb, `result.Fit` what it returns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from pamjax.errors import BadInput, at_least, nearest, refuse
from pamjax.infer.fitting.cross_validation import hold_out
from pamjax.infer.fitting.least_squares import Loss, Solution, solve
from pamjax.infer.fitting.result import CaseFit, Estimate, Fit, HeldOut
from pamjax.infer.fitting.reweight import weigh
from pamjax.infer.problem.dataset import CHANNELS, Member, counts, member, read
from pamjax.infer.problem.parameter_space import Free, Space, space
from pamjax.infer.problem.priors import free_numbers
from pamjax.model.assembly import bench_law
from pamjax.model.balance import Status
from pamjax.model.parameters import LAWS
from pamjax.model.registry import not_twice
from pamjax.progress import Progress, silent
from pamjax.records.blocks import blocks
from pamjax.records.case import Case, as_case

#: Two starts agree if their costs differ by less than this (one standard deviation costs 0.5).
SAME_COST = 0.01

#: How often, at most, the noise is read off the residual and the fit repeated. Each shifts the balance of
#: data and priors, and so the residual; where a model misses much, the two settle slowly.
REWEIGH = 12

#: The repeats end when no channel's weight changes by more than this share.
SETTLED = 0.02


def fit(
    cases: Case | str | Path | Sequence[Case | str | Path],
    law: str | None = None,
    share: Sequence[str] = (),
    mechanisms: Sequence[str] = (),
    *,
    loss: Loss = "square",
    starts: int = 4,
    fold_count: int = 5,
    seed: int = 0,
    progress: Progress = silent,
) -> Fit:
    """Calibrate a muscle on a recording, or several muscles on several at once.

    Numbers that were measured with a standard deviation move under it as a prior; numbers stated
    without one are taken as known. Offsets and gains of the bench are never absorbed.

    Args:
        cases: one case or several, or their folders.
        law: thread law, a key of `catalogue.LAWS`; None takes each recording's baseline.
        share: names of numbers that all cases have in common, as "thread.modulus".
        mechanisms: ids of what acts beside the threads, as "bladder_elasticity".
        loss: "soft" bounds the pull of a sample that is far off.
        starts: number of places from which the minimiser starts.
        fold_count: into how many parts the blocks are dealt for the held-out score.
        seed: of the starts and of the deal.
        progress: called with what is being done and the share done.

    Raises:
        BadInput: for an unknown law, a shared name no case has, or a recording without a channel.
    """
    cases = [as_case(one) for one in ([cases] if isinstance(cases, Case | str | Path) else cases)]
    _countable(starts, fold_count, seed)
    law = _one_law(cases, law)
    if mechanisms:
        not_twice(mechanisms)
        law = bench_law(law, mechanisms)
    at, renames = joint_space(cases, law, share, mechanisms)
    members = tuple(member(c, law, at, r, mechanisms) for c, r in zip(cases, renames, strict=True))
    progress("first fit", 0.0)
    solution = solve(members, at, jnp.zeros(at.size), loss)
    for k in range(REWEIGH):
        progress("weighing the noise", 0.3 + 0.2 * k / REWEIGH)
        before = members
        members, _ = weigh_all(cases, members, at, solution, loss)
        # Before the noise is weighed a misfit can drive a number to a limit.
        solution = solve(members, at, at.inside(solution.u), loss)
        if k and _settled(before, members):
            break
    progress("other starts", 0.5)
    agreeing, best = _restart(members, at, solution, loss, starts, seed)
    if best is not solution:
        # Its noise was weighed at the end that it beat.
        members, _ = weigh_all(cases, members, at, best, loss)
        best = solve(members, at, best.u, loss)
    solution = best
    found = [blocks(case.recording) for case in cases]
    deals, unseen = hold_out(
        cases, members, found, at, solution, loss, fold_count, seed,
        lambda done: progress("held-out blocks", 0.6 + 0.4 * done),
    )  # fmt: skip
    _, noise = weigh_all(cases, members, at, solution, loss)
    sd, correlation = spread(solution)
    progress("done", 1.0)
    return Fit(
        law=law,
        mechanisms=tuple(mechanisms),
        estimates=_estimates(at, solution, sd, _meanings(cases, law, renames, mechanisms)),
        correlation=correlation,
        cases=tuple(
            _case_fit(at, solution, *of_case)
            for of_case in zip(cases, members, noise, found, deals, unseen, strict=True)
        ),
        converged=bool(solution.converged),
        steps=int(solution.steps),
        agreeing=agreeing,
        starts=starts,
        loss=loss,
        seed=seed,
        space=at,
        solution=solution,
        members=members,
    )  # fmt: skip


def _settled(before: Sequence[Member], after: Sequence[Member]) -> bool:
    changes = [np.abs(np.asarray(b.trust / a.trust) - 1).max() for a, b in zip(before, after, strict=True)]
    return max(changes) < SETTLED


def _countable(starts: int, fold_count: int, seed: int) -> None:
    for name, value, least in (("starts", starts, 1), ("folds", fold_count, 2), ("seed", seed, 0)):
        at_least(name, value, least)


def _one_law(cases: Sequence[Case], law: str | None) -> str:
    if not cases:
        raise refuse("a fit needs at least one case", "none")
    names = [case.name for case in cases]
    for name in names:
        if names.count(name) > 1:
            remedy = "Their numbers are told apart by the folder's name: rename one."
            raise refuse(
                "cases that are fitted together need names of their own", f"{name!r} twice", "", remedy
            )
    wanted = sorted({law or case.entry.baseline for case in cases})
    if len(wanted) > 1:
        raise refuse(
            "cases that are fitted together share one thread law",
            " and ".join(wanted),
            "[baseline] of muscle.toml",
            "Name one for all of them.",
        )
    if wanted[0] not in LAWS:
        raise refuse(f"{wanted[0]!r} is no thread law", remedy=nearest(wanted[0], LAWS))
    for case in cases:
        if not case.recording.channels:
            raise refuse(
                "a fit needs a measured force or diameter",
                "neither",
                f"{case.name}/recording.csv",
                "Add a column `force [N]` or `diameter [mm]`.",
            )
    return wanted[0]


def joint_space(
    cases: Sequence[Case], law: str, share: Sequence[str], mechanisms: Sequence[str] = ()
) -> tuple[Space, list[dict[str, str]]]:
    """One space for all cases, and for each case the name in it of each of its own numbers."""
    numbers: dict[str, Free] = {}
    renames: list[dict[str, str]] = []
    for case in cases:
        own = free_numbers(case, law, mechanisms)
        alone = len(cases) == 1
        rename = {n.name: n.name if alone or n.name in share else f"{case.name}/{n.name}" for n in own}
        for n in own:
            one = numbers.setdefault(rename[n.name], replace(n, name=rename[n.name]))
            if (one.start, one.sd) != (n.start, n.sd) and not one.sd == n.sd == math.inf:
                raise _told_twice(n.name, "another value or sd", case)
        renames.append(rename)
    known = sorted({name for rename in renames for name in rename})
    for name in share:
        if name not in known:
            raise refuse(f"no case can move {name!r}, so it cannot be shared", remedy=nearest(name, known))
        for case, rename in zip(cases, renames, strict=True):
            if name not in rename:
                raise _told_twice(name, "no sd, or no such number", case)
    if not numbers:
        raise refuse(
            "a fit needs a number that may move",
            "every number stated without `sd`",
            "muscle.toml",
            "Write at least one as {value = ..., sd = ...}.",
        )
    return space(list(numbers.values())), renames


def _told_twice(name: str, got: str, case: Case) -> BadInput:
    """What two cases share is one number, believed once: neither's belief may go unheard."""
    remedy = "State the same value and sd in each."
    return refuse(f"a shared number ({name}) must be stated alike", got, f"{case.name}/muscle.toml", remedy)


def weigh_all(cases, members, at, solution, loss: Loss = "square", trusting=False):
    """Every member with its samples weighed by their noise, and that noise; see `weigh`."""
    pairs = [weigh(case, one, at, solution, loss, trusting) for case, one in zip(cases, members, strict=True)]
    return tuple(one for one, _ in pairs), [noise for _, noise in pairs]


def _restart(
    members, at: Space, solution: Solution, loss: Loss, starts: int, seed: int
) -> tuple[int, Solution]:
    """Start again from draws of the prior; keep the best end and count those that agree with it."""
    ends = [solution]
    for key in jax.random.split(jax.random.key(seed), max(starts - 1, 0)):
        ends.append(solve(members, at, jax.random.normal(key, (at.size,)), loss))
    costs = np.array([float(end.cost) for end in ends])
    costs = np.where(np.isfinite(costs), costs, np.inf)
    best = int(np.argmin(costs))
    # The first end stays unless another is truly better: equal ends differ by rounding only.
    if costs[0] <= costs[best] + SAME_COST:
        best = 0
    return int(np.sum(costs <= costs[best] + SAME_COST)), ends[best]


def spread(solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations, SI, NaN where nothing is known, and correlations of the values."""
    both = np.asarray(solution.information + solution.prior)
    scale = np.sqrt(np.maximum(np.diag(both), 1e-300))
    # Scaled to a unit diagonal, an eigenvalue of rounding size is a direction nobody knows.
    weights, directions = np.linalg.eigh(both / np.outer(scale, scale))
    known = weights > 1e-12
    inverse = (directions[:, known] / weights[known]) @ directions[:, known].T
    unknown = (directions[:, ~known] ** 2).sum(axis=1) > 1e-6
    sd = np.sqrt(np.diag(inverse)) / scale * np.abs(np.asarray(solution.slope))
    # A number that sits at a limit tells nothing, and is correlated with nothing.
    root = np.sqrt(np.where(np.diag(inverse) > 0, np.diag(inverse), 1.0))
    correlation = inverse / np.outer(root, root) * np.sign(np.outer(solution.slope, solution.slope))
    return np.where(unknown, np.nan, sd), correlation


def _meanings(cases, law, renames, mechanisms):
    pairs = [
        (rename[n.name], n.meaning)
        for c, rename in zip(cases, renames, strict=True)
        for n in free_numbers(c, law, mechanisms)
    ]
    return dict(pairs)


def _estimates(at: Space, solution: Solution, sd: np.ndarray, meaning: Mapping) -> dict[str, Estimate]:
    values = np.asarray(at.values(solution.u))
    stuck = set(at.at_limit(solution.u))
    return {
        name: Estimate(
            value=float(values[k]),
            sd=float(sd[k]) if np.isfinite(sd[k]) and name not in stuck else None,
            prior=float(at.mean[k]),
            prior_sd=float(at.sd[k]),
            meaning=meaning[name],
            at_limit=name in stuck,
        )
        for k, name in enumerate(at.names)
    }


def _case_fit(at: Space, solution: Solution, case: Case, one: Member, noise, found, deal, unseen) -> CaseFit:
    values = at.values(solution.u)
    reading = read(one, values)
    n = case.recording.n
    status = np.asarray(reading.status)[:n]
    bad = case.recording.usable & (status != Status.OK)
    prediction = {c: np.asarray(getattr(reading, c))[:n] for c in CHANNELS}
    names = tuple(tuple(found.names[k] for k in np.unique(found.label[out]) if k >= 0) for out in deal)
    return CaseFit(
        case=case,
        numbers={name: float(number) for name, number in one.numbers(values).items()},
        muscle=one.muscle(values),
        prediction=prediction,
        unseen=unseen,
        block=[found.names[k] if k >= 0 else "" for k in found.label],
        rmse=rmse(case, prediction),
        noise=noise,
        held_out=HeldOut(found.kind, names, rmse(case, unseen)) if deal else None,
        failed={s: case.recording.row[bad & (status == s)] for s in Status if (bad & (status == s)).any()},
    )


def rmse(case: Case, prediction: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Root mean square of measured − predicted, SI, by channel, over the rows that count."""
    out = {}
    for channel in case.recording.channels:
        misfit = getattr(case.recording, channel) - prediction[channel]
        misfit = misfit[counts(case, channel) & np.isfinite(misfit)]
        if misfit.size:
            out[channel] = float(np.sqrt(np.mean(misfit**2)))
    return out

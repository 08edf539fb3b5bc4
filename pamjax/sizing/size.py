"""The verb: from what a muscle must do to the muscle that does it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pamjax.errors import at_least, nearest, refuse
from pamjax.progress import Progress, silent
from pamjax.sizing import chance_constraints as chance
from pamjax.sizing import sensitivity
from pamjax.sizing.calibration import Handed, hand_on
from pamjax.sizing.enumerate import Tried, best_of
from pamjax.sizing.inelastic import inelastic_costs
from pamjax.sizing.infeasible import conflict
from pamjax.sizing.optimise import METHODS
from pamjax.sizing.pareto import front, other
from pamjax.sizing.problem import choices, problem
from pamjax.sizing.requirements import Asked, ask
from pamjax.sizing.result import Design
from pamjax.sizing.spec import Spec, read_spec

#: Choices, the best first, that are made to hold with a probability.
MADE_SURE = 6


def size(
    spec: str | Path | Mapping[str, Any],
    *,
    starts: int = 8,
    method: str = "slsqp",
    seed: int = 0,
    margins: bool = True,
    progress: Progress = silent,
) -> Design:
    """Find the geometry and the material of a muscle that does what a spec wants.

    Args:
        spec: a TOML file, or its words as a mapping.
        starts: searches of each of the best choices.
        method: "slsqp", or "trust-constr", which also takes exact curvature.
        seed: of the first look, and of the draws.
        margins: whether to find the cost of the inelastic assumption, and the front of two objectives.
        progress: told what is being done, and the share of it that is.

    Raises:
        BadInput: in one sentence, if the spec cannot be read. A spec that cannot be met is an answer.

    >>> design = size(
    ...     {
    ...         "supply": {"pressure": "6 bar"},
    ...         "force": [{"at_least": "300 N", "contraction": 0.1}],
    ...         "envelope": {"length": "250 mm"},
    ...         "threads": {"kinds": "aramid", "counts": 48, "diameters": "0.3 mm"},
    ...         "bladders": {"kinds": "latex"},
    ...     },
    ...     margins=False,
    ... )
    >>> design.feasible, round(design.output("force", 1))
    (True, 300)
    """
    if method not in METHODS:
        raise refuse(f"a search is {' or '.join(METHODS)}", f"{method!r}", remedy=nearest(method, METHODS))
    at_least("starts", starts, 1)
    at_least("seed", seed, 0)
    read = read_spec(spec)
    asked = ask(read)
    handed = hand_on(read.words.calibration, read.folder, read.file, read.threads, read.bladders)
    every = [problem(read, asked, choice, handed) for choice in choices(read)]
    tried, left = best_of(every, starts=starts, seed=seed, method=method, progress=progress)
    if tried[0].answer is None:
        return _not_met(read, asked, handed, tried, left, seed, method)
    return _met(read, asked, handed, tried, left, seed, method, margins, progress)


def _not_met(
    spec: Spec, asked: Asked, handed: Handed, tried: Sequence[Tried], left: int, seed: int, method: str
) -> Design:
    nearest_one, gives = conflict(tried)
    return Design(
        spec, asked, handed, tuple(tried), nearest_one, gives=tuple(gives), left_out=left, seed=seed,
        method=method,
    )  # fmt: skip


def _met(spec, asked, handed, tried, left, seed, method, margins, progress) -> Design:
    words = spec.words
    best, unsure = [one for one in tried if one.answer is not None], False
    if words.probability:
        progress("probability", 0.0)
        sure = _sure(best[:MADE_SURE], handed, spec, seed)
        unsure, best = not sure, sure or best
    chosen, answer = best[0], best[0].answer
    assert answer is not None
    z = answer.z
    told = chance.draw(chosen.problem, handed, words.tolerance, chance.TOLD, seed + 1)
    design = Design(
        spec,
        asked,
        handed,
        tuple(tried),
        chosen,
        probability=chance.probability(chosen.problem, z, told),
        held=chance.by_requirement(chosen.problem, z, told),
        prices=tuple(sensitivity.prices(chosen.problem, answer)),
        properties=sensitivity.properties(chosen.problem, answer),
        limits=tuple(sensitivity.at_limits(chosen.problem, answer)),
        left_out=left,
        seed=seed,
        method=method,
        unsure=unsure,
    )
    if not margins:
        return design
    progress("inelastic threads", 0.5)
    costs = inelastic_costs(spec, asked, handed, design.choice, seed)
    progress("two objectives", 0.9)
    found = front(best, other(words.minimise, words.against))
    return replace(design, costs=tuple(costs), front=found)


def _sure(best: Sequence[Tried], handed: Handed, spec: Spec, seed: int) -> list[Tried]:
    """Those that can be made to hold with the probability that is wanted, the best first."""
    wanted = spec.words.probability
    assert wanted is not None
    found = []
    for one in best:
        doubt = chance.draw(one.problem, handed, spec.words.tolerance, chance.DRAWS, seed)
        held = chance.hold(one, doubt, wanted)
        if held is not None and held.answer is not None:
            found.append(held)
    found.sort(key=lambda one: one.answer.value if one.answer is not None else math.inf)
    return found

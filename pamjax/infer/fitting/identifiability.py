"""Which numbers a recording can determine, and which only together, in words.

Around a point the misfit is quadratic: its curvature is what the data know (information) plus what
was believed (prior). Measured in prior standard deviations, an eigenvector of the information is a
combination of numbers, and its eigenvalue says how many times better than the prior the recording
knows it. A combination with a small eigenvalue goes unnoticed; the sentence says how its numbers may
move together without anyone seeing it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from pamjax.infer.fitting.fit import joint_space, spread, weigh_all
from pamjax.infer.fitting.least_squares import linearise
from pamjax.infer.problem.dataset import member
from pamjax.infer.problem.parameter_space import Space
from pamjax.infer.problem.priors import is_ruler
from pamjax.model.parameters import meaning
from pamjax.records.case import Case, as_case
from pamjax.units import show

#: A number, or a combination, is determined if its standard deviation shrinks to this share of the prior's.
DETERMINED = 0.5
#: Where nothing was believed, a number's own size times this stands in for the prior's.
USEFUL = 0.3
#: Numbers with a smaller share than this in a combination are not named with it.
NAMED = 0.3


@dataclass(frozen=True)
class Determination:
    """What a recording can say of one number before it is fitted.

    Attributes:
        name: the number.
        before: standard deviation believed, SI; infinite for nothing.
        after: standard deviation expected after a fit, SI; NaN if it stays unknown.
        determined: whether the recording settles it by itself.
    """

    name: str
    before: float
    after: float
    determined: bool


def determine(case: Case | str | Path, law: str | None = None) -> tuple[list[Determination], list[str]]:
    """What a recording could determine, without fitting it.

    Uses the sensitivities at the stated values and the stated sensor noise; where no sensor is
    stated, a hundredth of the channel's range. Samples count as independent: this is the best case.

    Args:
        case: the recording and what is believed of its muscle, or their folder.
        law: thread law; None takes the case's baseline.

    Returns:
        one entry for each number with its standard deviation before and after, SI; and sentences.

    Raises:
        BadInput: for an unknown law, or a number that the law needs and muscle.toml does not have.
    """
    case = as_case(case)
    law = law or case.entry.baseline
    at, (rename,) = joint_space([case], law, ())
    members = (member(case, law, at, rename),)
    start = jnp.zeros(at.size)
    members, _ = weigh_all([case], members, at, linearise(members, at, start), trusting=True)
    solution = linearise(members, at, start)
    scale = _scale(at)
    sd, _ = spread(solution)
    found = [
        Determination(name, float(at.sd[k]), float(sd[k]), bool(sd[k] < DETERMINED * scale[k]))
        for k, name in enumerate(at.names)
        if not is_ruler(name)
    ]
    slope = np.asarray(solution.slope)
    known = np.asarray(solution.information) / np.outer(slope, slope)
    return found, _sentences(found, unnoticed(at.names, known, scale))


def _scale(at: Space) -> np.ndarray:
    """(p,) the step in which each number is measured: its prior's sd, or a share of its size; SI."""
    sd, mean = np.asarray(at.sd), np.asarray(at.mean)
    return np.where(np.isfinite(sd), sd, USEFUL * np.abs(mean))


def unnoticed(names: Sequence[str], information: np.ndarray, scale: np.ndarray) -> list[dict[str, float]]:
    """Combinations that a recording does not settle, each as moves of its numbers, SI.

    Args:
        names: (p,) of the numbers; the ruler's errors among them are given all the freedom of their prior.
        information: (p, p) what the data alone know of the numbers, 1/SI².
        scale: (p,) the step in which each number is measured, SI.
    """
    known = information * np.outer(scale, scale)
    own = np.array([not is_ruler(name) for name in names])
    eigenvalues, directions = np.linalg.eigh(_without_rulers(known, own))
    names = [name for name, keep in zip(names, own, strict=True) if keep]
    # One step of the prior and n of the data leave 1 / sqrt(1 + n²) of the step.
    weak = 1 / np.sqrt(1 + np.maximum(eigenvalues, 0)) > DETERMINED
    moves = (dict(zip(names, column * scale[own], strict=True)) for column in directions.T[weak])
    shares = directions.T[weak]
    return [
        {name: move for (name, move), share in zip(one.items(), column, strict=True) if abs(share) > NAMED}
        for one, column in zip(moves, shares, strict=True)
    ]


def _without_rulers(known: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Information on the muscle's numbers when the ruler's errors are as free as their prior lets them."""
    ruler = known[np.ix_(~own, ~own)] + np.eye(int((~own).sum()))
    across = known[np.ix_(own, ~own)]
    return known[np.ix_(own, own)] - across @ np.linalg.solve(ruler, across.T)


def _sentences(found: Sequence[Determination], combinations: Sequence[dict[str, float]]) -> list[str]:
    said = []
    settled = [f"`{d.name}`" for d in found if d.determined]
    if settled:
        said.append(f"This recording can determine {listed(settled)}, if the model lacks nothing.")
    return said + [words(moves) for moves in combinations]


def words(moves: dict[str, float]) -> str:
    """One combination that goes unnoticed, as a sentence."""
    if len(moves) == 1:
        (name,) = moves
        return f"The recording says little about `{name}`: the stated sd will still speak after a fit."
    together = listed([_move(*m) for m in moves.items()])
    return f"The recording knows some numbers only together: {together} would go unnoticed."


def _move(name: str, by: float) -> str:
    return f"`{name}` {'+' if by > 0 else ''}{show(by, meaning(name).show, 2)}"


def listed(words: Sequence[str]) -> str:
    """Words as "a, b and c"."""
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]

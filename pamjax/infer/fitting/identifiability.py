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

from pamjax.infer.fitting.fit import build_joint_space, compute_sd_and_correlation, reweight_datasets
from pamjax.infer.fitting.least_squares import linearise_problem
from pamjax.infer.problem.dataset import build_dataset
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.infer.problem.priors import is_length_error
from pamjax.model.parameters import find_meaning
from pamjax.records.case import Case, load_case
from pamjax.units import format_quantity

#: A number, or a combination, is determined if its standard deviation shrinks to this share of the prior's.
MAX_SD_RATIO_DETERMINED = 0.5
#: Where nothing was believed, a number's own size times this stands in for the prior's.
RELATIVE_SD_WITHOUT_PRIOR = 0.3
#: Numbers with a smaller share than this in a combination are not named with it.
MIN_NAMED_COMPONENT = 0.3


@dataclass(frozen=True)
class ParameterIdentifiability:
    """What a recording can say of one number before it is fitted.

    Attributes:
        name: the number.
        prior_sd: standard deviation believed, SI; infinite for nothing.
        expected_sd: standard deviation expected after a fit, SI; NaN if it stays unknown.
        determined: whether the recording settles it by itself.
    """

    name: str
    prior_sd: float
    expected_sd: float
    determined: bool


def check_identifiability(
    case: Case | str | Path, law: str | None = None
) -> tuple[list[ParameterIdentifiability], list[str]]:
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
    case = load_case(case)
    law = law or case.entry.baseline
    space, (rename,) = build_joint_space([case], law, ())
    datasets = (build_dataset(case, law, space, rename),)
    start = jnp.zeros(space.size)
    datasets, _ = reweight_datasets(
        [case], datasets, space, linearise_problem(datasets, space, start), trust_sensors=True
    )
    solution = linearise_problem(datasets, space, start)
    scale = _compute_prior_scale(space)
    sd, _ = compute_sd_and_correlation(solution)
    results = [
        ParameterIdentifiability(
            name, float(space.sd[k]), float(sd[k]), bool(sd[k] < MAX_SD_RATIO_DETERMINED * scale[k])
        )
        for k, name in enumerate(space.names)
        if not is_length_error(name)
    ]
    slope = np.asarray(solution.slope)
    known = np.asarray(solution.information) / np.outer(slope, slope)
    return results, _format_sentences(results, find_undetermined_combinations(space.names, known, scale))


def _compute_prior_scale(space: ParameterSpace) -> np.ndarray:
    """(p,) the step in which each number is measured: its prior's sd, or a share of its size; SI."""
    sd, mean = np.asarray(space.sd), np.asarray(space.mean)
    return np.where(np.isfinite(sd), sd, RELATIVE_SD_WITHOUT_PRIOR * np.abs(mean))


def find_undetermined_combinations(
    names: Sequence[str], information: np.ndarray, scale: np.ndarray
) -> list[dict[str, float]]:
    """Combinations that a recording does not settle, each as moves of its numbers, SI.

    Args:
        names: (p,) of the numbers; the ruler's errors among them are given all the freedom of their prior.
        information: (p, p) what the data alone know of the numbers, 1/SI².
        scale: (p,) the step in which each number is measured, SI.
    """
    known = information * np.outer(scale, scale)
    is_own = np.array([not is_length_error(name) for name in names])
    eigenvalues, directions = np.linalg.eigh(_marginalise_length_errors(known, is_own))
    names = [name for name, keep in zip(names, is_own, strict=True) if keep]
    # One step of the prior and n of the data leave 1 / sqrt(1 + n²) of the step.
    weak = 1 / np.sqrt(1 + np.maximum(eigenvalues, 0)) > MAX_SD_RATIO_DETERMINED
    moves = (dict(zip(names, column * scale[is_own], strict=True)) for column in directions.T[weak])
    shares = directions.T[weak]
    return [
        {
            name: move
            for (name, move), share in zip(moves_of_combination.items(), column, strict=True)
            if abs(share) > MIN_NAMED_COMPONENT
        }
        for moves_of_combination, column in zip(moves, shares, strict=True)
    ]


def _marginalise_length_errors(information: np.ndarray, is_own: np.ndarray) -> np.ndarray:
    """Information on the muscle's numbers when the ruler's errors are as free as their prior lets them."""
    ruler = information[np.ix_(~is_own, ~is_own)] + np.eye(int((~is_own).sum()))
    across = information[np.ix_(is_own, ~is_own)]
    return information[np.ix_(is_own, is_own)] - across @ np.linalg.solve(ruler, across.T)


def _format_sentences(
    results: Sequence[ParameterIdentifiability], combinations: Sequence[dict[str, float]]
) -> list[str]:
    sentences = []
    determined = [f"`{d.name}`" for d in results if d.determined]
    if determined:
        sentences.append(
            f"This recording can determine {format_list(determined)}, if the model lacks nothing."
        )
    return sentences + [format_combination(moves) for moves in combinations]


def format_combination(moves: dict[str, float]) -> str:
    """One combination that goes unnoticed, as a sentence."""
    if len(moves) == 1:
        (name,) = moves
        return f"The recording says little about `{name}`: the stated sd will still speak after a fit."
    together = format_list([_format_move(*m) for m in moves.items()])
    return f"The recording knows some numbers only together: {together} would go unnoticed."


def _format_move(name: str, change: float) -> str:
    return f"`{name}` {'+' if change > 0 else ''}{format_quantity(change, find_meaning(name).show, 2)}"


def format_list(words: Sequence[str]) -> str:
    """Words as "a, b and c"."""
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]

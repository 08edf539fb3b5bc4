"""Identifiability of parameters before a fit: determined individually, or only in combination.

Near a point the misfit is quadratic. Its curvature is the Fisher information of the data plus the precision
of the prior. In units of prior sds, each eigenvector of the information is a combination of parameters. Its
eigenvalue is the precision from the data relative to the prior. The data do not determine a combination with
a small eigenvalue; a sentence gives the joint change that is not detectable.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pamjax.infer.fitting.covariance import compute_sd_and_correlation
from pamjax.infer.fitting.determination import (
    DETERMINED,
    MAX_SD_RATIO_DETERMINED,
    NOT_DETERMINED,
    classify_sd_ratio,
    compute_prior_scale,
    describe_row_shortage,
)
from pamjax.infer.fitting.expected_information import compute_expected_information
from pamjax.infer.fitting.joint_space import build_joint_space
from pamjax.infer.problem.informative_samples import count_informative_samples
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.infer.problem.priors import is_length_error, list_free_parameters
from pamjax.model.assembly import resolve_bench_law
from pamjax.model.parameters import find_meaning
from pamjax.model.registry import check_exclusive_pairs
from pamjax.parameter import Meaning
from pamjax.records.case import Case, ensure_case
from pamjax.text import join_words
from pamjax.units import format_quantity

#: Parameters with a smaller component in a combination are not named.
_MIN_NAMED_COMPONENT = 0.3


@dataclass(frozen=True)
class ParameterIdentifiability:
    """Expected identifiability of one parameter.

    Attributes:
        name: the parameter.
        prior_sd: sd of its prior, SI; infinite for a uniform prior.
        expected_sd: expected sd after a fit, SI; NaN if there is none.
        sd_ratio: expected sd over the scale of the prior, which is a fraction of a value without a prior sd.
    """

    name: str
    prior_sd: float
    expected_sd: float
    sd_ratio: float

    @property
    def is_determined(self) -> bool:
        """Return whether the recording determines it individually."""
        return classify_sd_ratio(self.sd_ratio) == DETERMINED


def check_identifiability(
    case: Case | str | Path, law: str | None = None, mechanisms: Sequence[str] = ()
) -> tuple[list[ParameterIdentifiability], list[str]]:
    """Return the expected identifiability of each parameter, without a fit.

    Uses the sensitivities at the stated values and the stated noise. Without a stated sensor, the noise
    is a hundredth of the channel's range. Samples count as independent: this is the best case.

    Args:
        case: the recording and its muscle.toml, or their folder.
        law: thread law; None takes the case's baseline.
        mechanisms: ids of mechanisms in addition to the threads, as for a fit.

    Returns:
        one entry for each parameter with its sd before and after a fit, SI; and sentences.

    Raises:
        BadInput: for an unknown law, or a parameter that the law needs and muscle.toml does not have.

    Example:
        parameters, sentences = pamjax.check_identifiability("mine")
        for parameter in parameters:
            print(parameter.name, parameter.expected_sd)  # SI
    """
    case = ensure_case(case)
    law = law or case.muscle_toml.baseline
    if mechanisms:
        check_exclusive_pairs(mechanisms)
        law = resolve_bench_law(law, mechanisms)
    space, (rename,) = build_joint_space([case], law, (), mechanisms)
    expected = compute_expected_information(case, law, space, rename, mechanisms)
    parameters = list_free_parameters(case, law, mechanisms)
    scale = _compute_prior_scales(space, {p.name: p.meaning for p in parameters})
    sd, _ = compute_sd_and_correlation(expected.of_data + expected.of_priors, expected.slope)
    results = [
        ParameterIdentifiability(name, float(space.sd[k]), float(sd[k]), float(sd[k] / scale[k]))
        for k, name in enumerate(space.names)
        if not is_length_error(name)
    ]
    information = expected.of_data / np.outer(expected.slope, expected.slope)
    combinations = find_undetermined_combinations(space.names, information, scale)
    return results, _format_sentences(case, results, combinations)


def _compute_prior_scales(space: ParameterSpace, meanings: Mapping[str, Meaning]) -> np.ndarray:
    """Return the scale of each parameter, (p,), SI: as a fit of the stated values has it."""
    values = zip(space.names, np.asarray(space.sd), np.asarray(space.mean), strict=True)
    return np.array(
        [compute_prior_scale(float(sd), float(mean), meanings[name]) for name, sd, mean in values]
    )


def find_undetermined_combinations(
    names: Sequence[str], information: np.ndarray, scale: np.ndarray
) -> list[dict[str, float]]:
    """Return combinations that a recording does not determine, each as changes of its parameters, SI.

    Args:
        names: (p,) of the parameters. Length errors among them are marginalised with their prior.
        information: (p, p) Fisher information of the data alone, 1/SI².
        scale: (p,) scale of each parameter, SI.
    """
    scaled_information = information * np.outer(scale, scale)
    is_own = np.array([not is_length_error(name) for name in names])
    eigenvalues, eigenvectors = np.linalg.eigh(_marginalise_length_errors(scaled_information, is_own))
    names = [name for name, keep in zip(names, is_own, strict=True) if keep]
    # With relative precision λ of the data, the sd is 1 / sqrt(1 + λ) of the prior sd.
    is_undetermined = 1 / np.sqrt(1 + np.maximum(eigenvalues, 0)) > MAX_SD_RATIO_DETERMINED
    return [
        {
            name: component * size
            for name, component, size in zip(names, eigenvector, scale[is_own], strict=True)
            if abs(component) > _MIN_NAMED_COMPONENT
        }
        for eigenvector in eigenvectors.T[is_undetermined]
    ]


def _marginalise_length_errors(information: np.ndarray, is_own: np.ndarray) -> np.ndarray:
    """Return the information on the muscle's parameters, marginalised over the length errors."""
    error_information = information[np.ix_(~is_own, ~is_own)] + np.eye(int((~is_own).sum()))
    cross_information = information[np.ix_(is_own, ~is_own)]
    lost_information = cross_information @ np.linalg.solve(error_information, cross_information.T)
    return information[np.ix_(is_own, is_own)] - lost_information


def _format_sentences(
    case: Case, results: Sequence[ParameterIdentifiability], combinations: Sequence[dict[str, float]]
) -> list[str]:
    kinds = {d.name: classify_sd_ratio(d.sd_ratio) for d in results}
    sentences = []
    names = [f"`{d.name}`" for d in results if d.is_determined]
    if names:
        sentences.append(f"This recording can determine {join_words(names)}, if the model is correct.")
    sentences += [format_combination(changes, kinds) for changes in combinations]
    shortage = describe_row_shortage(count_informative_samples(case), [d.prior_sd for d in results])
    return [*sentences, shortage] if shortage else sentences


def describe_weak_information(name: str, kind: str | None) -> str:
    """Return a sentence on a parameter that a recording does not determine, or only partly.

    Args:
        name: the parameter.
        kind: its case, from `classify_sd_ratio`, if known.
    """
    if kind == NOT_DETERMINED:
        return f"This recording does not determine `{name}`: a fit returns its prior."
    return (
        f"This recording reduces the sd of `{name}` by less than half:"
        " the estimate depends mostly on the prior."
    )


def format_combination(changes: dict[str, float], kinds: Mapping[str, str] | None = None) -> str:
    """Return a sentence on one combination that the data do not determine.

    Args:
        changes: change of each parameter, SI.
        kinds: how well the data determine each parameter, from `classify_sd_ratio`, if known.
    """
    if len(changes) == 1:
        (name,) = changes
        return describe_weak_information(name, (kinds or {}).get(name))
    joint_change = join_words([_format_change(*change) for change in changes.items()])
    return (
        "This recording determines some parameters only in combination:"
        f" the joint change {joint_change} is not detectable."
    )


def _format_change(name: str, change: float) -> str:
    return f"`{name}` {'+' if change > 0 else ''}{format_quantity(change, find_meaning(name).show, 2)}"

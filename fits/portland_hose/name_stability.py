"""Arithmetic of stability: which names of a reference diagnosis another diagnosis of the same hose keeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Name:
    """A named mechanism.

    Attributes:
        id: id of the mechanism.
        probability: its probability.
        ties: ids of the mechanisms from which the recording does not distinguish it.
        rivals: increase of the BIC by each rival in its place.
        form_error: rms of its form error over the rms of its effect; None without form error.
    """

    id: str
    probability: float
    ties: tuple[str, ...] = ()
    rivals: dict[str, float] = field(default_factory=dict)
    form_error: float | None = None


@dataclass(frozen=True)
class TreatedResult:
    """Numbers of one diagnosis.

    Attributes:
        names: the named mechanisms, most probable first.
        unexplained: whether a part of the misfit is unexplained.
        p_value: p-value of the residual.
        likeness: id of the effect outside the library that the unexplained part resembles most; "" if none.
        rows: number of rows.
        held_out: the held-out blocks, in words.
        error: rms error of force on these blocks, N.
        equation_error: the same without form errors, N.
        baseline_error: the same of the baseline, N.
        expected_error: the error that the diagnosis expects there, N; NaN if unknown.
        noise: sd of the force noise of the model, N.
        seconds: processor time.
    """

    names: tuple[Name, ...]
    unexplained: bool
    p_value: float
    likeness: str
    rows: int
    held_out: str
    error: float
    equation_error: float
    baseline_error: float
    expected_error: float
    noise: float
    seconds: float

    def as_dict(self) -> dict[str, Any]:
        """Return the numbers as the content of a JSON file."""
        return asdict(self)

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> TreatedResult:
        """Return the numbers from the content of a JSON file."""
        names = tuple(Name(**{**name, "ties": tuple(name["ties"])}) for name in content["names"])
        return cls(**{**content, "names": names})


@dataclass(frozen=True)
class Change:
    """Change of a diagnosis from its reference.

    Attributes:
        kept: ids of the names of the reference that stay, or that are tied with a name of the diagnosis.
        identical: those of them that stay with the same id.
        lost: ids of those that do not.
        new: ids of the names without a counterpart in the reference.
        error_ratio: held-out error over that of the reference.
    """

    kept: tuple[str, ...]
    identical: tuple[str, ...]
    lost: tuple[str, ...]
    new: tuple[str, ...]
    error_ratio: float

    @property
    def changes_names(self) -> bool:
        """Return whether a name goes or comes."""
        return bool(self.lost or self.new)


def is_same(first: Name, second: Name) -> bool:
    """Return whether two names are equal, or one of them is tied with the other."""
    return first.id == second.id or first.id in second.ties or second.id in first.ties


def find_best_rival(names: Sequence[Name]) -> tuple[str, float] | None:
    """Return the rival with the lowest BIC in the place of any name, and its increase; None without rivals.

    A negative increase shows that the search did not end at the lowest BIC.
    """
    rivals = [(increase, id) for name in names for id, increase in name.rivals.items()]
    if not rivals:
        return None
    increase, id = min(rivals)
    return id, increase


def compare_results(reference: TreatedResult, other: TreatedResult) -> Change:
    """Return the change of a diagnosis from its reference."""

    def has_counterpart(name: Name, names: Sequence[Name]) -> bool:
        return any(is_same(name, candidate) for candidate in names)

    kept = tuple(name.id for name in reference.names if has_counterpart(name, other.names))
    other_ids = {name.id for name in other.names}
    return Change(
        kept=kept,
        identical=tuple(id for id in kept if id in other_ids),
        lost=tuple(name.id for name in reference.names if name.id not in kept),
        new=tuple(name.id for name in other.names if not has_counterpart(name, reference.names)),
        error_ratio=other.error / reference.error,
    )


@dataclass(frozen=True)
class StabilitySummary:
    """Summary of several changes.

    Attributes:
        diagnoses: number of diagnoses, without the references.
        same: number of them with the names of their reference.
        kept, identical, named: number of reference names that remain, of those with the same id, and of all;
            each is counted once for each diagnosis.
        new: number of new names.
        ratios: held-out error over that of the reference: smallest, geometric mean, largest.
    """

    diagnoses: int
    same: int
    kept: int
    identical: int
    named: int
    new: int
    ratios: tuple[float, float, float]


def summarise_changes(changes: Sequence[Change]) -> StabilitySummary:
    """Return the summary of at least one change."""
    ratios = np.array([change.error_ratio for change in changes])
    kept = sum(len(change.kept) for change in changes)
    return StabilitySummary(
        diagnoses=len(changes),
        same=sum(not change.changes_names for change in changes),
        kept=kept,
        identical=sum(len(change.identical) for change in changes),
        named=kept + sum(len(change.lost) for change in changes),
        new=sum(len(change.new) for change in changes),
        ratios=(float(ratios.min()), float(np.exp(np.mean(np.log(ratios)))), float(ratios.max())),
    )

"""Name what was left out: what a search found, what each name is worth, and what else it could be.

Whoever takes a name's place as well is told beside it, and whoever does so nearly as well takes of its
probability.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pamjax.compile.parallel import abreast
from pamjax.diagnosis.detect.score_test import Signature, signatures
from pamjax.diagnosis.library.candidates import Form, forms
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.refit.candidate_fit import Model, settle
from pamjax.diagnosis.select.pair_swap import exchanged
from pamjax.diagnosis.select.search import (
    FINAL,
    TIE,
    TIE_SHARE,
    Look,
    halfway,
    removed,
    replacements,
    search,
    to_the_end,
)
from pamjax.diagnosis.select.small_effects import refined
from pamjax.progress import Progress, silent

#: Probability from which a name counts as established.
ESTABLISHED = 0.5
#: χ² by which a rough refit that is pulled by noise may be too high.
NEAR = 36.0


@dataclass(frozen=True, eq=False)
class Name:
    """A mechanism that a model holds.

    Attributes:
        id: which.
        probability: that this, or one of its ties, is it and none of the other rivals.
        ties: ids that explain this recording as well.
        gain: χ² that is lost when it is taken out and all others refitted.
        rivals: χ² lost when a rival takes its place, by id.
        instead: chance of each tie to be what is there, its form, and all numbers with it, (p,), SI.
    """

    id: str
    probability: float
    ties: tuple[str, ...]
    gain: float
    rivals: dict[str, float] = field(default_factory=dict)
    instead: tuple[tuple[float, Form, np.ndarray], ...] = ()


@dataclass(frozen=True, eq=False)
class Naming:
    """What was named.

    Attributes:
        baseline: the baseline's own refit.
        model: the baseline with all names.
        names: of all that the model holds, most probable first.
        first: the signatures at the baseline, for its p-value.
        near: (p,) SI, where the model lies weighed by what it leaves; None where that is its own place.
        before: the model before small effects joined; None where none did.
    """

    baseline: Model
    model: Model
    names: tuple[Name, ...]
    first: tuple[Signature, ...]
    near: np.ndarray | None = None
    before: Model | None = None

    @property
    def established(self) -> tuple[Name, ...]:
        """The names that are likelier right than wrong."""
        return tuple(name for name in self.names if name.probability >= ESTABLISHED)

    @property
    def values(self) -> np.ndarray:
        """Where a refit of the model begins, (p,), SI."""
        return self.model.at.values if self.near is None else self.near


def name_mechanisms(found: Problem, used: np.ndarray, progress: Progress = silent) -> Naming:
    """Name what the baseline has left out of a recording.

    Args:
        found: the recording before the library.
        used: (n,) the rows that may be looked at.
        progress: called with what is being done and the share done.
    """
    candidates = forms(found)
    baseline = settle(found, used, (), found.neutral)
    first = signatures(found, baseline.white, baseline.at, candidates)
    look = Look(found, used, baseline, candidates, progress)
    before = exchanged(look, search(look, first))
    model = refined(found, before, candidates, progress)
    progress("rivals", 0.75)
    names = names_of(found, model, candidates)
    if model is before:
        return Naming(baseline, model, names, tuple(first))
    # What stays unexplained is judged by the recording's noise.
    near = model.at.values
    return Naming(baseline, settle(found, used, model.chosen, near), names, tuple(first), near, before)


def without_small(found: Problem, naming: Naming) -> Naming:
    """What was named before small effects joined."""
    assert naming.before is not None
    return Naming(naming.baseline, naming.before, names_of(found, naming.before), naming.first)


def names_of(found: Problem, model: Model, candidates: Sequence[Form] | None = None) -> tuple[Name, ...]:
    """What each of a model's names is worth beside its rivals, most probable first.

    Args:
        found: the recording before the library.
        model: with the names.
        candidates: the forms of the rivals; None for all.
    """
    candidates = forms(found) if candidates is None else candidates
    names = abreast(lambda k: _name(found, model, k, candidates), range(len(model.chosen)))
    return ranked(names)


def ranked(names: Sequence[Name]) -> tuple[Name, ...]:
    """Names, most probable first; of those as probable, the one whose loss costs most."""
    return tuple(sorted(names, key=lambda name: (-round(name.probability, 2), -name.gain)))


def _name(found, model: Model, k: int, candidates) -> Name:
    form = model.chosen[k]
    left = removed(found, model, k)
    gain = left.fair - model.fair
    trials = replacements(found, left, form, candidates)
    # Who comes near gets every chance: noise may have pulled it too high. The others are far behind already.
    near = [trial for trial in trials if trial.score < max(model.score + NEAR, halfway(left, model))]
    near = sorted(near, key=lambda trial: trial.score)[:FINAL]
    ends = {m.chosen[-1].id: m for m in [*trials, *to_the_end(found, near)]}
    rivals = {id: m.score - model.score for id, m in ends.items()}
    # What is left unexplained shows how far off textbook forms are here: it blurs a comparison.
    blur = 1 + model.excess / 8
    weights = {id: np.exp(-0.5 * max(loss, 0.0) / blur) for id, loss in rivals.items()}
    ties = [id for id, loss in rivals.items() if loss < TIE + TIE_SHARE * model.excess]
    alike = sum(weights[id] for id in ties)
    instead = tuple((weights[id] / (1 + alike), ends[id].chosen[-1], ends[id].at.values) for id in ties)
    probability = float((1 + alike) / (1 + sum(weights.values())))
    return Name(form.id, probability, tuple(ties), float(gain), rivals, instead)

"""Name what was left out: add, refit, look again, and try to take out again.

A name must pass three questions, none of which another recording was asked to answer:

significant   the χ² it takes away is out of reach of noise, over all forms that were tried
substantial   it explains a good part of the misfit that is left: textbook forms do not fit nature to the
              noise, and the small rest of a large effect is no second effect
sizeable      what it alone can explain is not small beside the whole misfit, or is all that was left

Whoever takes a name's place as well is told beside it, and whoever does so nearly as well takes of its
probability.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.stats import chi2

from pamjax.model.library import TWICE
from pamjax.study.abreast import abreast
from pamjax.study.forms import Form, forms
from pamjax.study.passed import passed
from pamjax.study.problem import Problem
from pamjax.study.refit import OFF_LIMIT, Refit, refit
from pamjax.study.signature import Signature, signatures
from pamjax.study.unbiased import unbiased
from pamjax.study.whiten import Whitening, whitening

#: Chance that noise alone brings in a name, over everything that was tried.
CHANCE = 1e-4
#: Share of the excess misfit that a name must explain.
SUBSTANTIAL = 0.2
#: Share of the baseline's whole misfit, as rms, that a name alone must account for ...
SIZEABLE = 0.1
#: ... unless it accounts for so much of the excess that nothing but noise is left.
COMPLETE = 0.95
#: The least of it in standard deviations of a sample: textbook forms are not known better than that.
LEAST = 0.25
#: How many mechanisms are refitted roughly at each step, how many of them to the end, and what is rough.
SHORTLIST, FINAL, ROUGH = 6, 2, 7
#: χ² by which a rough refit that is pulled by noise may be too high.
NEAR = 36.0
#: A baseline's number farther from what the lab believes than this, in sd, was driven there.
STRAINED = 2.5
#: Most names.
MOST = 4
#: Probability from which a name counts as established.
ESTABLISHED = 0.5
#: Rivals whose fit is worse by less than this, and a share of what is left unexplained, are not told apart.
TIE, TIE_SHARE = 12.0, 0.1

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Model:
    """A baseline with names, refitted.

    Attributes:
        chosen: the forms that are in, in the order in which they came.
        white: the noise, as read off this model's residual.
        at: the refit.
        passed: χ² that noise of what was set is expected to leave beyond what the weights know of.
        between: (k, k) covariance of the numbers that moved, SI, among models that are told apart no better.
    """

    chosen: tuple[Form, ...]
    white: Whitening
    at: Refit
    passed: float = 0.0
    between: np.ndarray | float = 0.0

    @property
    def ids(self) -> tuple[str, ...]:
        return tuple(form.id for form in self.chosen)

    @property
    def fair(self) -> float:
        """χ² freed of what the model makes of noise: averaging neighbours explains nothing."""
        return self.at.cost - self.passed

    @property
    def score(self) -> float:
        """χ² with the price of its numbers: ln n for each beyond the baseline's (Schwarz).

        What the lab's own statement of its muscle asks for is not paid twice.
        """
        extra = sum(len(form.moves) for form in self.chosen)
        expected = sum(form.expected for form in self.chosen)
        return self.fair + extra * np.log(max(self.white.size, 2)) - expected

    @property
    def excess(self) -> float:
        """χ² beyond what noise leaves."""
        return max(self.at.misfit - self.passed - self.white.size, 0.0)

    @property
    def wider(self) -> float:
        """Factor on a variance where the model leaves more than noise."""
        return max(self.at.misfit / max(self.white.size, 1), 1.0)

    @property
    def covariance(self) -> np.ndarray:
        """Of the numbers that moved, SI, (k, k)."""
        return self.wider * self.at.covariance + self.between

    def sd(self, place: int) -> float:
        """Standard deviation of a number, SI; NaN where it did not move."""
        if place not in self.at.moved:
            return float("nan")
        k = self.at.moved.index(place)
        return float(np.sqrt(max(self.covariance[k, k], 0.0)))


@dataclass(frozen=True, eq=False)
class Name:
    """A mechanism that is established.

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
        names: most probable first.
        first: the signatures at the baseline, for its p-value.
    """

    baseline: Model
    model: Model
    names: tuple[Name, ...]
    first: tuple[Signature, ...]


def name_mechanisms(
    found: Problem, used: np.ndarray, progress: Progress = lambda doing, share: None
) -> Naming:
    """Name what the baseline has left out of a recording.

    Args:
        found: the recording before the library.
        used: (n,) the rows that may be looked at.
        progress: called with what is being done and the share done.
    """
    candidates = forms(found)
    baseline = model = settle(found, used, (), found.neutral)
    first = signatures(found, model.white, model.at, candidates)
    scored = first
    for step in range(MOST):
        progress("naming", 0.1 + 0.15 * step)
        better = _step(found, used, baseline, model, scored, len(candidates))
        if better is None:
            break
        model = _swapped(found, used, better, candidates)
        scored = signatures(found, model.white, model.at, candidates)
    progress("rivals", 0.7)
    model = _pruned(found, used, baseline, model, len(candidates))
    return Naming(baseline, model, names_of(found, model, candidates), tuple(first))


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


def settle(
    found: Problem, used: np.ndarray, chosen: Sequence[Form], values: np.ndarray, rounds: int = 2
) -> Model:
    """Refit the baseline with some forms, with the noise that its own residual shows."""
    moved = sorted({*np.flatnonzero(found.own).tolist(), *places(found, chosen)})
    for _ in range(rounds):
        white = whitening(found, values, used)
        at = refit(found, white, moved, values)
        values = at.values
    return freed(found, tuple(chosen), white, at)


def freed(found: Problem, chosen: tuple[Form, ...], white: Whitening, at: Refit) -> Model:
    """A refitted model, without what it makes of noise."""
    return Model(chosen, white, *unbiased(found, white, at))


def places(found: Problem, chosen: Sequence[Form]) -> list[int]:
    """Indices of the numbers that some forms move."""
    return [found.place(name) for form in chosen for name in form.moves]


def begun(found: Problem, values: np.ndarray, form: Form, amplitudes: np.ndarray) -> np.ndarray:
    """Values with a form switched on at its best amplitudes in the linear limit, within its limits."""
    out = values.copy()
    for name, value in form.shape.items():
        k = found.place(name)
        out[k] = np.clip(value, found.low[k], found.high[k])
    for name, value in zip(form.amplitudes, amplitudes, strict=True):
        k = found.place(name)
        # The minimiser creeps away from a limit at which it starts.
        wide = found.high[k] - found.low[k]
        out[k] = np.clip(value, found.low[k] + 1e-6 * wide, found.high[k] - OFF_LIMIT * wide)
    return out


def without(found: Problem, values: np.ndarray, form: Form) -> np.ndarray:
    """Values with a form switched off."""
    out = values.copy()
    for name in form.moves:
        k = found.place(name)
        out[k] = found.neutral[k]
    return out


def shortlist(scored: Sequence[Signature], chosen: Sequence[str], many: int = SHORTLIST) -> list[Signature]:
    """The best form of each of the most promising mechanisms that may join the chosen ones."""
    best: dict[str, Signature] = {}
    barred = {*chosen, *(id for pair in TWICE if pair & set(chosen) for id in pair)}
    for signature in scored:
        id = signature.form.id
        if id not in barred and (id not in best or signature.gain > best[id].gain):
            best[id] = signature
    return sorted(best.values(), key=lambda s: -s.gain)[:many]


def _with(found: Problem, model: Model, signature: Signature) -> Model:
    """The model with one more form, roughly refitted under the model's noise.

    A baseline whose numbers were driven to their limits is a bad place to begin from: what drove them there
    may be this form. Then it begins once more from what the lab believes.
    """
    begins = [model.at.values]
    if not model.chosen and _strained(found, model):
        begins.append(found.neutral)
    chosen = (*model.chosen, signature.form)
    moved = sorted({*np.flatnonzero(found.own).tolist(), *places(found, chosen)})
    ends = []
    for begin in begins:
        values = begun(found, begin, signature.form, signature.amplitudes)
        ends.append(refit(found, model.white, moved, values, ROUGH))
    at = min(ends, key=lambda at: at.cost)
    # Rough: what noise alone leaves there is told, its pull on the minimum is not.
    return Model(chosen, model.white, at, passed(found, model.white, at.values))


def _strained(found: Problem, model: Model) -> bool:
    own = np.flatnonzero(found.own & np.isfinite(found.sd))
    return bool(np.any(np.abs(model.at.values[own] - found.start[own]) > STRAINED * found.sd[own]))


def _finished(found: Problem, trials: Sequence[Model], many: int = FINAL) -> list[Model]:
    """The most promising of some rough refits, refitted to the end; best first."""
    rough = sorted(trials, key=lambda trial: trial.score)[:many]

    def end(m: Model) -> Model:
        return freed(found, m.chosen, m.white, refit(found, m.white, m.at.moved, m.at.values))

    return sorted(abreast(end, rough), key=lambda trial: trial.score)


def _step(found, used, baseline: Model, model: Model, scored, tried: int) -> Model | None:
    """The model with the best further name, or None."""
    listed = [s for s in shortlist(scored, model.ids) if significant(s.gain, len(s.form.moves), tried)]
    trials = _finished(found, abreast(lambda s: _with(found, model, s), listed))
    if not trials:
        return None
    best = trials[0]
    gain = model.fair - best.fair
    if not _worth(baseline, gain, model.excess, len(best.chosen[-1].moves), tried):
        return None
    return settle(found, used, best.chosen, best.at.values)


def significant(gain: float, numbers: int, tried: int) -> bool:
    """Whether noise alone would hardly ever take so much χ² away, over all forms that were tried."""
    return bool(gain > 0 and tried * chi2.sf(gain, numbers) < CHANCE)


def _worth(baseline: Model, gain: float, excess: float, numbers: int, tried: int) -> bool:
    """Whether what a name takes away of an excess is significant, substantial and sizeable."""
    alone, whole = gain / baseline.white.size, baseline.excess / baseline.white.size
    sizeable = alone > LEAST**2 and (alone > SIZEABLE**2 * whole or gain > COMPLETE * excess)
    return significant(gain, numbers, tried) and gain > SUBSTANTIAL * excess and sizeable


def effect(found: Problem, model: Model, form: Form) -> np.ndarray:
    """What a form alone does to the recording, beyond what a refitted baseline makes up for, SI, (2, n)."""
    values = model.at.values
    for other in model.chosen:
        values = values if other is form else without(found, values, other)
    alone = found.shows(values)
    unmeasured = np.isnan(found.measured)
    as_measured = dataclasses.replace(found, measured=np.where(unmeasured, np.nan, alone))
    own = np.flatnonzero(found.own).tolist()
    bare = refit(as_measured, model.white, own, without(found, values, form))
    return alone - found.shows(bare.values)


def _swapped(found, used, model: Model, candidates) -> Model:
    """Put another in the place of an earlier name where that fits better now."""
    for k in range(len(model.chosen) - 1):
        trials = _finished(
            found, _replacements(found, _removed(found, model, k), model.chosen[k], candidates)
        )
        if trials and trials[0].score < model.score - TIE:
            model = settle(found, used, trials[0].chosen, trials[0].at.values)
    return model


def _replacements(found, left: Model, form: Form, candidates) -> list[Model]:
    """Models in which another mechanism stands in the place of a form, roughly refitted."""
    scored = signatures(found, left.white, left.at, [c for c in candidates if c.id != form.id])
    return abreast(lambda s: _with(found, left, s), shortlist(scored, left.ids, 5))


def _removed(found: Problem, model: Model, k: int) -> Model:
    """The model without its k-th form, refitted under the same noise."""
    form = model.chosen[k]
    rest = model.chosen[:k] + model.chosen[k + 1 :]
    moved = sorted({*np.flatnonzero(found.own).tolist(), *places(found, rest)})
    values = without(found, model.at.values, form)
    return freed(found, rest, model.white, refit(found, model.white, moved, values, 2 * ROUGH))


def _pruned(found, used, baseline: Model, model: Model, tried: int) -> Model:
    """Take out again what is no longer worth its place."""
    while len(model.chosen) > 1:
        rest = abreast(partial(_removed, found, model), range(len(model.chosen)))
        losses = [left.fair - model.fair for left in rest]
        k = int(np.argmin(losses))
        if _worth(baseline, losses[k], rest[k].excess, len(model.chosen[k].moves), tried):
            break
        model = settle(found, used, rest[k].chosen, rest[k].at.values)
    return model


def _name(found, model: Model, k: int, candidates) -> Name:
    form = model.chosen[k]
    left = _removed(found, model, k)
    gain = left.fair - model.fair
    trials = _replacements(found, left, form, candidates)
    # The best rival gets every chance, and so does a second that noise may have pulled too high; the others
    # are far enough behind already.
    near = sum(trial.score < model.score + NEAR for trial in trials)
    ends = {m.chosen[-1].id: m for m in [*trials, *_finished(found, trials, min(max(near, 1), FINAL))]}
    rivals = {id: m.score - model.score for id, m in ends.items()}
    # What is left unexplained shows how far off textbook forms are here: it blurs a comparison.
    blur = 1 + model.excess / 8
    weights = {id: np.exp(-0.5 * max(loss, 0.0) / blur) for id, loss in rivals.items()}
    ties = [id for id, loss in rivals.items() if loss < TIE + TIE_SHARE * model.excess]
    alike = sum(weights[id] for id in ties)
    instead = tuple((weights[id] / (1 + alike), ends[id].chosen[-1], ends[id].at.values) for id in ties)
    probability = float((1 + alike) / (1 + sum(weights.values())))
    return Name(form.id, probability, tuple(ties), float(gain), rivals, instead)

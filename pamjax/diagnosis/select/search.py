"""Search for what explains a misfit: add, refit, look again, and try to take out again.

A form that joins must pass three questions, none of which another recording was asked to answer:

significant   the χ² it takes away is out of reach of noise, over all forms that were tried
substantial   it explains a good part of the misfit that is left: textbook forms do not fit nature to the
              noise, and the small rest of a large effect is no second effect
sizeable      what it alone can explain is not small beside the whole misfit, or is all that was left

Where forms that are small beside the whole leave nothing but noise together, textbook forms do fit here, and
the third question is not asked. A first form that was wrong leads astray: a search that ends far from the
noise begins again from the pairs that came nearest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np
from scipy.stats import chi2

from pamjax.compile.parallel import abreast
from pamjax.diagnosis.detect.residual_test import REST, REST_SHARE
from pamjax.diagnosis.detect.score_test import Signature, signatures
from pamjax.diagnosis.library.candidates import Form
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.noise.input_noise import passed
from pamjax.diagnosis.refit.candidate_fit import Model, begun, freed, moving, settle, without
from pamjax.diagnosis.refit.least_squares import refit
from pamjax.model.registry import TWICE
from pamjax.progress import Progress, silent

#: Chance that noise alone brings in a name, over everything that was tried.
CHANCE = 1e-4
#: Share of the excess misfit that a name must explain.
SUBSTANTIAL = 0.2
#: Share of the baseline's whole misfit, as rms, that a name alone must account for ...
SIZEABLE = 0.1
#: ... unless it accounts for so much of what is left that nothing but noise is then ...
COMPLETE = 0.95
#: ... or others that are small as well do. No law is believed to be as good as this share of the whole.
SMALLEST = 0.025
#: The least of it in standard deviations of a sample: textbook forms are not known better than that.
LEAST = 0.25
#: How many mechanisms are refitted roughly at each step, how many of them to the end, and what is rough.
SHORTLIST, FINAL, ROUGH = 6, 2, 7
#: A baseline's number farther from what the lab believes than this, in sd, was driven there.
STRAINED = 2.5
#: Most names.
MOST = 4
#: Rivals whose fit is worse by less than this, and a share of what is left unexplained, are not told apart.
TIE, TIE_SHARE = 12.0, 0.1
#: From how many pairs a search begins again, and how many seconds are tried beside each first form.
AGAIN, SECONDS = 3, 3


@dataclass(frozen=True, eq=False)
class Look:
    """What does not change while a recording is searched.

    Attributes:
        found: the recording before the library.
        used: (n,) the rows that may be looked at.
        baseline: its refit.
        candidates: the forms that may join.
        progress: called with what is being done and the share done.
    """

    found: Problem
    used: np.ndarray
    baseline: Model
    candidates: Sequence[Form]
    progress: Progress

    def scored(self, model: Model) -> list[Signature]:
        return signatures(self.found, model.white, model.at, self.candidates)

    def settled(self, model: Model) -> Model:
        return settle(self.found, self.used, model.chosen, model.at.values)

    def worth(self, less: Model, more: Model, small: bool, form: Form | None = None) -> bool:
        """Whether a form is significant, substantial and, unless it may be small, sizeable.

        Args:
            less: the model without it.
            more: the model with it.
            small: whether it may be small beside the whole misfit.
            form: which, the last of `more` by itself.
        """
        gain, samples = less.fair - more.fair, self.baseline.white.size
        alone, whole = gain / samples, self.baseline.excess / samples
        sizeable = alone > (SMALLEST if small else SIZEABLE) ** 2 * whole
        sizeable = sizeable or (not small and gain > COMPLETE * less.excess)
        substantial = gain > SUBSTANTIAL * less.excess and alone > LEAST**2
        numbers = len((form or more.chosen[-1]).moves)
        return significant(gain, numbers, len(self.candidates)) and substantial and sizeable

    def exhausted(self, model: Model, best: Signature) -> bool:
        """Whether too little is left, in all and along the best form, for any form to be worth its place."""
        least = LEAST**2 * model.white.size
        return model.excess < least and best.gain < least / 2

    def completes(self, more: Model, less: Model) -> bool:
        """Whether hardly anything but noise is left of what another model leaves, and that is likelier."""
        return more.excess < (1 - COMPLETE) * less.excess and more.likely < less.likely

    def far(self, model: Model) -> bool:
        """Whether a model leaves much more than noise and the rough edges of forms."""
        return model.excess > max(REST**2 * model.white.size, REST_SHARE**2 * self.baseline.excess)


def search(look: Look, first: Sequence[Signature]) -> Model:
    """The baseline with the forms that explain what it leaves.

    Args:
        look: the recording, and what may join.
        first: the signatures of all forms that may join, at the baseline.
    """
    model = ended(look, look.baseline, first)
    if not look.far(model):
        return model
    begins = _beginnings(look, model, first)
    again = replace(look, progress=silent)
    for k, begin in enumerate(begins):
        look.progress("naming again", 0.5 + 0.2 * k / len(begins))
        other = ended(again, again.settled(begin))
        # Many pairs bend towards what is in no catalogue: only what leaves nothing but noise is believed.
        if look.completes(other, model):
            model = other
        if not look.far(model):
            break
    return model


def ended(look: Look, begin: Model, scored: Sequence[Signature] | None = None) -> Model:
    """Where a search ends that begins here."""
    grown, refused = _grown(look, begin, scored)
    model = pruned(look, grown)
    if not model.chosen or model.excess < LEAST**2 * model.white.size:
        return model
    if model is grown and not (refused and look.worth(model, refused, small=True)):
        return model
    # What is small beside the whole may stay if nothing but noise is left then.
    best = refused if model is grown else None
    whole = pruned(look, _grown(look, model, small=True, best=best)[0], small=True)
    return whole if look.completes(whole, model) else model


def _grown(
    look: Look,
    model: Model,
    scored: Sequence[Signature] | None = None,
    small: bool = False,
    best: Model | None = None,
) -> tuple[Model, Model | None]:
    """The model with further forms, one at a time, as long as each is worth it; and the best that was not.

    Signatures at the model, or the best model with one form more, need not be found twice.
    """
    while len(model.chosen) < MOST:
        look.progress("naming", 0.1 + 0.1 * len(model.chosen))
        best = best or _best(look, model, look.scored(model) if scored is None else scored)
        if best is None or not look.worth(model, best, small):
            return model, best
        model, scored, best = _swapped(look, look.settled(best)), None, None
    return model, None


def _best(look: Look, model: Model, scored: Sequence[Signature]) -> Model | None:
    """The model with the best further form, not settled; None where none could be worth its place."""
    listed = _listed(look, model, scored)
    if not listed or look.exhausted(model, listed[0]):
        return None
    return finished(look.found, model, abreast(partial(_with, look.found, model), listed))[0]


def _listed(look: Look, model: Model, scored: Sequence[Signature], many: int = SHORTLIST) -> list[Signature]:
    tried = len(look.candidates)
    return [s for s in shortlist(scored, model.ids, many) if significant(s.gain, len(s.form.moves), tried)]


def _swapped(look: Look, model: Model) -> Model:
    """Put another in the place of an earlier form where that fits better now."""
    for k in range(len(model.chosen) - 1):
        left = removed(look.found, model, k)
        rivals = replacements(look.found, left, model.chosen[k], look.candidates)
        trials = finished(look.found, left, [one for one in rivals if one.score < halfway(left, model)])
        if trials and trials[0].score < model.score - TIE:
            model = look.settled(trials[0])
    return model


def pruned(look: Look, model: Model, small: bool = False) -> Model:
    """Take out again what is no longer worth its place."""
    while len(model.chosen) > 1:
        rest = abreast(partial(removed, look.found, model), range(len(model.chosen)))
        losses = [left.fair - model.fair for left in rest]
        k = int(np.argmin(losses))
        if look.worth(rest[k], model, small, model.chosen[k]):
            break
        model = look.settled(rest[k])
    return model


def _beginnings(look: Look, model: Model, first: Sequence[Signature]) -> list[Model]:
    """Pairs, roughly refitted, that come nearer than any that a model began with or might have gone on to."""
    singles = abreast(partial(_with, look.found, look.baseline), _listed(look, look.baseline, first))

    def pairs(one: Model) -> list[Model]:
        return [_with(look.found, one, s) for s in _listed(look, one, look.scored(one), SECONDS)]

    begins: list[Model] = []
    for pair in sorted(chain.from_iterable(abreast(pairs, singles)), key=lambda pair: pair.score):
        ids = set(pair.ids)
        if model.ids and (ids <= set(model.ids) or ids >= set(model.ids)):
            break
        if not any(ids == set(other.ids) for other in begins):
            begins.append(pair)
    return begins[:AGAIN]


def significant(gain: float, numbers: int, tried: int, chance: float = CHANCE) -> bool:
    """Whether noise alone would hardly ever take so much χ² away, over all forms that were tried."""
    return bool(gain > 0 and tried * chi2.sf(gain, numbers) < chance)


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
    moved = moving(found, chosen)
    ends = []
    for begin in begins:
        values = begun(found, begin, signature.form, signature.amplitudes)
        ends.append(refit(found, model.white, moved, values, ROUGH))
    at = min(ends, key=lambda at: at.cost)
    # Rough: what noise alone leaves there is told, its pull on the minimum is not.
    return Model(chosen, model.white, at, passed(found, model.white, at.values))


def _strained(found: Problem, model: Model) -> bool:
    """Whether a number of the baseline's own was driven far from what the lab believes."""
    own = np.flatnonzero(found.own & np.isfinite(found.sd))
    return bool(np.any(np.abs(model.at.values[own] - found.start[own]) > STRAINED * found.sd[own]))


def finished(found: Problem, left: Model, trials: Sequence[Model]) -> list[Model]:
    """The most promising of some rough refits, refitted to the end, best first; `left` has a form fewer."""
    first = sorted(trials, key=lambda trial: trial.score)[:FINAL]
    return to_the_end(found, [one for one in first if one is first[0] or one.score < halfway(left, first[0])])


def to_the_end(found: Problem, rough: Sequence[Model]) -> list[Model]:
    """Rough refits, refitted to the end; best first."""

    def end(m: Model) -> Model:
        return freed(found, m.chosen, m.white, refit(found, m.white, m.at.moved, m.at.values))

    return sorted(abreast(end, rough), key=lambda trial: trial.score)


def halfway(left: Model, model: Model) -> float:
    """What a rough refit of `left` with another form must reach for its end to come near that of a model."""
    return (left.score + model.score) / 2


def replacements(found, left: Model, form: Form, candidates) -> list[Model]:
    """Models in which another mechanism stands in the place of a form, roughly refitted."""
    scored = signatures(found, left.white, left.at, [c for c in candidates if c.id != form.id])
    return abreast(lambda s: _with(found, left, s), shortlist(scored, left.ids, 5))


def removed(found: Problem, model: Model, k: int) -> Model:
    """The model without its k-th form, refitted under the same noise."""
    form = model.chosen[k]
    rest = model.chosen[:k] + model.chosen[k + 1 :]
    moved = moving(found, rest)
    values = without(found, model.at.values, form)
    return freed(found, rest, model.white, refit(found, model.white, moved, values, 2 * ROUGH))

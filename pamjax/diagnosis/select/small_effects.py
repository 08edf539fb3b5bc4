"""Look on where names leave more than noise: effects that are small beside a large one.

No textbook wall is right to the noise of a load cell. What it leaves is smooth, and rows that repeat one
mistake a thousand times bend the lab's rulers and every further name to it. So such a model is weighed by
its own misfit first (`temper.py`), and the question is asked again with what its rows are worth then: which
further form takes away a good part of what is left?

significant   beyond what as many independent samples of the misfit as there are show by chance, over all
              forms that were tried
substantial   a fifth of the misfit that is left, and a tenth of what was left at first: no patch on a patch
together      all that join leave less than a third of what was left before, and let the lab's own numbers be
              what it believes, and none needs more than any bench has: otherwise none of them is told;
              nor where something stays unexplained beside them (`diagnose.py`)

What it leaves out: a misfit that differs between parts of a recording; names that only a different first
one would have let in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter

import numpy as np
from scipy.stats import chi2

from pamjax.compile.parallel import abreast
from pamjax.diagnosis.detect.score_test import Signature, signatures
from pamjax.diagnosis.library.candidates import Form
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.refit.candidate_fit import Model, begun, moving, without
from pamjax.diagnosis.refit.least_squares import driven, refit
from pamjax.diagnosis.refit.misfit_weighting import tempered
from pamjax.diagnosis.select.search import (
    FINAL,
    MOST,
    ROUGH,
    SUBSTANTIAL,
    shortlist,
    significant,
)
from pamjax.progress import Progress, silent

#: Share of what names leave at first that all further ones must take away together, and each at least.
TOGETHER, EACH = 2 / 3, 0.1
#: Chance that a smooth misfit alone brings in a name, over everything that was tried; its χ² is that of so
#: few samples that a smaller one would mean nothing.
CHANCE = 0.01
#: Chance that a lab's own statement of its muscle is as far off as a model has it.
BELIEVED = 0.01


def refined(found: Problem, model: Model, candidates: Sequence[Form], progress: Progress = silent) -> Model:
    """The model with further names, weighed by its own misfit; as it is where none are to be told.

    Args:
        found: the recording before the library.
        model: with the names that a search found.
        candidates: the forms that may join.
        progress: called with what is being done and the share done.
    """
    begin = tempered(found, model)
    if not model.chosen or begin.white.trust == 1:
        return model
    look = _Look(found, candidates, left(begin))
    grown = begin
    while len(grown.chosen) < MOST:
        progress("naming what is small", 0.7)
        better = look.better(grown)
        if better is None:
            break
        grown = better
    grown = look.pruned(grown, len(model.chosen))
    joined = grown.chosen[len(model.chosen) :]
    little = left(grown) < (1 - TOGETHER) * look.first
    return grown if little and believable(found, grown) and not beyond_belief(found, grown, joined) else model


def left(model: Model) -> float:
    """Mean square of what a model leaves beyond noise, in noise variances, whatever its rows are worth."""
    residual = model.at.residual / model.white.trust
    return max(float(np.mean(residual**2)) - 1, 0.0)


def believable(found: Problem, model: Model) -> bool:
    """Whether the baseline's own numbers lie, all together, where the lab believes them."""
    own = np.flatnonzero(found.own & np.isfinite(found.sd))
    off = (model.at.values[own] - found.start[own]) / found.sd[own]
    return bool(chi2.sf(off @ off, max(own.size, 1)) > BELIEVED)


def beyond_belief(found: Problem, model: Model, joined: Sequence[Form]) -> bool:
    """Whether what some forms need is more than any bench has: an amplitude at an end of its range."""
    ends = {found.names[model.at.moved[k]] for k in driven(found, model.at)}
    return any(name in ends for form in joined for name in form.amplitudes if _far(found, model, name))


def _far(found: Problem, model: Model, name: str) -> bool:
    """Whether an amplitude is not just switched off."""
    k = found.place(name)
    return bool(abs(model.at.values[k] - found.neutral[k]) > (found.high[k] - found.low[k]) / 4)


@dataclass(frozen=True, eq=False)
class _Look:
    """What does not change while further names are looked for.

    Attributes:
        found: the recording before the library.
        candidates: the forms that may join.
        first: what is left of the recording before any does.
    """

    found: Problem
    candidates: Sequence[Form]
    first: float

    def better(self, model: Model) -> Model | None:
        """The model with the best further form, weighed anew; None where none is worth its place."""
        scored = signatures(self.found, model.white, model.at, self.candidates)
        listed = [s for s in shortlist(scored, model.ids) if self._significant(s.gain, s.form)]
        rough = sorted(abreast(partial(self._joined, model), listed), key=attrgetter("score"))[:FINAL]
        ends = sorted(abreast(self._to_the_end, rough), key=attrgetter("score"))
        if not ends or not self._worth(model, ends[0], ends[0].chosen[-1]):
            return None
        return tempered(self.found, ends[0])

    def pruned(self, model: Model, first: int) -> Model:
        """Without those after the first few names that are no longer worth their place."""
        while len(model.chosen) > first:
            rest = abreast(partial(self._removed, model), range(first, len(model.chosen)))
            k = int(np.argmin([one.at.cost for one in rest]))
            if self._worth(rest[k], model, model.chosen[first + k]):
                break
            model = tempered(self.found, self._to_the_end(rest[k]))
        return model

    def _worth(self, less: Model, more: Model, form: Form) -> bool:
        taken = left(less) - left(more)
        substantial = taken > max(SUBSTANTIAL * left(less), EACH * self.first)
        return substantial and self._significant(less.at.cost - more.at.cost, form)

    def _significant(self, gain: float, form: Form) -> bool:
        return significant(gain, len(form.moves), len(self.candidates), CHANCE)

    def _joined(self, model: Model, signature: Signature) -> Model:
        values = begun(self.found, model.at.values, signature.form, signature.amplitudes)
        return self._refitted(model, (*model.chosen, signature.form), values, ROUGH)

    def _removed(self, model: Model, k: int) -> Model:
        values = without(self.found, model.at.values, model.chosen[k])
        return self._refitted(model, model.chosen[:k] + model.chosen[k + 1 :], values, 2 * ROUGH)

    def _to_the_end(self, model: Model) -> Model:
        return Model(
            model.chosen, model.white, refit(self.found, model.white, model.at.moved, model.at.values)
        )

    def _refitted(self, model: Model, chosen: tuple[Form, ...], values: np.ndarray, most: int) -> Model:
        at = refit(self.found, model.white, moving(self.found, chosen), values, most)
        return Model(chosen, model.white, at)

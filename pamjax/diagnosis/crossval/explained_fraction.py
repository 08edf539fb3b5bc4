"""What names explain of blocks that they were not fitted to.

Each block is left out once, the model is refitted with names and without them, and

    share = 1 − Σ excess with / Σ excess without,        excess = χ² − samples of the left-out block,

is what they explain of a misfit that they have not seen.

A block that alone knows how much there is of something says nothing of it, as nobody else could foretell it.
When it came, or where it begins, is told beforehand if no other block knows; and an error of the lab's own
that only the left-out block knows of (of the ruler, at that length) is made up for first. What the error of a
fit's numbers is expected to make of a block that it did not see, tr(J C Jᵀ) with their covariance C and the
slopes J of the block, is no fault of the names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pamjax.compile.parallel import abreast
from pamjax.diagnosis.detect.residual_test import REST
from pamjax.diagnosis.library.candidates import Form
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.noise.estimate import Whitening
from pamjax.diagnosis.refit.candidate_fit import Model, places, without
from pamjax.diagnosis.refit.least_squares import refit, standing
from pamjax.diagnosis.select.pair_swap import CHANCE
from pamjax.diagnosis.select.search import ROUGH
from pamjax.records.blocks import Blocks

#: Share of a misfit in unseen blocks that all names together must explain.
TOGETHER = 5 / 6
#: Blocks below which nothing is tried: a single other setting foretells none.
FEWEST = 3
#: Share of what a recording knows of a number below which the rest of it, without a block, knows nothing.
UNKNOWN = 0.05


@dataclass(frozen=True, eq=False)
class Unseen:
    """A model held against blocks that it was not fitted to, each left out of a fit once.

    Attributes:
        found: the recording before the library.
        model: as all blocks tell it.
        split: the noise of all but one block, and of that block, for each; none where blocks are too few.
        held: shapes that stay where all blocks put them, as nothing is known of them without one, for each.
        whole: the fits without a block.
        told: whether a fit without a block still knows of a form's amplitudes, by id.
    """

    found: Problem
    model: Model
    split: list[tuple[Whitening, Whitening]]
    held: list[set[int]]
    whole: list[_LeftOut]
    told: dict[str, list[bool]]

    @classmethod
    def by(cls, found: Problem, laid: Blocks, used: np.ndarray, model: Model) -> Unseen:
        """Held against the blocks that have readings among the rows that may be looked at."""
        seen = used & np.isfinite(found.measured).any(axis=0)
        split = [
            (model.white.of_rows(seen & ~laid.mask(k)), model.white.of_rows(seen & laid.mask(k)))
            for k in np.unique(laid.label[seen])
            if k >= 0
        ]
        split = split if len(split) >= FEWEST else []
        silent = [_silent(found, model, told) for told, _ in split]
        told = {
            form.id: [not {found.place(name) for name in form.amplitudes} <= unknown for unknown in silent]
            for form in model.chosen
        }
        amplitudes = {found.place(name) for form in model.chosen for name in form.amplitudes}
        held = [unknown - amplitudes for unknown in silent]
        whole = _left_out(found, model.chosen, model.at.values, split, held)
        return cls(found, model, split, held, whole, told)

    @property
    def bent(self) -> bool:
        """Whether all names together leave more of unseen blocks than physics does, and than chance."""
        doubts = np.array([one.doubt for one in self.whole])
        # A block that alone knows of a number says nothing of it.
        fair = self._fair(self.model.chosen) & (doubts < [judged.size for _, judged in self.split])
        size = np.array([judged.size for _, judged in self.split])[fair]
        left = np.array([one.excess - one.doubt for one in self.whole])[fair]
        doubt = doubts[fair]
        # As if all doubt of a block were in one direction.
        chance = CHANCE * np.sqrt(2 * np.sum(size + 2 * doubt + doubt**2))
        return bool(left.sum() > max(REST**2 * size.sum(), chance)) and self.together < TOGETHER

    @cached_property
    def together(self) -> float:
        """The share of a misfit in blocks left out of a fit that all names explain, 0 to 1."""
        return self._share(self.model.chosen)

    @property
    def shares(self) -> dict[str, float]:
        """The share that each explains of what is left without it, by id."""
        if len(self.model.chosen) == 1:
            return {self.model.ids[0]: self.together}
        return {form.id: self._share((form,)) for form in self.model.chosen}

    def _fair(self, gone: Sequence[Form]) -> np.ndarray:
        """The blocks of which a fit without them can be expected to know."""
        return np.all([self.told[form.id] for form in gone], axis=0)

    def _share(self, gone: Sequence[Form]) -> float:
        if not self.split:
            return 1.0
        model = self.model
        rest, values = tuple(form for form in model.chosen if form not in gone), model.at.values
        for form in gone:
            values = without(self.found, values, form)
        bare = _left_out(self.found, rest, values, self.split, self.held)
        left, before = (np.array([one.excess for one in fits]) for fits in (self.whole, bare))
        fair = self._fair(gone)
        return _explained(left[fair].sum(), before[fair].sum(), before.sum())


def _explained(left: float, before: float, everywhere: float) -> float:
    """The share of what was left before that is not left now; one where there is nothing to try it on."""
    if before <= UNKNOWN * max(everywhere, 0.0):
        return 1.0
    return float(np.clip(1 - max(left, 0.0) / before, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class _LeftOut:
    """A fit without a block.

    Attributes:
        excess: χ² of the block under it, beyond its samples.
        doubt: what of that the error of the fit's own numbers is expected to make.
    """

    excess: float
    doubt: float


def _left_out(
    found: Problem,
    chosen: Sequence[Form],
    values: np.ndarray,
    split: Sequence[tuple[Whitening, Whitening]],
    held: Sequence[set[int]],
) -> list[_LeftOut]:
    """Fits without each block."""
    own = np.flatnonzero(found.own).tolist()
    moved = sorted({*own, *places(found, chosen)})

    def without_one(one: tuple[tuple[Whitening, Whitening], set[int]]) -> _LeftOut:
        (told, judged), fixed = one
        at = refit(found, told, [k for k in moved if k not in fixed], values, 2 * ROUGH)
        alone = [k for k in own if not at.jacobian[:, at.moved.index(k)].any()]
        made_up = refit(found, judged, alone, at.values, ROUGH).values if alone else at.values
        shared = [j for j, k in enumerate(at.moved) if k not in alone]
        unseen = standing(found, judged, [at.moved[j] for j in shared], made_up)
        by_value = unseen.jacobian / np.where(unseen.scale != 0, unseen.scale, 1.0)
        doubt = float(np.sum(by_value @ at.covariance[np.ix_(shared, shared)] * by_value))
        return _LeftOut(unseen.misfit - unseen.residual.size, doubt)

    return abreast(without_one, list(zip(split, held, strict=True)))


def _silent(found: Problem, model: Model, told: Whitening) -> set[int]:
    """The numbers of names of which some rows know nothing, beside what all know, or all of them nothing."""
    some = standing(found, told, model.at.moved, model.at.values)
    part, whole = (np.sum(at.jacobian**2, axis=0) for at in (some, model.at))
    nothing = (part <= UNKNOWN * whole) | (whole * model.at.prior**2 < 1)
    return {k for k, unknown in zip(model.at.moved, nothing, strict=True) if unknown and not found.own[k]}

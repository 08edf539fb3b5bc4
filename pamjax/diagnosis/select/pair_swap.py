"""Two names at once, in the place of two others, of one, or of none.

A search goes from name to name, and a first one that was wrong is only found out where what it leaves is far
from noise. Two wrong names often leave little more: rubber and friction imitate a gain and a zero to a tenth
of the noise, while neither of these alone fits as well as either of those. So every two names are taken out
together. Where more than stated noise is left, one and none are taken out as well: of three effects a search
may have found one and a stand-in for both others. In the linear limit the χ² of all pairs of forms a, b
follows at once from the signatures d there and the residual r,

    gain(a, b) = yᵀ G⁻¹ y,     y = D r,     G = D Dᵀ,     D = (d_a, d_b).

The best of them are refitted, the search goes on from there, and where it ends likelier, that is the model;
where much was left, or more names take part than before, only if it leaves hardly anything but noise.
What it leaves out: limits of amplitudes, until they are refitted; three names in the place of three.
Source: least squares.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, combinations

import numpy as np

from pamjax.compile.parallel import abreast
from pamjax.diagnosis.detect.score_test import Signature, signatures, whole_residual
from pamjax.diagnosis.library.candidates import Form
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.refit.candidate_fit import Model, begun, freed, moving, settle, without
from pamjax.diagnosis.refit.least_squares import refit
from pamjax.diagnosis.select.search import FINAL, LEAST, MOST, ROUGH, TIE, Look, ended, pruned
from pamjax.model.registry import TWICE
from pamjax.progress import silent

#: Pairs that are refitted in the place of the same names, and rounds in which some took a place.
TRIED, ROUNDS = 3, 2
#: Share of the samples by which the χ² of a rough refit may be worse than the model's: more names may join.
NEAR = 0.2
#: Standard deviations of χ² by which noise is expected to leave more, at most.
CHANCE = 2.0
#: Share of its χ² within which a pair that shares a name with a better one stands for the same.
SAME = 1e-3


def exchanged(look: Look, model: Model) -> Model:
    """The model with the likeliest pairs of names.

    Args:
        look: what the model was found by.
        model: where the search ended.
    """
    for _ in range(ROUNDS if model.chosen else 0):
        look.progress("naming in pairs", 0.7)
        better = _likelier(replace(look, progress=silent), model)
        if better is None:
            break
        model = better
    return model


def _likelier(look: Look, model: Model) -> Model | None:
    """The likeliest model with two other names, where that is likelier beyond doubt."""
    # Where noise was never stated, names enough leave nothing but noise of anything.
    stated = all(colour is None or colour.given for colour in model.white.colours)
    fewer = range(3) if stated and not _only_noise(model) else (2,)
    out = chain.from_iterable(combinations(range(len(model.chosen)), some) for some in fewer)
    trials = chain.from_iterable(abreast(partial(_instead, look, model), out))
    worst = model.score + NEAR * model.white.size
    near = sorted((trial for trial in trials if trial.score < worst), key=lambda trial: trial.score)
    ends = [
        end
        for trial, end in ((trial, _end(look, trial)) for trial in near[:FINAL])
        if end.likely < model.likely - TIE
        and _believed(look, model, end, more=len(trial.chosen) > len(model.chosen))
    ]
    return min(ends, key=lambda end: end.likely, default=None)


def _believed(look: Look, model: Model, end: Model, *, more: bool) -> bool:
    """Whether what took a place is not just one of many pairs that bend towards what is in no catalogue.

    Where that may be, as much was left, or more names are there than took part, only what leaves nothing but
    noise is believed.
    """
    if more or look.far(model):
        return look.completes(end, model) or _only_noise(end)
    return not look.far(end)


def _end(look: Look, rough: Model) -> Model:
    """Where a search ends that begins here; what is small beside the whole stays if it leaves only noise."""
    begun = settle(look.found, look.used, rough.chosen, rough.at.values)
    end = ended(look, begun)
    if not _only_noise(begun):
        return end
    whole = pruned(look, begun, small=True)
    return whole if _only_noise(whole) and whole.likely < end.likely else end


def _only_noise(model: Model) -> bool:
    """Whether what is left is what noise leaves by chance, or too little of a sample to be looked into."""
    n = model.white.size
    return model.excess < max(LEAST**2 * n, CHANCE * np.sqrt(2 * n))


def _instead(look: Look, model: Model, places: tuple[int, ...]) -> list[Model]:
    """Models with two other names in the place of some, roughly refitted."""
    if len(model.chosen) - len(places) + 2 > MOST:
        return []
    found, out = look.found, [model.chosen[k] for k in places]
    rest = tuple(form for form in model.chosen if form not in out)
    values = model.at.values
    for form in out:
        values = without(found, values, form)
    at = refit(found, model.white, moving(found, rest), values, 2 * ROUGH)
    left = freed(found, rest, model.white, at)
    scored = signatures(found, left.white, left.at, look.candidates)
    here = frozenset(form.id for form in out)
    pairs = best_pairs(scored, left, whole_residual(found, left.at))
    others = (two for two in pairs if frozenset(s.form.id for s, _ in two) != here)
    return [_with(found, left, two) for two, _ in zip(others, range(TRIED), strict=False)]


def best_pairs(
    scored: Sequence[Signature], left: Model, residual: np.ndarray
) -> Iterator[tuple[tuple[Signature, np.ndarray], tuple[Signature, np.ndarray]]]:
    """Pairs of two mechanisms with their amplitudes, SI, the one that explains most first; each but once.

    Args:
        scored: what may join the model.
        left: the model.
        residual: (size + priors,) what it leaves, and how far its numbers are from what is believed.
    """
    forms = [s for s in scored if s.form.id not in left.ids and not _barred(s.form, left.chosen)]
    rows = np.concatenate([s.directions for s in forms])
    ends = np.cumsum([len(s.directions) for s in forms])
    along, gram, price = rows @ residual, rows @ rows.T, np.log(max(left.white.size, 2))
    found = []
    for a, b in combinations(range(len(forms)), 2):
        if forms[a].form.id == forms[b].form.id or _barred(forms[a].form, [forms[b].form]):
            continue
        at = np.r_[ends[a] - len(forms[a].directions) : ends[a], ends[b] - len(forms[b].directions) : ends[b]]
        best = np.linalg.lstsq(gram[np.ix_(at, at)], along[at], rcond=1e-9)[0]
        paid = price * (len(forms[a].form.moves) + len(forms[b].form.moves))
        found.append((float(along[at] @ best) - paid, a, b, best))
    seen: list[tuple[float, set[str]]] = []
    for gain, a, b, best in sorted(found, key=lambda one: -one[0]):
        ids = {forms[a].form.id, forms[b].form.id}
        if not any(ids == other or (ids & other and more - gain < SAME * more) for more, other in seen):
            seen.append((gain, ids))
            own = len(forms[a].directions)
            yield (forms[a], best[:own] / forms[a].norm), (forms[b], best[own:] / forms[b].norm)


def _barred(form: Form, others: Sequence[Form]) -> bool:
    return any(frozenset({form.id, other.id}) in TWICE for other in others)


def _with(found: Problem, left: Model, two: Sequence[tuple[Signature, np.ndarray]]) -> Model:
    """The model with two more forms, roughly refitted under its noise."""
    chosen, values = (*left.chosen, *(s.form for s, _ in two)), left.at.values
    for signature, amplitudes in two:
        values = begun(found, values, signature.form, amplitudes)
    return freed(
        found, chosen, left.white, refit(found, left.white, moving(found, chosen), values, 2 * ROUGH)
    )

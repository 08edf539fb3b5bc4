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

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.detect.score_test import ScoreDirection, compute_score_directions, stack_residual
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.candidate_fit import (
    CandidateFit,
    build_corrected_fit,
    fit_candidate,
    get_free_indices,
    switch_off_candidate,
    switch_on_candidate,
)
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.select.search import (
    FINAL_REFIT_COUNT,
    MAX_MECHANISMS,
    MIN_EFFECT_RMS,
    ROUGH_EVALUATIONS,
    TIE_CHI2,
    MechanismSearch,
    prune_mechanisms,
    run_search,
)
from pamjax.model.registry import EXCLUSIVE_PAIRS
from pamjax.progress import ignore_progress

#: Pairs that are refitted in the place of the same names, and rounds in which some took a place.
PAIRS_REFITTED, PAIR_SWAP_ROUNDS = 3, 2
#: Share of the samples by which the χ² of a rough refit may be worse than the model's: more names may join.
MAX_ROUGH_CHI2_SHARE = 0.2
#: Standard deviations of χ² by which noise is expected to leave more, at most.
MAX_NOISE_CHI2_SD = 2.0
#: Share of its χ² within which a pair that shares a name with a better one stands for the same.
SAME_PAIR_CHI2_SHARE = 1e-3


def swap_pairs(search: MechanismSearch, fit: CandidateFit) -> CandidateFit:
    """The model with the likeliest pairs of names.

    Args:
        search: what the model was found by.
        fit: where the search ended.
    """
    for _ in range(PAIR_SWAP_ROUNDS if fit.mechanisms else 0):
        search.progress("naming in pairs", 0.7)
        better = _find_better_pair(replace(search, progress=ignore_progress), fit)
        if better is None:
            break
        fit = better
    return fit


def _find_better_pair(search: MechanismSearch, fit: CandidateFit) -> CandidateFit | None:
    """The likeliest model with two other names, where that is likelier beyond doubt."""
    # Where noise was never stated, names enough leave nothing but noise of anything.
    stated = all(channel is None or channel.stated for channel in fit.noise.channels)
    fewer = range(3) if stated and not _leaves_only_noise(fit) else (2,)
    out = chain.from_iterable(combinations(range(len(fit.mechanisms)), some) for some in fewer)
    trials = chain.from_iterable(parallel_map(partial(_fit_pair_replacements, search, fit), out))
    worst = fit.bic + MAX_ROUGH_CHI2_SHARE * fit.noise.size
    near = sorted((trial for trial in trials if trial.bic < worst), key=lambda trial: trial.bic)
    ends = [
        end
        for trial, end in ((trial, _finish_search(search, trial)) for trial in near[:FINAL_REFIT_COUNT])
        if end.full_bic < fit.full_bic - TIE_CHI2
        and _is_acceptable(search, fit, end, more=len(trial.mechanisms) > len(fit.mechanisms))
    ]
    return min(ends, key=lambda end: end.full_bic, default=None)


def _is_acceptable(search: MechanismSearch, fit: CandidateFit, end: CandidateFit, *, more: bool) -> bool:
    """Whether what took a place is not just one of many pairs that bend towards what is in no catalogue.

    Where that may be, as much was left, or more names are there than took part, only what leaves nothing but
    noise is believed.
    """
    if more or search.leaves_large_residual(fit):
        return search.is_complete(end, fit) or _leaves_only_noise(end)
    return not search.leaves_large_residual(end)


def _finish_search(search: MechanismSearch, rough_fit: CandidateFit) -> CandidateFit:
    """Where a search ends that begins here; what is small beside the whole stays if it leaves only noise."""
    start_fit = fit_candidate(
        search.problem, search.training_rows, rough_fit.mechanisms, rough_fit.estimate.values
    )
    end = run_search(search, start_fit)
    if not _leaves_only_noise(start_fit):
        return end
    whole = prune_mechanisms(search, start_fit, small=True)
    return whole if _leaves_only_noise(whole) and whole.full_bic < end.full_bic else end


def _leaves_only_noise(fit: CandidateFit) -> bool:
    """Whether what is left is what noise leaves by chance, or too little of a sample to be looked into."""
    n = fit.noise.size
    return fit.excess_chi2 < max(MIN_EFFECT_RMS**2 * n, MAX_NOISE_CHI2_SD * np.sqrt(2 * n))


def _fit_pair_replacements(
    search: MechanismSearch, fit: CandidateFit, positions: tuple[int, ...]
) -> list[CandidateFit]:
    """Models with two other names in the place of some, roughly refitted."""
    if len(fit.mechanisms) - len(positions) + 2 > MAX_MECHANISMS:
        return []
    problem, removed = search.problem, [fit.mechanisms[k] for k in positions]
    remaining = tuple(candidate for candidate in fit.mechanisms if candidate not in removed)
    values = fit.estimate.values
    for candidate in removed:
        values = switch_off_candidate(problem, values, candidate)
    estimate = fit_parameters(
        problem, fit.noise, get_free_indices(problem, remaining), values, 2 * ROUGH_EVALUATIONS
    )
    reduced_fit = build_corrected_fit(problem, remaining, fit.noise, estimate)
    scored = compute_score_directions(problem, reduced_fit.noise, reduced_fit.estimate, search.candidates)
    here = frozenset(candidate.id for candidate in removed)
    pairs = rank_pairs(scored, reduced_fit, stack_residual(problem, reduced_fit.estimate))
    others = (two for two in pairs if frozenset(s.candidate.id for s, _ in two) != here)
    return [
        _fit_with_pair(problem, reduced_fit, two)
        for two, _ in zip(others, range(PAIRS_REFITTED), strict=False)
    ]


def rank_pairs(
    scored: Sequence[ScoreDirection], fit: CandidateFit, residual: np.ndarray
) -> Iterator[tuple[tuple[ScoreDirection, np.ndarray], tuple[ScoreDirection, np.ndarray]]]:
    """Pairs of two mechanisms with their amplitudes, SI, the one that explains most first; each but once.

    Args:
        scored: what may join the model.
        fit: the model.
        residual: (size + priors,) what it leaves, and how far its numbers are from what is believed.
    """
    directions = [
        s for s in scored if s.candidate.id not in fit.ids and not _is_barred(s.candidate, fit.mechanisms)
    ]
    rows = np.concatenate([s.unit_vectors for s in directions])
    ends = np.cumsum([len(s.unit_vectors) for s in directions])
    along, gram, price = rows @ residual, rows @ rows.T, np.log(max(fit.noise.size, 2))
    ranked_pairs = []
    for a, b in combinations(range(len(directions)), 2):
        if directions[a].candidate.id == directions[b].candidate.id or _is_barred(
            directions[a].candidate, [directions[b].candidate]
        ):
            continue
        rows_of_pair = np.r_[
            ends[a] - len(directions[a].unit_vectors) : ends[a],
            ends[b] - len(directions[b].unit_vectors) : ends[b],
        ]
        best = np.linalg.lstsq(gram[np.ix_(rows_of_pair, rows_of_pair)], along[rows_of_pair], rcond=1e-9)[0]
        paid = price * (
            len(directions[a].candidate.free_parameters) + len(directions[b].candidate.free_parameters)
        )
        ranked_pairs.append((float(along[rows_of_pair] @ best) - paid, a, b, best))
    reported_pairs: list[tuple[float, set[str]]] = []
    for gain, a, b, best in sorted(ranked_pairs, key=lambda ranked_pair: -ranked_pair[0]):
        ids = {directions[a].candidate.id, directions[b].candidate.id}
        if not any(
            ids == other or (ids & other and more - gain < SAME_PAIR_CHI2_SHARE * more)
            for more, other in reported_pairs
        ):
            reported_pairs.append((gain, ids))
            own = len(directions[a].unit_vectors)
            yield (
                (directions[a], best[:own] / directions[a].norm),
                (directions[b], best[own:] / directions[b].norm),
            )


def _is_barred(candidate: Candidate, others: Sequence[Candidate]) -> bool:
    return any(frozenset({candidate.id, other.id}) in EXCLUSIVE_PAIRS for other in others)


def _fit_with_pair(
    problem: LibraryProblem, fit: CandidateFit, two: Sequence[tuple[ScoreDirection, np.ndarray]]
) -> CandidateFit:
    """The model with two more forms, roughly refitted under its noise."""
    mechanisms, values = (*fit.mechanisms, *(s.candidate for s, _ in two)), fit.estimate.values
    for direction, amplitudes in two:
        values = switch_on_candidate(problem, values, direction.candidate, amplitudes)
    return build_corrected_fit(
        problem,
        mechanisms,
        fit.noise,
        fit_parameters(
            problem, fit.noise, get_free_indices(problem, mechanisms), values, 2 * ROUGH_EVALUATIONS
        ),
    )

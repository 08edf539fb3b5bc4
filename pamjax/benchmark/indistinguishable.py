"""Test whether an injected mechanism is indistinguishable from another one on a recording.

An identified mechanism that was not injected is no error if the recording cannot distinguish the two. The
test uses the recording without noise. The other mechanism replaces the injected one in the true model, and
the model is refitted. With the whitening filter W of the noise, the remaining misfit is

    χ² = |W (y_true − y_refit)|²,          y_true the true prediction at the recorded pressure and length,

the largest expected χ² in favour of the true mechanism. Below `_MAX_INDISTINGUISHABLE_CHI2` no test on one
recording of this length distinguishes them.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from pamjax.benchmark.inject_effect import GroundTruth, remove_amplitudes
from pamjax.diagnosis.detect.score_test import compute_score_directions
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.estimate import estimate_noise
from pamjax.diagnosis.refit.least_squares import fit_parameters

#: χ² below which two mechanisms are indistinguishable; it corresponds to odds of e⁶ at most.
_MAX_INDISTINGUISHABLE_CHI2 = 12.0


def is_indistinguishable(
    problem: LibraryProblem, ground_truth: GroundTruth, effect_id: str, other_id: str
) -> bool:
    """Return whether `other_id` explains the effect of `effect_id` to within noise.

    Args:
        problem: the recording with noise, and the library.
        ground_truth: the injected effects.
        effect_id: id of an injected mechanism.
        other_id: id of a mechanism that was not injected.
    """
    if other_id == effect_id:
        return True
    # Length errors of fixed lengths are neglected.
    true_values = np.array([ground_truth.true_values.get(name, 0.0) for name in problem.names])
    noise = estimate_noise(problem, true_values, np.ones(problem.n, dtype=bool))
    # Use the recorded pressure and length: their noise is the same for both models.
    clean_problem = dataclasses.replace(
        problem, measured=np.where(np.isnan(problem.measured), np.nan, problem.predict(true_values))
    )
    (removed_candidate,) = (candidate for candidate in ground_truth.candidates if candidate.id == effect_id)
    values = remove_amplitudes(problem, true_values, removed_candidate)
    kept_names = [
        name
        for candidate in ground_truth.candidates
        if candidate is not removed_candidate
        for name in candidate.free_parameters
    ]
    base = sorted(
        {*np.flatnonzero(problem.is_baseline).tolist(), *(problem.index(name) for name in kept_names)}
    )
    estimate = fit_parameters(clean_problem, noise, base, values)
    directions = compute_score_directions(
        clean_problem,
        noise,
        estimate,
        [candidate for candidate in build_candidates(problem) if candidate.id == other_id],
    )
    if not directions:
        return False
    best = max(directions, key=lambda s: s.chi2_reduction)
    start = estimate.values.copy()
    for name, value in best.candidate.shape.items():
        k = problem.index(name)
        start[k] = np.clip(value, problem.low[k], problem.high[k])
    for name, amplitude in zip(best.candidate.amplitudes, best.amplitudes, strict=True):
        k = problem.index(name)
        inside = 1e-3 * (problem.high[k] - problem.low[k])
        start[k] = np.clip(
            problem.neutral[k] + amplitude, problem.low[k] + 1e-3 * inside, problem.high[k] - inside
        )
    free = sorted({*base, *(problem.index(name) for name in best.candidate.free_parameters)})
    return bool(fit_parameters(clean_problem, noise, free, start).chi2 < _MAX_INDISTINGUISHABLE_CHI2)

"""Stand-ins: whether one mechanism could have made what another did, on this recording.

A name that was not concealed is no mistake where the recording cannot tell it from what was. The test is
made on the recording without noise: the true muscle loses the concealed mechanism, gets the other, and is
refitted; what is left, in noise standard deviations with the noise's own correlation, is

    χ² = |W (y_true − y_refit)|²,          y_true what the true bench shows of what was set, as recorded,

the largest expected gain of the truth over the stand-in. Below `MIN_SIMILARITY` no test on one recording of
this
length decides between them.
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

#: χ² below which two mechanisms are alike: odds of e⁶ at most, once, when everything else is known.
MAX_INDISTINGUISHABLE_CHI2 = 12.0


def is_indistinguishable(
    problem: LibraryProblem, ground_truth: GroundTruth, effect_id: str, other_id: str
) -> bool:
    """Whether `select_second_objective` would explain what `effect_id` did, up to noise.

    Args:
        problem: the recording, with noise, before the library.
        ground_truth: what is concealed in it.
        effect_id: id of one of the concealed mechanisms.
        other_id: id of another mechanism, not concealed.
    """
    if other_id == effect_id:
        return True
    # The error that noise made of a held length is as good as none.
    true_values = np.array([ground_truth.true_values.get(name, 0.0) for name in problem.names])
    noise = estimate_noise(problem, true_values, np.ones(problem.n, dtype=bool))
    # Of pressure and length as they were recorded: their noise is no difference between the two.
    clean_problem = dataclasses.replace(
        problem, measured=np.where(np.isnan(problem.measured), np.nan, problem.predict(true_values))
    )
    (removed,) = (candidate for candidate in ground_truth.candidates if candidate.id == effect_id)
    values = remove_amplitudes(problem, true_values, removed)
    kept = [
        name
        for candidate in ground_truth.candidates
        if candidate is not removed
        for name in candidate.free_parameters
    ]
    base = sorted({*np.flatnonzero(problem.is_baseline).tolist(), *(problem.index(name) for name in kept)})
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
    return bool(fit_parameters(clean_problem, noise, free, start).chi2 < MAX_INDISTINGUISHABLE_CHI2)

"""A minimum moved back from where a model only passes less noise on.

A lag is drawn towards half a sample, where it averages most. Of χ² less what the noise of what was set
leaves, C − p, the minimum is found from that of C by Gauss–Newton steps,

    δ = −(JᵀJ + Λ)⁻¹ (½ ∇C − ½ ∇p),

J the white derivatives, Λ the priors' information; a step that makes C − p no smaller ends it.

What is left of that pull is not known better than the pull itself: how far the numbers go when the same
noise comes once more, on average over the draws of `passed`, is part of their doubt (`pulled`),

    δ = (JᵀJ + Λ)⁻¹ mean_u [J_uᵀ W (y − f(x + u)) − Jᵀ W (y − f(x))].

Source: derived here; see `passed`. Noise added once more: J. Cook, L. Stefanski, J. Am. Stat. Assoc. 89,
1314 (1994).
"""

from __future__ import annotations

import numpy as np

from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.noise.estimate import Whitening
from pamjax.diagnosis.noise.input_noise import passed, passed_slope, shaken
from pamjax.diagnosis.refit.least_squares import Refit, believed, coordinates, standing

#: Share of a misfit below which what is passed on is taken to move no minimum, and most steps.
SMALL, STEPS = 0.02, 6


def unbiased(found: Problem, white: Whitening, at: Refit) -> tuple[Refit, float]:
    """A refit freed of the pull of noise, and the χ² that noise leaves there.

    Args:
        found: the recording before the library.
        white: the weights of the refit.
        at: the refit.
    """
    of_noise = passed(found, white, at.values)
    for _ in range(STEPS if abs(of_noise) > SMALL * at.misfit else 0):
        trial = standing(found, white, at.moved, _stepped(found, white, at))
        there = passed(found, white, trial.values)
        if trial.cost - there >= at.cost - of_noise:
            break
        at, of_noise = trial, there
    return at, of_noise


def pulled(found: Problem, white: Whitening, at: Refit) -> np.ndarray:
    """How far noise of what was set, coming once more, moves the numbers that moved, SI, (k,).

    Args:
        found: the recording before the library.
        white: the weights of the refit.
        at: the refit.
    """
    moved = list(at.moved)
    again = shaken(found, at.values)
    if not again:
        return np.zeros(len(moved))
    slope = -at.jacobian.T @ at.residual
    for one in again:
        shown, slopes = one.slopes(at.values, moved)
        jacobian = np.nan_to_num(white(slopes)) * at.scale[:, None]
        slope += jacobian @ np.nan_to_num(white(found.measured - shown)) / len(again)
    return at.covariance @ (slope / at.scale)


def _stepped(found: Problem, white: Whitening, at: Refit) -> np.ndarray:
    """Values after one step, within their limits."""
    moved = list(at.moved)
    x, (mean, _) = coordinates(found, moved, at.values), believed(found, moved)
    pull = 0.5 * at.scale * passed_slope(found, white, at.values, moved)
    downhill = at.jacobian.T @ at.residual - (x - mean) / at.prior**2 + pull
    covariance = at.covariance / np.outer(at.scale, at.scale)
    low, high = (coordinates(found, moved, edge) for edge in (found.low, found.high))
    x = np.clip(x + covariance @ downhill, low, high)
    out, log = at.values.copy(), found.log[moved]
    out[moved] = np.where(log, np.exp(np.where(log, x, 0.0)), x)
    return out

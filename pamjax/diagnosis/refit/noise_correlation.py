"""How long noise remembers, as all that a model leaves tells it, not only what neighbours differ by.

While something is missing, what is slow may be misfit, and only the differences of neighbours tell noise.
Where pressure and length carry most of them, they say little of the channel's own memory. Once a model leaves
nothing but noise, what is slow is noise too. The correlations ρ of both channels are then the likeliest ones,
whatever the numbers x of the model are:

    −2 ln L(ρ) = |e|² + |(x − m)/s|² − bᵀ A⁻¹ b + ln det C(ρ) + ln det A,
    e = W(ρ) r,   J = W(ρ) ∂f/∂x,   A = JᵀJ + Λ,   b = Jᵀe − Λ (x − m),   Λ = diag 1/s²,

r the residual, W the filter that makes its noise white, m and s the priors. The last term is for what the
numbers absorb: slow noise looks like them, and without it seems to remember less than it does.
What it leaves out: a sensor of which nothing was stated; the size of any noise, which stays as stated.
Source: restricted likelihood, H. D. Patterson, R. Thompson, Biometrika 58, 545 (1971), linear in x.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.noise.estimate import FEW, MOST, Whitening
from pamjax.diagnosis.refit.candidate_fit import Model, freed
from pamjax.diagnosis.refit.least_squares import believed, coordinates, refit

#: Correlations of which the likeliest is where the search for it begins.
TRIED = (0.0, 0.2, 0.4, 0.6, 0.75, 0.85, 0.92, 0.96, MOST)
#: Turns in which the channels are looked at one after the other.
TURNS = 2
#: Change of a correlation from which the model is refitted.
CHANGED = 0.005


def with_memory(found: Problem, model: Model) -> Model:
    """The model, refitted under the correlations of noise that its whole residual tells.

    Args:
        found: the recording before the library.
        model: refitted; as it is where it leaves more than noise, or sensors are not stated.
    """
    if model.white.trust != 1:
        return model
    unlikely, white = _unlikeliness(found, model), model.white
    for _ in range(TURNS):
        for c, colour in enumerate(white.colours):
            if colour is not None and colour.given and not colour.freedom < np.inf:
                white = _likeliest(white, c, unlikely) if white.rows[c].size >= FEW else white
    if not _changed(model.white, white):
        return model
    return freed(found, model.chosen, white, refit(found, white, model.at.moved, model.at.values))


def _unlikeliness(found: Problem, model: Model) -> Callable[[Whitening], float]:
    """−2 ln L of a noise, but for a constant."""
    at, moved = model.at, list(model.at.moved)
    shown, slopes = found.slopes(at.values, moved)
    residual, slopes = found.measured - shown, slopes * at.scale[:, None, None]
    precision = 1 / at.prior**2
    pull = (coordinates(found, moved, at.values) - believed(found, moved)[0]) * precision

    def unlikely(white: Whitening) -> float:
        e, jacobian = np.nan_to_num(white(residual)), np.nan_to_num(white(slopes))
        information = jacobian @ jacobian.T + np.diag(precision)
        unit = np.sqrt(np.maximum(np.diag(information), 1e-300))
        value, vector = np.linalg.eigh(information / np.outer(unit, unit))
        value = np.maximum(value, 1e-12)
        absorbed = vector.T @ ((jacobian @ e - pull) / unit)
        determinant = float(np.sum(np.log(value)) + 2 * np.sum(np.log(unit)))
        return float(e @ e - np.sum(absorbed**2 / value)) + white.volume + determinant

    return unlikely


def _likeliest(white: Whitening, c: int, unlikely: Callable[[Whitening], float]) -> Whitening:
    """The noise with the likeliest correlation of one channel."""

    def noise(rho: float) -> Whitening:
        colour = white.colours[c]
        assert colour is not None
        colours = list(white.colours)
        colours[c] = replace(colour, correlation=float(rho), told=float(rho))
        return replace(white, colours=tuple(colours))

    k = int(np.argmin([unlikely(noise(rho)) for rho in TRIED]))
    near = TRIED[max(k - 1, 0)], TRIED[min(k + 1, len(TRIED) - 1)]
    end = minimize_scalar(lambda rho: unlikely(noise(rho)), bounds=near, method="bounded")
    return noise(end.x if end.fun < unlikely(noise(TRIED[k])) else TRIED[k])


def _changed(before: Whitening, after: Whitening) -> bool:
    return any(
        a is not None and b is not None and abs(a.correlation - b.correlation) > CHANGED
        for a, b in zip(before.colours, after.colours, strict=True)
    )

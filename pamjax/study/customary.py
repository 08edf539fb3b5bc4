"""What common practice does with the same recording and the same library, to compare with.

Selection: samples count as independent, mechanisms are added one at a time while Schwarz's criterion

    BIC = n ln(χ² / n) + k ln n

falls, with k numbers fitted. The library, its derivatives, priors and limits are pamjax's own: what differs
is the noise model, that nothing accounts for how many forms were tried, and that nothing is asked of a name
but that BIC falls.

Discrepancy: the refitted baseline plus a Gaussian process δ(pressure, contraction, direction) with a
squared-exponential kernel, one length for each input, and independent noise, by its marginal likelihood
(Kennedy & O'Hagan, J. R. Stat. Soc. B 63, 425 (2001), with the baseline's numbers at their best values).
It names nothing.

Both see the rows that pamjax's own fit sees, and are asked for the rows held out.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from pamjax.model.library import TWICE
from pamjax.study.cells import axes
from pamjax.study.forms import Form, forms
from pamjax.study.problem import Problem
from pamjax.study.refit import Refit, refit
from pamjax.study.signature import Signature, signatures
from pamjax.study.whiten import Whitening, whitening

#: Most names; how many mechanisms are refitted at each step, and evaluations of such a refit.
MOST, TRIED, EVALUATIONS = 6, 2, 15

#: Most rows that a process is fitted to, evenly spread, and evaluations for its five numbers.
ROWS, STEPS = 350, 40


@dataclass(frozen=True, eq=False)
class Selection:
    """What independent noise and BIC select.

    Attributes:
        ids: in the order in which they came.
        force: (n,) what it predicts, N.
    """

    ids: tuple[str, ...]
    force: np.ndarray


def select(found: Problem, used: np.ndarray) -> Selection:
    """Forward selection by BIC under independent noise.

    Args:
        found: the recording before the library.
        used: (n,) the rows that may be looked at.
    """
    candidates = forms(found)
    own = np.flatnonzero(found.own).tolist()
    white = _independent(whitening(found, found.neutral, used))
    at = refit(found, white, own, found.neutral)
    white = _independent(whitening(found, at.values, used))
    at = refit(found, white, own, at.values)
    chosen: list[Form] = []
    while len(chosen) < MOST:
        scored = signatures(found, white, at, candidates)
        trials = [
            (s.form, _with(found, white, at, own, chosen, s)) for s in _promising(scored, chosen)[:TRIED]
        ]
        form, best = min(trials, key=lambda pair: pair[1].misfit)
        if bic(best.misfit, white.size, len(best.moved)) >= bic(at.misfit, white.size, len(at.moved)):
            break
        at, chosen = best, [*chosen, form]
    return Selection(tuple(form.id for form in chosen), found.shows(at.values)[0])


def bic(misfit: float, samples: int, numbers: int) -> float:
    """Schwarz's criterion with the noise level profiled out."""
    return samples * float(np.log(misfit / samples)) + numbers * float(np.log(samples))


def _independent(white: Whitening) -> Whitening:
    colours = tuple(c and dataclasses.replace(c, correlation=0.0) for c in white.colours)
    return dataclasses.replace(white, colours=colours)


def _promising(scored: Sequence[Signature], chosen: Sequence[Form]) -> list[Signature]:
    """The best form of each mechanism that may join, the most promising first."""
    ids = {form.id for form in chosen}
    barred = ids | {id for pair in TWICE if pair & ids for id in pair}
    best: dict[str, Signature] = {}
    for one in sorted(scored, key=lambda s: -s.gain):
        if one.form.id not in barred:
            best.setdefault(one.form.id, one)
    return list(best.values())


def _with(found: Problem, white: Whitening, at: Refit, own, chosen, signature: Signature) -> Refit:
    form, start = signature.form, at.values.copy()
    for name, value in form.shape.items():
        k = found.place(name)
        start[k] = np.clip(value, found.low[k], found.high[k])
    for name, amplitude in zip(form.amplitudes, signature.amplitudes, strict=True):
        k = found.place(name)
        inside = 1e-3 * (found.high[k] - found.low[k])
        start[k] = np.clip(found.neutral[k] + amplitude, found.low[k] + 1e-3 * inside, found.high[k] - inside)
    names = [name for one in (*chosen, form) for name in one.moves]
    moved = sorted({*own, *(found.place(name) for name in names)})
    return refit(found, white, moved, start, EVALUATIONS)


def discrepancy(found: Problem, baseline: np.ndarray, used: np.ndarray) -> np.ndarray:
    """(n,) force, N, of a baseline's prediction with a Gaussian process on what it left.

    Args:
        found: the recording before the library.
        baseline: (n,) force that the refitted baseline predicts, N.
        used: (n,) the rows that may be looked at.
    """
    at = axes(found)
    inputs = np.stack([at.pressure, at.contraction, at.direction.astype(float)], axis=1)
    inputs = (inputs - inputs.mean(axis=0)) / np.maximum(inputs.std(axis=0), 1e-12)
    left = found.measured[0] - baseline
    rows = np.flatnonzero(np.isfinite(left) & used)
    rows = rows[np.linspace(0, rows.size - 1, min(ROWS, rows.size)).astype(int)]
    return baseline + process(inputs[rows], left[rows], inputs)


def process(told: np.ndarray, values: np.ndarray, asked: np.ndarray) -> np.ndarray:
    """Mean of a Gaussian process with fitted lengths, strength and noise.

    Args:
        told: (n, d) inputs, of unit spread.
        values: (n,) at them.
        asked: (m, d) inputs.
    """
    scale = max(float(np.std(values)), 1e-12)
    squares, d = (told[:, None, :] - told[None, :, :]) ** 2, told.shape[1]
    start = np.array([0.0] * d + [0.0, np.log(0.3)])
    bounds = [(-3.0, 3.0)] * d + [(-4.0, 3.0), (-6.0, 1.0)]
    x = minimize(
        likelihood, start, (squares, values / scale), jac=True, bounds=bounds, method="L-BFGS-B",
        options={"maxfun": STEPS},
    ).x  # fmt: skip
    factor = cho_factor(_kernel(x, squares) + _noise(x) * np.eye(len(told)), lower=True)
    across = _kernel(x, (asked[:, None, :] - told[None, :, :]) ** 2)
    return across @ cho_solve(factor, values)


def likelihood(x: np.ndarray, squares: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray]:
    """Minus the log marginal likelihood and its slope.

    Args:
        x: (d + 2,) logarithms of the lengths, of the strength and of the noise.
        squares: (n, n, d) squared distances.
        y: (n,) values, of unit spread.
    """
    kernel = _kernel(x, squares)
    factor = cho_factor(kernel + _noise(x) * np.eye(y.size), lower=True)
    alpha = cho_solve(factor, y)
    outer = np.outer(alpha, alpha) - cho_solve(factor, np.eye(y.size))
    shared = outer * kernel
    by_length = -0.5 * np.einsum("ij,ijd->d", shared, squares) * np.exp(-2 * x[:-2])
    slope = np.array([*by_length, -np.sum(shared), -np.exp(2 * x[-1]) * np.trace(outer)])
    return float(0.5 * y @ alpha + np.log(np.diag(factor[0])).sum()), slope


def _kernel(x: np.ndarray, squares: np.ndarray) -> np.ndarray:
    return np.exp(2 * x[-2] - 0.5 * squares @ np.exp(-2 * x[:-2]))


def _noise(x: np.ndarray) -> float:
    # A trace more keeps the matrix definite.
    return float(np.exp(2 * x[-1])) + 1e-8

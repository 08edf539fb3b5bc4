"""Tolerances of the tests, each with its reason, and functions that compare numbers."""

import numpy as np

#: The same formula in another order of operations: some thousand roundings of 2⁻⁵³.
ROUNDING = 1e-12
#: The same root from two solvers: equilibria are solved to 1e-9 of the pull.
SOLVED = 1e-9
#: An exact derivative and a central difference, which has two thirds of the digits at its best step.
BY_DIFFERENCE = 1e-6
#: An estimate and the true value, in standard deviations, at a fixed seed.
RECOVERED = 4.0
#: The mean of a chain, in standard errors, for an effective sample size of at least `ENOUGH`.
SAMPLED = 5.0
ENOUGH = 100
#: Permitted relative violation of an active requirement at the end of a search.
KEPT = 1e-5
#: Relative resolution of a grid that shrinks around its best point.
ZOOMED = 0.03


def agree(got, expected, to, scale=0.0):
    """Assert that every |got − want| is at most `to` times the larger of |want| and `scale`."""
    got, expected = np.asarray(got, float), np.asarray(expected, float)
    error = np.abs(got - expected) / np.maximum(np.maximum(np.abs(expected), scale), np.finfo(float).tiny)
    assert got.shape == expected.shape or got.shape == () or expected.shape == ()
    # Not `off > to`: a NaN must fail.
    assert np.all(error <= to), f"off by {np.max(error):.3g}, allowed {to:.3g}: got {got}, want {expected}"


def printed(got, text):
    """Assert that `got` rounds to the printed text, within half of its last digit."""
    digits = len(text.partition(".")[2])
    half = 0.5 * 10.0**-digits
    assert abs(got - float(text)) <= half * (1 + 1e-9), f"got {got:.6g}, printed {text}"


def difference(function, at, step):
    """Return the slope of a function of one number by a central difference of fourth order."""
    f = [np.asarray(function(at + k * step)) for k in (-2, -1, 1, 2)]
    return (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * step)

"""How closely two numbers have to agree, by name and with its reason: the one owner of tolerances."""

import numpy as np

#: The same formula in another order: some thousand roundings of 2⁻⁵³.
ROUNDING = 1e-12
#: The same root found twice: balances are solved to 1e-9 of the pull.
SOLVED = 1e-9
#: An exact derivative against a central difference: its best step leaves the two thirds of the digits.
BY_DIFFERENCE = 1e-6
#: A number found again in noise it was given: standard deviations, at a fixed seed.
RECOVERED = 4.0
#: A mean of a chain: standard errors, for an effective sample size of at least `ENOUGH`.
SAMPLED = 5.0
ENOUGH = 100
#: A requirement that binds: the share of it by which a search may end on its wrong side.
KEPT = 1e-5
#: The best of a grid that closes in on its best, as a share: it may end beside the optimum.
ZOOMED = 0.03


def agree(got, want, to, scale=0.0):
    """Every |got − want| is at most `to` times the larger of |want| and `scale`."""
    got, want = np.asarray(got, float), np.asarray(want, float)
    off = np.abs(got - want) / np.maximum(np.maximum(np.abs(want), scale), np.finfo(float).tiny)
    assert got.shape == want.shape or got.shape == () or want.shape == ()
    # Not `off > to`: a NaN must fail.
    assert np.all(off <= to), f"off by {np.max(off):.3g}, allowed {to:.3g}: got {got}, want {want}"


def printed(got, text):
    """`got` rounds to the printed text: it is at most half of the last printed digit away."""
    digits = len(text.partition(".")[2])
    half = 0.5 * 10.0**-digits
    assert abs(got - float(text)) <= half * (1 + 1e-9), f"got {got:.6g}, printed {text}"


def difference(function, at, step):
    """Slope of a function of one number by the central difference of fourth order."""
    f = [np.asarray(function(at + k * step)) for k in (-2, -1, 1, 2)]
    return (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * step)

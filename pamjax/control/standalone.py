"""Inverse model of one muscle for a robot; needs this file, its table and NumPy.

    from controller import STATUS_TEXTS, Controller
    muscle = Controller("controller.npz")
    length = sum(muscle.lengths) / 2                                      # m
    force = muscle.force(sum(muscle.pressures) / 2, length)               # N
    pressure, status = muscle.pressure(force, length)                     # Pa, 0 if possible
    print(pressure, STATUS_TEXTS[int(status)])
    print(muscle.uncertainty)                                             # source of the sd
    if muscle.uncertainty != "unknown":
        print(muscle.sd(pressure, length) / muscle.pull(pressure, length))  # sd of the pressure, Pa

All values are scalars or arrays in SI units. Each function of two variables is a Chebyshev series.
`muscle.error` states each function's interpolation error: twice the largest error at random points.
`muscle.sd` is the uncertainty of the model, which is usually much larger; `muscle.uncertainty` is its source.
Outside `muscle.pressures` and `muscle.lengths`, all functions of pressure and length return NaN.
The commands `pressure` and `length` return the nearest possible value and a status (`STATUS_TEXTS`).
"""

import numpy as np
from numpy.polynomial.chebyshev import chebval, chebvander

#: Meaning of each status.
STATUS_TEXTS = {
    0: "the command is possible",
    1: "the force is above the maximum, which is at the highest pressure or the longest length",
    2: "the force is below the minimum, which is at the lowest pressure or the shortest length",
    3: "the pressure or length is outside the range",
}


#: Meaning of each source of the standard deviation.
UNCERTAINTY_TEXTS = {
    "calibration": "the covariance of the calibrated parameters, and the force error on held-out blocks",
    "posterior": "posterior draws, and the force error on held-out blocks",
    "design": "the scatter of materials and manufacture of a design; no muscle was measured",
    "unknown": "no standard deviation is known: there is no fit, or a fitted parameter has none",
}


def _scale_to_unit(x, low, high):
    """Return x mapped from [low, high] to [-1, 1]."""
    return (2 * np.asarray(x, dtype=float) - (low + high)) / (high - low)


def _sum_chebyshev(table, x, y):
    """Return the sum of table[i, j] T_i(x) T_j(y)."""
    x, y = np.broadcast_arrays(x, y)
    rows = chebvander(x.ravel(), table.shape[0] - 1) @ table
    return np.sum(rows * chebvander(y.ravel(), table.shape[1] - 1), axis=-1).reshape(x.shape)


class Controller:
    """Forward and inverse model of one muscle at rest, with derivatives and the sd of the force.

    Attributes:
        pressures: lowest and highest pressure, Pa.
        holding: lowest and highest pressure, Pa, for which `length` has a result. Near zero
            pressure the muscle has no stiffness.
        lengths: shortest and longest length, m.
        error: twice the largest measured interpolation error, by function name, SI.
        uncertainty: source of `sd`, a key of `UNCERTAINTY_TEXTS`.
    """

    def __init__(self, path):
        with np.load(path) as file:
            table = {name: file[name] for name in file.files}
        self.pressures, self.lengths = tuple(table["pressures"]), tuple(table["lengths"])
        self.holding = tuple(table["holding"])
        self.error = {k[6:]: float(v) for k, v in table.items() if k.startswith("error_")}
        self.uncertainty = str(table.get("uncertainty", "unknown"))
        self._table = table

    def force(self, pressure, length):
        """Return the force, N, at a pressure, Pa, and a length, m."""
        return self._evaluate("force", pressure, length)

    def pull(self, pressure, length):
        """Return the derivative of force with respect to pressure, N/Pa."""
        return self._evaluate("pull", pressure, length)

    def stiffness(self, pressure, length):
        """Return the derivative of force with respect to length, N/m."""
        return self._evaluate("stiffness", pressure, length)

    def stiffness_by_pressure(self, pressure, length):
        """Return the derivative of stiffness with respect to pressure, N/(m Pa)."""
        return self._evaluate("stiffness_by_pressure", pressure, length)

    def stiffness_by_length(self, pressure, length):
        """Return the derivative of stiffness with respect to length, N/m2."""
        return self._evaluate("stiffness_by_length", pressure, length)

    def friction(self, pressure, length):
        """Return the friction force, N: added after lengthening, subtracted after shortening."""
        return self._evaluate("friction", pressure, length)

    def sd(self, pressure, length):
        """Return the standard deviation of the force, N; NaN if `uncertainty` is "unknown"."""
        return self._evaluate("sd", pressure, length)

    def pressure(self, force, length):
        """Return the pressure, Pa, for a force, N, at a length, m; and the status."""
        return self._invert("pressure", force, length, self.lengths, self.pressures)

    def length(self, force, pressure):
        """Return the length, m, for a force, N, at a pressure, Pa; and the status."""
        return self._invert("length", force, pressure, self.holding, self.lengths)

    def pressure_slopes(self, pressure, length):
        """Return the derivatives of the commanded pressure: by force, Pa/N, and by length, Pa/m."""
        pull = self.pull(pressure, length)
        return 1 / pull, -self.stiffness(pressure, length) / pull

    def length_slopes(self, pressure, length):
        """Return the derivatives of the commanded length: by force, m/N, and by pressure, m/Pa."""
        stiffness = self.stiffness(pressure, length)
        return 1 / stiffness, -self.pull(pressure, length) / stiffness

    def _evaluate(self, name, pressure, length):
        x, y = _scale_to_unit(pressure, *self.pressures), _scale_to_unit(length, *self.lengths)
        # The tolerance includes ends with a rounding error.
        inside = (np.abs(x) <= 1 + 1e-9) & (np.abs(y) <= 1 + 1e-9)
        return np.where(inside, _sum_chebyshev(self._table[name], x, y), np.nan)

    def _invert(self, name, force, given, given_range, value_range):
        y = _scale_to_unit(np.clip(given, *given_range), *given_range)
        min_force, max_force = (chebval(y, self._table[f"{name}_{end}"]) for end in ("least", "most"))
        # Position of the force between its minimum (-1) and its maximum (1).
        x = _scale_to_unit(force, min_force, max_force)
        value = np.clip(_sum_chebyshev(self._table[name], np.clip(x, -1, 1), y), *value_range)
        tolerance = 1e-6
        status = np.where(x > 1 + tolerance, 1, np.where(x < -1 - tolerance, 2, 0))
        inside = (np.abs(_scale_to_unit(given, *given_range)) <= 1 + 1e-9) & np.isfinite(force)
        return value, np.where(inside, status, 3)

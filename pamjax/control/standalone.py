"""A muscle's inverse for a robot: this file and its table, and NumPy; nothing else.

    from controller import Controller
    muscle = Controller("controller.npz")
    pressure, status = muscle.pressure(force, length)     # N, m -> Pa
    off = muscle.sd(pressure, length) / muscle.pull(pressure, length)     # Pa, one standard deviation

Each function of two variables is a sum of Chebyshev polynomials. `muscle.error` states the largest error that
was measured against the model on random points, by name, SI; statuses are explained in STATUS_TEXTS.
"""

import numpy as np
from numpy.polynomial.chebyshev import chebval, chebvander

#: What a status means.
STATUS_TEXTS = {
    0: "met",
    1: "more force than there is at the highest pressure, or at the longest length",
    2: "less force than there is at the lowest pressure, or at the shortest length",
    3: "a pressure or length outside the range",
}


def _scale_to_unit(x, low, high):
    """From [low, high] to [-1, 1]."""
    return (2 * np.asarray(x, dtype=float) - (low + high)) / (high - low)


def _sum_chebyshev(table, x, y):
    """Sum of table[i, j] T_i(x) T_j(y)."""
    x, y = np.broadcast_arrays(x, y)
    rows = chebvander(x.ravel(), table.shape[0] - 1) @ table
    return np.sum(rows * chebvander(y.ravel(), table.shape[1] - 1), axis=-1).reshape(x.shape)


class Controller:
    """Pressure, length, force and stiffness of one muscle at rest, how they change, and how sure force is.

    Attributes:
        pressures: lowest and highest, Pa.
        holding: of them, those at which a length can be commanded: without pressure there is no stiffness.
        lengths: shortest and longest, m. Outside nothing is known: NaN, and a status where there is one.
        error: largest measured error of what the functions below return, by their names.
    """

    def __init__(self, path):
        with np.load(path) as file:
            table = {name: file[name] for name in file.files}
        self.pressures, self.lengths = tuple(table["pressures"]), tuple(table["lengths"])
        self.holding = tuple(table["holding"])
        self.error = {k[6:]: float(v) for k, v in table.items() if k.startswith("error_")}
        self._table = table

    def force(self, pressure, length):
        """Force, N, at a pressure, Pa, and a length, m."""
        return self._evaluate("force", pressure, length)

    def pull(self, pressure, length):
        """Slope of force in pressure, N/Pa."""
        return self._evaluate("pull", pressure, length)

    def stiffness(self, pressure, length):
        """Slope of force in length, N/m."""
        return self._evaluate("stiffness", pressure, length)

    def stiffness_by_pressure(self, pressure, length):
        """Slope of the stiffness in pressure, N/(m Pa)."""
        return self._evaluate("stiffness_by_pressure", pressure, length)

    def stiffness_by_length(self, pressure, length):
        """Slope of the stiffness in length, N/m2."""
        return self._evaluate("stiffness_by_length", pressure, length)

    def friction(self, pressure, length):
        """By how much force is higher after lengthening and lower after shortening, N; 0 without friction."""
        return self._evaluate("friction", pressure, length)

    def sd(self, pressure, length):
        """One standard deviation of the force as it was calibrated, N; NaN where that is not known."""
        return self._evaluate("sd", pressure, length)

    def pressure(self, force, length):
        """Pressure, Pa, for a force, N, at a length, m; and a status."""
        return self._invert("pressure", force, length, self.lengths, self.pressures)

    def length(self, force, pressure):
        """Length, m, for a force, N, at a pressure, Pa; and a status."""
        return self._invert("length", force, pressure, self.holding, self.lengths)

    def pressure_slopes(self, pressure, length):
        """How the pressure that was found changes, with force (Pa/N) and with length (Pa/m)."""
        pull = self.pull(pressure, length)
        return 1 / pull, -self.stiffness(pressure, length) / pull

    def length_slopes(self, pressure, length):
        """How the length that was found changes, with force (m/N) and with pressure (m/Pa)."""
        stiffness = self.stiffness(pressure, length)
        return 1 / stiffness, -self.pull(pressure, length) / stiffness

    def _evaluate(self, name, pressure, length):
        x, y = _scale_to_unit(pressure, *self.pressures), _scale_to_unit(length, *self.lengths)
        # A rounding beyond an end is that end.
        inside = (np.abs(x) <= 1 + 1e-9) & (np.abs(y) <= 1 + 1e-9)
        return np.where(inside, _sum_chebyshev(self._table[name], x, y), np.nan)

    def _invert(self, name, force, given, given_range, value_range):
        y = _scale_to_unit(np.clip(given, *given_range), *given_range)
        min_force, max_force = (chebval(y, self._table[f"{name}_{end}"]) for end in ("least", "most"))
        # Where between the least and the most force, from -1 to 1.
        x = _scale_to_unit(force, min_force, max_force)
        value = np.clip(_sum_chebyshev(self._table[name], np.clip(x, -1, 1), y), *value_range)
        tolerance = 1e-6
        status = np.where(x > 1 + tolerance, 1, np.where(x < -1 - tolerance, 2, 0))
        inside = (np.abs(_scale_to_unit(given, *given_range)) <= 1 + 1e-9) & np.isfinite(force)
        return value, np.where(inside, status, 3)

"""A muscle's inverse for a robot: this file and its table, and NumPy; nothing else.

    from controller import Controller
    muscle = Controller("controller.npz")
    pressure, status = muscle.pressure(force, length)     # N, m -> Pa

Each function of two variables is a sum of Chebyshev polynomials. `muscle.error` states the largest error that
was measured against the model on random points, by name, SI; statuses are explained in LIMITS.
"""

import numpy as np
from numpy.polynomial.chebyshev import chebval, chebvander

#: What a status means.
LIMITS = {
    0: "met",
    1: "more force than there is at the highest pressure, or at the longest length",
    2: "less force than there is at the lowest pressure, or at the shortest length",
    3: "a pressure or length outside the range",
}


def _unit(x, low, high):
    """From [low, high] to [-1, 1]."""
    return (2 * np.asarray(x, dtype=float) - (low + high)) / (high - low)


def _sum(table, x, y):
    """Sum of table[i, j] T_i(x) T_j(y)."""
    x, y = np.broadcast_arrays(x, y)
    rows = chebvander(x.ravel(), table.shape[0] - 1) @ table
    return np.sum(rows * chebvander(y.ravel(), table.shape[1] - 1), axis=-1).reshape(x.shape)


class Controller:
    """Pressure, length, force and stiffness of one muscle at rest.

    Attributes:
        pressures: lowest and highest, Pa.
        lengths: shortest and longest, m.
        error: largest measured error of "pressure" (Pa), "length" (m), "force" (N) and "stiffness" (N/m).
    """

    def __init__(self, path):
        with np.load(path) as file:
            table = {name: file[name] for name in file.files}
        self.pressures, self.lengths = tuple(table["pressures"]), tuple(table["lengths"])
        self.error = {k[6:]: float(v) for k, v in table.items() if k.startswith("error_")}
        self._table = table

    def force(self, pressure, length):
        """Force, N, at a pressure, Pa, and a length, m."""
        return _sum(self._table["force"], _unit(pressure, *self.pressures), _unit(length, *self.lengths))

    def stiffness(self, pressure, length):
        """Slope of force in length, N/m."""
        return _sum(self._table["stiffness"], _unit(pressure, *self.pressures), _unit(length, *self.lengths))

    def pressure(self, force, length):
        """Pressure, Pa, for a force, N, at a length, m; and a status."""
        return self._inverse("pressure", force, length, self.lengths, self.pressures)

    def length(self, force, pressure):
        """Length, m, for a force, N, at a pressure, Pa; and a status."""
        return self._inverse("length", force, pressure, self.pressures, self.lengths)

    def _inverse(self, name, force, other, range_, into):
        y = _unit(np.clip(other, *range_), *range_)
        least, most = (chebval(y, self._table[f"{name}_{end}"]) for end in ("least", "most"))
        # Where between the least and the most force, from -1 to 1.
        x = _unit(force, least, most)
        value = np.clip(_sum(self._table[name], np.clip(x, -1, 1), y), *into)
        slack = 1e-6
        status = np.where(x > 1 + slack, 1, np.where(x < -1 - slack, 2, 0))
        outside = (np.asarray(other) < range_[0]) | (np.asarray(other) > range_[1])
        return value, np.where(outside, 3, status)

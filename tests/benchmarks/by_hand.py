"""The complete bench in plain NumPy: the same physics without JAX.

Newton's method solves the equilibrium of load and length for all rows at once, with derivatives by complex
steps. Memories are loops over the rows. Limits: taut muscles only, and eighteen mechanisms; all others must
have their neutral values.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import erf

from pamjax.model.history import RATE_HALF_WIDTH
from pamjax.model.mechanisms.braid_friction import (
    ELEMENT_SHARES,
    MIN_FRICTION_PRESSURE,
    PATCH_RADIUS,
    PRESLIDING_PRESSURE,
)
from pamjax.model.mechanisms.contact_pressure import MIN_CONTACT_PRESSURE
from pamjax.model.mechanisms.mullins_softening import MIN_WALL_ENERGY

#: Step of a complex-step derivative, which has no cancellation, so it can be this small.
STEP = 1e-30

#: Newton steps: four solve each row of the benchmark's recording to rounding.
STEPS = 4

WALLED = ("bladder_elasticity", "viscoelastic_creep", "mullins_softening")


class ByHand:
    """Force and diameter of a recording, from parameters by path as in `pamjax.parameter.list_values`."""

    def __init__(self, pressure, length, time, starts) -> None:
        self.pressure, self.length, self.time = (np.asarray(a, float) for a in (pressure, length, time))
        self.run = np.cumsum(starts)
        self.step = np.diff(self.time, prepend=self.time[:1])
        self.weights = self._weights()

    def __call__(self, numbers: Mapping[str, float]) -> np.ndarray:
        """Return the recorded force, N, and diameter, m, (2, n)."""
        self.of = numbers
        pressure = (self.pressure - numbers["pressure_offset.offset"]) / (1 + numbers["pressure_gain.gain"])
        length = self.length - numbers["length_offset.offset"]
        nothing = np.zeros_like(length)
        at, thread, load, _ = self._balance(pressure, length, nothing, nothing, nothing)
        inside = self._inside(pressure, at, thread)
        extension = self._extension(load)
        stresses = self._stresses(inside, at, thread)
        by_length = _slope(lambda a: self._work(stresses, inside, a, thread), at)
        by_thread = _slope(lambda b: self._work(stresses, inside, at, b), thread)
        at, thread, _, force = self._balance(inside, length, extension, by_length, -by_thread)
        return np.stack([self._read(force), 2 * self._radius(at, thread)])

    # One row.

    def _radius(self, length, thread):
        return np.sqrt(thread**2 - length**2) / (2 * np.pi * self.of["turns"])

    def _volume(self, length, thread):
        return length * (thread**2 - length**2) / (4 * np.pi * self.of["turns"] ** 2)

    def _stretch(self, id, length, thread):
        inner, wall, rest = (self.of[f"{id}.{n}"] for n in ("inner_diameter", "thickness", "length"))
        radius = self._radius(length, thread)
        axial = length / rest
        bore = np.sqrt(radius**2 - wall * (inner + wall) / axial)
        return axial, (radius + bore) / (inner + wall), np.pi * wall * (inner + wall) * rest

    def _invariants(self, id, length, thread):
        axial, hoop, rubber = self._stretch(id, length, thread)
        radial = 1 / (axial * hoop)
        first = axial**2 + hoop**2 + radial**2 - 3
        return first, axial**-2 + hoop**-2 + radial**-2 - 3, rubber

    def _potential(self, pressure, length, thread):
        first, second, rubber = self._invariants("bladder_elasticity", length, thread)
        mooney = self.of["bladder_elasticity.mooney"]
        stored = 0.5 * self.of["bladder_elasticity.modulus"] * rubber * (first + mooney * (second - first))
        return stored - pressure * self._volume(length, thread)

    def _strain(self, load):
        crimp = self.of["thread_crimp.crimp"] * np.expm1(-load / self.of["thread_crimp.load"])
        return self.of["braid_elasticity.compliance"] * load - crimp

    def _balance(self, pressure, length, extension, by_length, by_thread):
        """Return length, thread length, load and force of every row, with the memory terms as inputs."""
        rest = self.of["thread_length"] * (1 + extension)
        load, at = np.zeros_like(length), length

        def pulls(at, thread):
            around = -_slope(lambda b: self._potential(pressure, at, b), thread) + by_thread
            return around, _slope(lambda a: self._potential(pressure, a, thread), at) + by_length

        def off(load, at):
            around, along = pulls(at, rest * (1 + self._strain(load)))
            return load - around, at + self.of["rig_compliance.compliance"] * along - length

        for _ in range(STEPS):
            x, y = off(load, at)
            # Finite differences, because the inner derivatives use complex steps.
            h, k = 1e-4 * np.maximum(np.abs(load), 1.0), 1e-7 * at
            xa, ya = ((new - old) / h for new, old in zip(off(load + h, at), (x, y), strict=True))
            xb, yb = ((new - old) / k for new, old in zip(off(load, at + k), (x, y), strict=True))
            scale = xa * yb - xb * ya
            load, at = load - (yb * x - xb * y) / scale, at - (xa * y - ya * x) / scale
        thread = rest * (1 + self._strain(load))
        return at, thread, load, pulls(at, thread)[1]

    # The memories.

    def _weights(self):
        """Return the weights of the least-squares slope over a row and its neighbours in a run, 1/s."""
        n = self.time.size
        weights = np.zeros((n, 2 * RATE_HALF_WIDTH + 1))
        for i in range(n):
            near = [
                j
                for j in range(i - RATE_HALF_WIDTH, i + RATE_HALF_WIDTH + 1)
                if 0 <= j < n and self.run[j] == self.run[i]
            ]
            centred = self.time[near] - self.time[near].mean()
            weights[i, np.array(near) - i + RATE_HALF_WIDTH] = centred / np.sum(centred**2)
        return weights

    def _rate(self, values):
        around, n = np.pad(values, RATE_HALF_WIDTH), values.size
        return sum(self.weights[:, k] * around[k : k + n] for k in range(2 * RATE_HALF_WIDTH + 1))

    def _inside(self, pressure, at, thread):
        pressure = pressure - self.of["pressure_drop.impedance"] * self._rate(self._volume(at, thread))
        spent = self.of["contact_pressure.threshold"]
        there = pressure > MIN_CONTACT_PRESSURE
        below = spent / np.where(there, pressure, 1.0)
        return pressure - np.where(there, spent * (1 + below**8) ** -0.125, 0.0)

    def _extension(self, load):
        most = np.maximum.accumulate(load)
        relative = (most / self.of["thread_slip.load"]) ** self.of["thread_slip.bedding_exponent"]
        bedded = -self.of["thread_slip.bedding"] * np.expm1(-relative)
        late = (self.time - self.of["thread_slip.when"]) / self.of["thread_slip.during"]
        return bedded + self.of["thread_slip.step"] * 0.5 * (1 + np.tanh(0.5 * late))

    def _strains(self, pressure, length, thread):
        """Return the inputs of the memories: (λz, λc) of relaxation, energy of softening, angle, length."""
        axial, hoop, _ = self._stretch("viscoelastic_creep", length, thread)
        first, _, rubber = self._invariants("mullins_softening", length, thread)
        rubs = (length - self.of["braid_friction.give"] * pressure) / thread
        return axial, hoop, 0.5 * rubber * first, rubs, length

    def _stresses(self, pressure, length, thread):
        axial, hoop, energy, rubs, at = self._strains(pressure, length, thread)
        relaxing = self._relaxing(axial, hoop, self._stretch("viscoelastic_creep", length, thread)[2])
        largest = np.maximum.accumulate(energy)
        least = MIN_WALL_ENERGY * self._stretch("mullins_softening", length, thread)[2]
        softening = self.of["mullins_softening.modulus"] * (
            1 - erf((largest - energy) / (self.of["mullins_softening.width"] * largest + least))
        )
        damping = self.of["viscous_damping.coefficient"] * self._rate(at)
        return *relaxing, softening, self._rubbing(pressure, rubs, length, thread), damping

    def _relaxing(self, axial, hoop, rubber):
        name = "viscoelastic_creep."
        radial = 1 / (axial * hoop)
        elastic = np.stack([axial - radial**2 / axial, hoop - radial**2 / hoop], axis=1)
        times = np.array([self.of[f"{name}time_short"], self.of[f"{name}time_long"]])
        shares = np.array([self.of[f"{name}share"], 1 - self.of[f"{name}share"]])
        passed = self.step[:, None] / times
        keep = np.exp(-passed)[:, :, None]
        mean = np.where(passed > 0, -np.expm1(-passed) / np.where(passed > 0, passed, 1.0), 1.0)
        kicks = np.diff(elastic, axis=0, prepend=elastic[:1])[:, None, :] * (shares * mean)[:, :, None]
        stress = np.zeros_like(kicks)
        for i in range(1, len(kicks)):
            stress[i] = keep[i] * stress[i - 1] + kicks[i]
        return (self.of[f"{name}modulus"] * rubber * np.sum(stress, axis=1)).T

    def _rubbing(self, pressure, rubs, length, thread):
        name = "braid_friction."
        power = self.of[f"{name}exponent"]

        def strength(pressure, length):
            pressed = (np.maximum(pressure, MIN_FRICTION_PRESSURE) / PRESLIDING_PRESSURE) ** (power - 1)
            return 2 / 3 * PATCH_RADIUS * np.maximum(pressure, 0.0) * pressed * length / self.of["turns"]

        width = np.stack([np.ones_like(length), strength(pressure, length)], axis=1)[:, :, None]
        stiffness = np.array([1.0, strength(PRESLIDING_PRESSURE, thread[0])])[:, None] / np.array(
            ELEMENT_SHARES
        )
        moved = np.diff(rubs, prepend=rubs[:1]) * thread / self.of[f"{name}presliding"]
        stops = np.empty((len(length), 2, len(ELEMENT_SHARES)))
        stops[0] = self.of[f"{name}start"] * width[0]
        for i in range(1, len(length)):
            stops[i] = np.minimum(np.maximum(stops[i - 1] + stiffness * moved[i], -width[i]), width[i])
        weights = np.array([self.of[f"{name}constant"], self.of[f"{name}coefficient"]])
        return np.mean(stops, axis=2) @ weights * thread

    def _work(self, stresses, pressure, length, thread):
        strains = self._strains(pressure, length, thread)
        return sum(s * e for s, e in zip(stresses, strains, strict=True))

    # The sensors.

    def _read(self, force):
        since = self.time - self.time[0]
        force = (1 + self.of["force_gain.gain"]) * force + self.of["force_offset.offset"]
        force = force + since * (self.of["force_drift.rate"] + self.of["force_drift.bend"] * since)
        rate, late = self._rate(force), np.empty_like(force)
        for run in np.unique(self.run):
            rows = np.flatnonzero(self.run == run)
            late[rows] = self._late(rows, force, rate)
        return late

    def _late(self, rows, force, rate):
        """Return the delayed force by cubic interpolation; it is constant before a run."""
        time, at = self.time[rows], self.time[rows] - self.of["channel_lag.lag"]
        before = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(rows) - 2)
        a, b = rows[before], rows[before + 1]
        span = time[before + 1] - time[before]
        x = np.clip((at - time[before]) / span, 0.0, 1.0)
        ease = x * x * (3 - 2 * x)
        bend = x * (1 - x) * span * ((1 - x) * rate[a] - x * rate[b])
        return (1 - ease) * force[a] + ease * force[b] + bend


def _slope(function, at):
    return np.imag(function(at + STEP * 1j)) / STEP

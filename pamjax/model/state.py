"""The geometric state of a muscle at one instant, and the interfaces of geometries and stored energies."""

from __future__ import annotations

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model import braid
from pamjax.parameter import Scalar


class State(eqx.Module):
    """The geometric state at one length and one thread length.

    Attributes:
        length: between the fittings, m.
        thread: stretched length of one thread, m.
        turns: turns of one thread around the muscle.
        radius: mid-thread radius at mid-length, m.
        diameter: outer mean diameter, m.
        volume: volume inside the braid, m³.
    """

    length: Scalar
    thread: Scalar
    turns: Scalar
    radius: Scalar
    diameter: Scalar
    volume: Scalar


class AbstractGeometry(eqx.Module):
    """The geometry of a braid."""

    @abc.abstractmethod
    def __call__(self, length: Scalar, thread: Scalar, turns: Scalar) -> State:
        """Return the state at a length (m) and a thread length (m)."""


class AbstractTerm(eqx.Module):
    """A stored energy other than that of the threads."""

    @abc.abstractmethod
    def energy(self, state: State) -> Array:
        """Return the stored energy, J."""


class Cylinder(AbstractGeometry):
    """A cylinder from fitting to fitting.

    Neglects: the taper of the ends.
    """

    def __call__(self, length: Scalar, thread: Scalar, turns: Scalar) -> State:
        # A straight or overstretched braid has no radius. Its derivative must still be finite, because
        # `where` differentiates both branches.
        squared = braid.radius_squared(length, thread, turns)
        is_valid = squared > 0
        radius = jnp.where(is_valid, jnp.sqrt(jnp.where(is_valid, squared, 1.0)), 0.0)
        return State(length, thread, turns, radius, 2 * radius, braid.volume(length, thread, turns))

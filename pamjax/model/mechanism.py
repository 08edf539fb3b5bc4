"""The seams: what a mechanism is, and the few ways in which it may act.

A mechanism is physics that a muscle model may leave out. It is one class in one file: its numbers
with their neutral values as defaults (`Mechanism()` has no effect), what it does, and what it is
called. It answers one of these questions:

    geometry  where is everything?             shape(state) -> state                  wraps
    term      what does it cost?               energy(state) -> J                     adds
    yielding  how do threads give way?         strain(load) -> 1                      adds
    memory    what does the past leave?        a stress on a strain of its own, frozen while
                                               the balance is solved                  adds
    slip      how much longer are threads?     extension(history, past) -> 1          adds
    line      what pressure arrives inside?    pressure(history, past) -> Pa          chains
    sensor    what did the bench make of it?   undo(...) before, read(...) after      chains

A memory needs no force of its own: with generalised strain e(state) and stress s found from the past,
s · e joins the potential, and differentiation gives its share of the force and of the thread balance.
Its work over a closed path is ∮ s de, so a stress that dissipates on its strain dissipates altogether.
"""

from __future__ import annotations

import abc
from dataclasses import dataclass

import equinox as eqx
import jax
from jaxtyping import Array, Float

from pamjax.model.history import History
from pamjax.model.state import State
from pamjax.parameter import Scalar

Samples = Float[Array, " n"]


@dataclass(frozen=True)
class Description:
    """What `pamjax explain` says of a mechanism.

    Attributes:
        title: in words, "friction between braid threads".
        equation: readable in a terminal.
        signature: how it shows in force and diameter.
        leaves_out: what it does not describe.
        confusable: ids it is mistaken for.
        experiment: what separates it from them.
        source: paper and equation, or how it was derived.
    """

    title: str
    equation: str
    signature: str
    leaves_out: str
    confusable: tuple[str, ...]
    experiment: str
    source: str


class Past(eqx.Module):
    """What the muscle went through without its memory, at every sample: what memories look at.

    Attributes:
        state: where everything was; fields of shape (n,).
        pressure: inside the muscle, Pa.
        load: pull of all threads together, N.
        force: N.
    """

    state: State
    pressure: Samples
    load: Samples
    force: Samples


class AbstractMechanism(eqx.Module):
    """Contract: physics that a model may leave out. Built without arguments it has no effect."""

    id: eqx.AbstractClassVar[str]
    about: eqx.AbstractClassVar[Description]


class AbstractShape(AbstractMechanism):
    """Contract: a geometry that wraps another."""

    def prepared(self, thread_length: Scalar, turns: Scalar) -> AbstractShape:
        """The same for one braid, with what all its states share worked out once."""
        return self

    def held(self) -> AbstractShape:
        """The same, without derivatives by its numbers."""
        return jax.lax.stop_gradient(self)

    def near(self, length: Scalar, thread: Scalar) -> AbstractShape:
        """The shape as it is needed at one length (m) and thread length (m), with its derivatives there."""
        return self

    @abc.abstractmethod
    def shape(self, state: State) -> State:
        """The state with its volume, radius and diameter changed."""


class AbstractStore(AbstractMechanism):
    """Contract: an energy that the muscle stores beside its threads."""

    @abc.abstractmethod
    def energy(self, state: State) -> Array:
        """Stored energy, J."""


class AbstractYielding(AbstractMechanism):
    """Contract: threads that give way under load.

    Strain as a function of load, not load of strain: the pull of pressure is known, and at the
    neutral value the strain is zero instead of a stiffness infinite.
    """

    @abc.abstractmethod
    def strain(self, load: Scalar) -> Array:
        """Strain of the threads at a load (N, all threads together, not negative)."""


class AbstractMemory(AbstractMechanism):
    """Contract: a stress that the past leaves on strains of the mechanism's own choice."""

    @abc.abstractmethod
    def strains(self, state: State, pressure: Scalar) -> Float[Array, "k ..."]:
        """The strains at one instant, or at many, in whatever unit makes stress × strain an energy, J."""

    @abc.abstractmethod
    def stresses(self, history: History, strains: Float[Array, "n k"], past: Past) -> Float[Array, "n k"]:
        """The stress on each strain at every sample; multiplied with it, J."""


class AbstractSlip(AbstractMechanism):
    """Contract: threads that were lengthened for good."""

    @abc.abstractmethod
    def extension(self, history: History, past: Past) -> Samples:
        """Share by which the resting threads are longer at every sample."""


class AbstractLine(AbstractMechanism):
    """Contract: a pressure that is not the same inside the muscle as where it was measured."""

    @abc.abstractmethod
    def pressure(self, history: History, past: Past) -> Samples:
        """Pressure inside, Pa, from the past with the measured one."""


class AbstractSensor(AbstractMechanism):
    """Contract: what a bench makes of the truth. Each method passes on what it does not change."""

    def undo(self, pressure: Samples, length: Samples, history: History) -> tuple[Samples, Samples]:
        """True pressure (Pa) and length (m) from the recorded ones."""
        return pressure, length

    def read(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        """Recorded force (N) and diameter (m) from the true ones, and what the muscle went through."""
        return force, diameter


class AbstractRig(AbstractMechanism):
    """Contract: a bench that gives way, so that the muscle is shorter than recorded."""

    @abc.abstractmethod
    def deflection(self, force: Scalar) -> Array:
        """How much shorter, m, at a force (N)."""

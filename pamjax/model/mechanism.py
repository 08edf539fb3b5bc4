"""Base classes of the mechanisms: the kinds of effects that a muscle model may include.

A mechanism is one class in one file, with its parameters, its equation and its description. The defaults of
its parameters are neutral: `Mechanism()` has no effect. Each mechanism is of one kind:

    class                     method                    result                         several of one kind
    AbstractShape             shape(state)              state with another geometry    applied in order
    AbstractStoredEnergy      energy(state)             stored energy, J               summed
    AbstractThreadCompliance  strain(load)              thread strain, 1               summed
    AbstractMemory            stresses(history, ...)    stresses on its strains        summed
    AbstractSlip              extension(history, past)  permanent thread extension, 1  summed
    AbstractPressureLoss      pressure(history, past)   pressure inside, Pa            applied in order
    AbstractSensor            to_true_inputs(...)       true inputs                    applied in order
                              to_recorded_outputs(...)  recorded outputs               applied in order
    AbstractRigCompliance     deflection(force)         deflection of the rig, m       summed

A memory has a generalised strain e(state) and a stress s, computed from earlier samples and constant during
the balance. The product s · e is added to the potential, whose derivatives are force and thread load. The
work over a closed path is ∮ s de. A stress that dissipates energy on its strain thus dissipates energy of the
muscle.
"""

from __future__ import annotations

import abc
from dataclasses import dataclass
from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from pamjax.model.form_error import FormError
from pamjax.model.history import History
from pamjax.model.state import State
from pamjax.parameter import Scalar

Samples = Float[Array, " n"]


@dataclass(frozen=True)
class Description:
    """The description of a mechanism that `pamjax explain` prints.

    Attributes:
        title: name, as "friction between braid threads".
        equation: plain text for a terminal.
        signature: its effect on force and diameter.
        neglects: effects that are not part of it.
        confusable: ids of mechanisms with similar effects.
        experiment: how to distinguish it from them.
        source: paper and equation, or its derivation.
    """

    title: str
    equation: str
    signature: str
    neglects: str
    confusable: tuple[str, ...]
    experiment: str
    source: str


class Past(eqx.Module):
    """The states of a muscle at every sample, the input of mechanisms with memory.

    Attributes:
        state: geometry; fields of shape (n,).
        pressure: (n,) pressure inside the muscle, Pa.
        load: (n,) pull of all threads together, N.
        force: (n,) tension, N.
    """

    state: State
    pressure: Samples
    load: Samples
    force: Samples


class AbstractMechanism(eqx.Module):
    """An effect that a model may include. Built without arguments it has no effect."""

    id: eqx.AbstractClassVar[str]
    about: eqx.AbstractClassVar[Description]
    #: Where the equation may be inexact; exact without.
    form_error: ClassVar[FormError] = FormError()
    #: Whether its effect depends on time. A static map cannot test it.
    needs_time: ClassVar[bool] = False
    #: Whether its effect at a sample depends on pressure or length at other samples.
    mixes_samples: ClassVar[bool] = False
    #: Whether its effect depends on the speed of the muscle, or on the flow into it.
    uses_rate: ClassVar[bool] = False

    def prepare(self, thread_length: Scalar, turns: Scalar) -> AbstractMechanism:
        """Return the mechanism for one braid, with the quantities that all its states share computed."""
        return self


class AbstractShape(AbstractMechanism):
    """A change of the geometry."""

    @abc.abstractmethod
    def shape(self, state: State) -> State:
        """Return the state with another volume, radius and diameter."""


class AbstractStoredEnergy(AbstractMechanism):
    """A stored energy other than that of the threads."""

    @abc.abstractmethod
    def energy(self, state: State) -> Array:
        """Return the stored energy, J."""


class AbstractThreadCompliance(AbstractMechanism):
    """A strain of the threads under load.

    The law gives strain from load, not load from strain: at the neutral value the strain is zero, and the
    stiffness would be infinite.
    """

    @abc.abstractmethod
    def strain(self, load: Scalar) -> Array:
        """Return the strain at a load of all threads together (N, not negative)."""


class AbstractMemory(AbstractMechanism):
    """A stress that depends on earlier samples, on strains that the mechanism defines."""

    needs_time: ClassVar[bool] = True
    mixes_samples: ClassVar[bool] = True

    @abc.abstractmethod
    def strains(self, state: State, pressure: Scalar) -> Float[Array, "k ..."]:
        """Return the k strains at one instant or at many, in units for which stress × strain is in J."""

    @abc.abstractmethod
    def stresses(self, history: History, strains: Float[Array, "n k"], past: Past) -> Float[Array, "n k"]:
        """Return the stress on each strain at every sample; stress × strain is in J."""


class AbstractSlip(AbstractMechanism):
    """A permanent extension of the threads."""

    needs_time: ClassVar[bool] = True
    mixes_samples: ClassVar[bool] = True

    @abc.abstractmethod
    def extension(self, history: History, past: Past) -> Samples:
        """Return the relative extension of the unloaded threads at every sample, (n,)."""


class AbstractPressureLoss(AbstractMechanism):
    """A difference between the measured pressure and that inside the muscle."""

    @abc.abstractmethod
    def pressure(self, history: History, past: Past) -> Samples:
        """Return the pressure inside, (n,) Pa; `past` has the measured pressure."""


class AbstractSensor(AbstractMechanism):
    """An error of a sensor. Each method returns the other channels unchanged."""

    def to_true_inputs(self, pressure: Samples, length: Samples, history: History) -> tuple[Samples, Samples]:
        """Return true pressure (Pa) and length (m) from the recorded ones."""
        return pressure, length

    def to_recorded_outputs(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        """Return recorded force (N) and diameter (m) from the true ones and the states of the muscle."""
        return force, diameter


class AbstractRigCompliance(AbstractMechanism):
    """A deflection of the rig, so that the muscle is shorter than recorded."""

    @abc.abstractmethod
    def deflection(self, force: Scalar) -> Array:
        """Return the deflection, m, at a force (N)."""

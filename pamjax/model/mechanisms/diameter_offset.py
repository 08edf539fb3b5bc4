"""Difference between the measured outer diameter and that of the mid-thread surface."""

from __future__ import annotations

import math
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model.form_error import FormError, list_powers
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Past, Samples
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter

#: Smallest diameter over that at 54.7°, for a finite coat on a straight muscle.
_MIN_RELATIVE_DIAMETER = 0.25


class DiameterOffset(AbstractSensor):
    """An offset, recorded minus mid-thread diameter, that decreases as pressure flattens the yarns:

        D_recorded = D + d (D°/D)^κ − c P / (P + Ph),   D° = B/(√3 πN)

        d   offset      m   error of the diameter without pressure, at the diameter D°
        κ   thinning    1   power with which a coat becomes thinner as the braid widens
        D°              m   diameter at the braid angle 54.7°, that of full contraction
        c   compaction  m   decrease of this error at high pressure
        Ph  half        Pa  pressure at which half of c is reached

    A camera measures the outer surface of the braid: d is one braid thickness (half on either side), plus
    twice the thickness of a coat. Pressure flattens yarns at their crossings, so that the outer surface
    approaches the mid-thread surface. Rubber on the braid conserves its volume: κ = 1 if its length is
    constant, and about 0.7 if it shortens with the braid. Thread and length determine the mid-thread radius.
    Neutral: d = c = 0. Neglects: a scale error of the camera, flattening that remains after the first cycle,
    the effect of flat yarns on crimp. Below D°/4 (angles above 81°) the coat has the thickness at D°/4.
    Source: by definition; its size from Chambers & Wereley, Actuators 10, 72 (2021); compaction as in
    Zhang & Philen, J. Intell. Mater. Syst. Struct. (2012), its saturating form an estimate;
    thinning: constant volume of rubber.
    """

    id: ClassVar[str] = "diameter_offset"
    about: ClassVar[Description] = Description(
        title="thread and wall thickness in the measured diameter",
        equation="D_recorded = D + d (D0/D)^k - c P/(P + Ph),   D0 = B/(sqrt(3) pi N)",
        signature="The diameter error is the same at every contraction, or decreases with it if a coat"
        " becomes thinner. Without compaction, it is the same at every pressure. Compaction of the yarns"
        " reduces it by some hundredths of a millimetre, mostly at low pressure. Force is not affected.",
        neglects="a scale error of the camera, permanent flattening of yarns",
        confusable=("length_offset", "thread_crimp", "thread_slip", "end_taper"),
        experiment="Measure the braid with a caliper, or a steel bar of known diameter in the same picture."
        " Over a stroke, a zero error of length also changes force, most at rest length. For compaction,"
        " measure the diameter at rest length at several pressures below 200 kPa, where crimp increases it.",
        source="by definition: recorded minus mid-thread diameter; compaction as in Zhang & Philen 2012",
    )
    #: A coat of rubber becomes thinner as the muscle widens.
    form_error: ClassVar[FormError] = FormError(list_powers("length", 2))

    offset: Scalar = parameter(
        "m", show="mm", low=-0.005, high=0.02, neutral=0.0, about="recorded minus mid-thread diameter",
        source="0.2 to 0.8 mm for a bare braid, some mm for a braid inside rubber", default=0.0,
    )  # fmt: skip
    compaction: Scalar = parameter(
        "m", show="mm", low=0.0, high=1e-3, neutral=0.0,
        about="decrease of the outer diameter as yarns flatten",
        source="an estimate: 0.04 to 0.2 mm, both sides together", default=0.0,
    )  # fmt: skip
    half: Scalar = parameter(
        "Pa", show="kPa", low=1e4, high=1e6, scale="log",
        about="pressure at which half of the compaction is reached", source="an estimate: 50 to 200 kPa",
        default=1e5,
    )  # fmt: skip

    thinning: Scalar = parameter(
        "1", low=0.0, high=1.0, is_refinement=True,
        about="power with which a coat becomes thinner as the braid widens",
        source="0 for a bare braid, 0.7 to 1 for a braid inside rubber", default=0.0,
    )  # fmt: skip

    def to_recorded_outputs(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        inflating = jnp.where(past.pressure > 0, past.pressure, 0.0)
        compaction = self.compaction * inflating / (inflating + self.half)
        widening = jnp.maximum(_compute_relative_diameter(past.state), _MIN_RELATIVE_DIAMETER)
        return force, diameter + self.offset * widening**-self.thinning - compaction


def _compute_relative_diameter(state: State) -> Array:
    """Return the diameter over that at the braid angle 54.7°."""
    return math.sqrt(3) * jnp.pi * state.turns * state.diameter / state.thread

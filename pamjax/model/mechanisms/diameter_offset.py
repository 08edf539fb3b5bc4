"""Difference between the measured outer diameter and that of the mid-thread surface."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model.form_error import FormError, list_powers
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Past, Samples
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter

#: Smallest lateral area over that at 54.7°: a straight muscle has none.
MIN_RELATIVE_AREA = 0.2


class DiameterOffset(AbstractSensor):
    """An offset, recorded minus mid-thread diameter, that decreases as pressure flattens the yarns:

        D_recorded = D + d (1 − k + k A°/A) − c P / (P + Ph),   A = π D L

        d   offset      m   error of the diameter without pressure, at the braid angle 54.7°
        k   coat        1   share of d that is a coat of constant volume: it becomes thinner as A increases
        A°              m²  lateral area A at 54.7°, the angle of full contraction, √2 B²/(3N)
        c   compaction  m   decrease of this error at high pressure
        Ph  half        Pa  pressure at which half of c is reached

    A camera measures the outer surface of the braid: d is one braid thickness (half on either side), plus
    twice the thickness of a coat. Pressure flattens yarns at their crossings, so that the outer surface
    approaches the mid-thread surface. Rubber on the braid conserves its volume, so that it becomes thinner
    where the braid has a larger area. Thread and length determine the mid-thread radius. Neutral: d = c = 0.
    Neglects: a scale error of the camera, flattening that remains after the first cycle, the effect of flat
    yarns on crimp; A less than a fifth of A° (angles above 85°) counts as a fifth.
    Source: by definition; its size from Chambers & Wereley, Actuators 10, 72 (2021); compaction as in
    Zhang & Philen, J. Intell. Mater. Syst. Struct. (2012), its saturating form an estimate;
    coat: constant volume of rubber.
    """

    id: ClassVar[str] = "diameter_offset"
    about: ClassVar[Description] = Description(
        title="thread and wall thickness in the measured diameter",
        equation="D_recorded = D + d (1 - k + k A0/A) - c P/(P + Ph),   A = pi D L",
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

    coat: Scalar = parameter(
        "1", low=0.0, high=1.0, is_refinement=True,
        about="share of the offset that is a coat of constant volume",
        source="0 for a bare braid, 1 for a braid inside rubber", default=0.0,
    )  # fmt: skip

    def to_recorded_outputs(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        inflating = jnp.where(past.pressure > 0, past.pressure, 0.0)
        compaction = self.compaction * inflating / (inflating + self.half)
        thickness = 1 - self.coat + self.coat / _compute_relative_area(past.state)
        return force, diameter + self.offset * thickness - compaction


def _compute_relative_area(state: State) -> Array:
    """Return the lateral area of a muscle over that at the braid angle 54.7°."""
    area = jnp.pi * state.diameter * state.length
    return jnp.maximum(area * 3 * state.turns / (jnp.sqrt(2.0) * state.thread**2), MIN_RELATIVE_AREA)

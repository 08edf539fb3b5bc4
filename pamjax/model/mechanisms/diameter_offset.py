"""The measured outer diameter is not that of the threads' middle."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Past, Samples
from pamjax.parameter import Scalar, parameter


class DiameterOffset(AbstractSensor):
    """An offset, recorded minus that of the mid-thread surface, that shrinks as yarns flatten:

        D_recorded = D + d − c P / (P + Ph)

        d   offset      m   by how much the diameter reads too large without pressure
        c   compaction  m   by how much less at high pressure
        Ph  half        Pa  pressure at which half of c is reached

    A camera sees the outside of the braid: d is one thickness of it (half on either side), and a coat's
    twice over. Pressure flattens yarns where they cross, so that the outside comes closer to mid-thread,
    whose own radius is tied to thread and length. Neutral: d = c = 0. What it leaves out: a scale error of
    the camera, flattening that stays after the first cycle, and what flat yarns do to crimp.
    Source: by definition; its size from Chambers & Wereley, Actuators 10, 72 (2021); compaction as in
    Zhang & Philen, J. Intell. Mater. Syst. Struct. (2012), its saturating form an estimate.
    """

    id: ClassVar[str] = "diameter_offset"
    about: ClassVar[Description] = Description(
        title="the measured outer diameter includes thread and wall",
        equation="D_recorded = D + d - c P/(P + Ph)",
        signature="Diameter is wrong by the same amount at every contraction; at every pressure too, unless"
        " yarns flatten, which takes some hundredths of a millimetre away, most of it at low pressure."
        " Force is right.",
        leaves_out="a scale error of the camera; flattening that stays",
        confusable=("length_offset", "thread_crimp", "thread_slip", "end_taper"),
        experiment="A caliper on the braid, or the diameter of a steel bar of known size in the same"
        " picture; over a stroke a wrong zero of length shows in force too, and most at rest. Flattening:"
        " diameter at rest at several pressures below 200 kPa, where crimp makes it grow.",
        source="by definition: recorded minus mid-thread diameter; compaction after Zhang & Philen 2012",
    )

    offset: Scalar = parameter(
        "m", show="mm", low=-0.005, high=0.02, neutral=0.0, about="recorded minus mid-thread diameter",
        source="0.2 to 0.8 mm for a bare braid, some mm where the braid is inside rubber", default=0.0,
    )  # fmt: skip
    compaction: Scalar = parameter(
        "m", show="mm", low=0.0, high=1e-3, neutral=0.0, about="by how much it shrinks as yarns flatten",
        source="an estimate: 0.04 to 0.2 mm on both sides together", default=0.0,
    )  # fmt: skip
    half: Scalar = parameter(
        "Pa", show="kPa", low=1e4, high=1e6, scale="log", about="pressure at which half of that is reached",
        source="an estimate: 50 to 200 kPa", default=1e5,
    )  # fmt: skip

    def read(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        pressed = jnp.where(past.pressure > 0, past.pressure, 0.0)
        return force, diameter + self.offset - self.compaction * pressed / (pressed + self.half)

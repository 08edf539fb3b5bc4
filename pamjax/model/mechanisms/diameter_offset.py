"""The measured outer diameter is not that of the threads' middle."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.history import History
from pamjax.model.mechanism import About, AbstractSensor, Samples
from pamjax.parameter import Scalar, parameter


class DiameterOffset(AbstractSensor):
    """An offset, recorded minus that of the mid-thread surface: D_recorded = D + d.

        d  offset  m  by how much the diameter reads too large

    A camera sees the outside of the braid: d is one thickness of it (half on either side), and a coat's
    twice over. Neutral: d = 0. What it leaves out: a scale error of the camera, and yarns that flatten
    under pressure, which make d smaller by hundredths of a millimetre.
    Source: by definition; its size from Chambers & Wereley, Actuators 10, 72 (2021).
    """

    id: ClassVar[str] = "diameter_offset"
    about: ClassVar[About] = About(
        title="the measured outer diameter includes thread and wall",
        equation="D_recorded = D + d",
        signature="Diameter is wrong by the same amount at every pressure and contraction. Force is right.",
        leaves_out="a scale error of the camera, yarns that flatten under pressure",
        confusable=("length_offset", "thread_crimp", "thread_slip", "end_taper"),
        experiment="A caliper on the braid, or the diameter of a steel bar of known size in the same"
        " picture; over a stroke a wrong zero of length shows in force too, and most at rest.",
        source="by definition: recorded minus mid-thread diameter",
    )

    offset: Scalar = parameter(
        "m", show="mm", low=-0.005, high=0.02, neutral=0.0, about="recorded minus mid-thread diameter",
        source="0.2 to 0.8 mm for a bare braid, some mm where the braid is inside rubber", default=0.0,
    )  # fmt: skip

    def read(self, force: Samples, diameter: Samples, history: History) -> tuple[Samples, Samples]:
        return force, diameter + self.offset

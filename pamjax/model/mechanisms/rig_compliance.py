"""The rig stretches under load, so that the muscle is shorter than recorded."""

from __future__ import annotations

from typing import ClassVar

from jaxtyping import Array

from pamjax.model.mechanism import About, AbstractRig
from pamjax.parameter import Scalar, parameter


class RigCompliance(AbstractRig):
    """Frame, grips and load cell as one spring in series: L = L_recorded − c F.

        c  compliance  m/N  deflection of the rig under a newton

    The force is that of the shortened muscle: the balance solves both at once. Neutral: c = 0, a rigid
    rig. What it leaves out: play, a cable that stiffens, a rig that bends sideways.
    Source: derived here.
    """

    id: ClassVar[str] = "rig_compliance"
    about: ClassVar[About] = About(
        title="the rig stretches under load",
        equation="L = L_recorded - c F",
        signature="Force is lost as the square of pressure, most at rest and nothing at free contraction;"
        " diameter is larger where force is high.",
        leaves_out="play, stiffening cables, sideways bending",
        confusable=("braid_elasticity", "length_offset", "force_gain"),
        experiment="A steel bar in place of the muscle; or free contraction, where the rig bears nothing and"
        " stretched threads still show.",
        source="derived here",
    )

    compliance: Scalar = parameter(
        "m/N", show="mm/kN", low=0.0, high=1e-4, neutral=0.0, about="deflection under a newton",
        source="0.005 mm/kN for a servo-hydraulic frame to 3 mm/kN with cables; more for small cells",
        default=0.0,
    )  # fmt: skip

    def deflection(self, force: Scalar) -> Array:
        return self.compliance * force

"""The rig stretches under load, so that the muscle is shorter than recorded."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model.mechanism import AbstractRig, Description
from pamjax.parameter import Scalar, parameter


class RigCompliance(AbstractRig):
    """Frame, grips and load cell as a spring in series, and what they give way by until they sit:

        L = L_recorded − c F − s [1 − e^(−F/Fs)]

        c   compliance  m/N  deflection of the rig under a newton
        s   seat        m    by which cables, pins and grips give way until they sit
        Fs  seat_force  N    force at which 63 % of that is done

    The force is that of the shortened muscle: the balance solves both at once. Neutral: c = s = 0, a
    rigid rig. What it leaves out: play that is free of force, a rig that bends sideways.
    Source: derived here.
    """

    id: ClassVar[str] = "rig_compliance"
    about: ClassVar[Description] = Description(
        title="the rig stretches under load",
        equation="L = L_recorded - c F - s [1 - exp(-F/Fs)]",
        signature="Force is lost as the square of pressure, most at rest and nothing at free contraction;"
        " diameter is larger where force is high.",
        leaves_out="play that is free of force, sideways bending",
        confusable=("braid_elasticity", "length_offset", "force_gain"),
        experiment="A steel bar in place of the muscle; or free contraction, where the rig bears nothing and"
        " stretched threads still show.",
        source="derived here",
    )

    compliance: Scalar = parameter(
        "m/N", show="mm/kN", low=0.0, high=1e-4, neutral=0.0, about="give of the rig over its pull",
        source="0.005 mm/kN for a servo-hydraulic frame to 3 mm/kN with cables; more for small cells",
        default=0.0,
    )  # fmt: skip

    seat: Scalar = parameter(
        "m", show="mm", low=0.0, high=0.01, neutral=0.0, about="by which the rig gives way until it sits",
        source="knots, pins and grips: tenths of a millimetre to some", default=0.0,
    )  # fmt: skip
    seat_force: Scalar = parameter(
        "N", low=1.0, high=1e4, scale="log", about="force at which 63 % of that is done",
        source="a tenth of the muscle's force to all of it", default=100.0,
    )  # fmt: skip

    def deflection(self, force: Scalar) -> Array:
        pulled = jnp.maximum(force, 0.0)
        return self.compliance * force - self.seat * jnp.expm1(-pulled / self.seat_force)

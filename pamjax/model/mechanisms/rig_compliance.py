"""Compliance of the test rig: under load the muscle is shorter than recorded."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model.mechanism import AbstractRigCompliance, Description
from pamjax.parameter import Scalar, parameter


class RigCompliance(AbstractRigCompliance):
    """Frame, grips and load cell as a spring in series, with a displacement until their parts are in contact:

        L = L_recorded − c F − s [1 − e^(−F/Fs)]

        c   compliance  m/N  deflection of the rig per newton
        s   seat        m    displacement of cables, pins and grips until they are in contact
        Fs  seat_force  N    force at which 63 % of this displacement is reached

    The force is that of the shortened muscle: the balance solves both together. Neutral: c = s = 0, a
    rigid rig. Neglects: backlash without force, sideways bending of the rig.
    Source: derived here.
    """

    id: ClassVar[str] = "rig_compliance"
    about: ClassVar[Description] = Description(
        title="compliance of the test rig",
        equation="L = L_recorded - c F - s [1 - exp(-F/Fs)]",
        signature="The force loss increases with the square of pressure. It is largest at rest length, and"
        " zero at free contraction. The diameter is larger where force is high.",
        neglects="backlash without force, sideways bending",
        confusable=("braid_elasticity", "length_offset", "force_gain"),
        experiment="Replace the muscle by a steel bar. Or measure at free contraction, where the rig has no"
        " load and stretched threads still have an effect.",
        source="derived here",
    )

    compliance: Scalar = parameter(
        "m/N", show="mm/kN", low=0.0, high=1e-4, neutral=0.0, about="deflection of the rig per unit of force",
        source="0.005 mm/kN for a servo-hydraulic frame to 3 mm/kN with cables; more for small load cells",
        default=0.0,
    )  # fmt: skip

    seat: Scalar = parameter(
        "m", show="mm", low=0.0, high=0.01, neutral=0.0,
        about="displacement of the rig until its parts are in contact",
        source="knots, pins and grips: tenths of a millimetre to some millimetres", default=0.0,
    )  # fmt: skip
    seat_force: Scalar = parameter(
        "N", low=1.0, high=1e4, scale="log", about="force at which 63 % of the seat displacement is reached",
        source="from a tenth of the muscle's force to all of it", default=100.0,
    )  # fmt: skip

    def deflection(self, force: Scalar) -> Array:
        tension = jnp.maximum(force, 0.0)
        return self.compliance * force - self.seat * jnp.expm1(-tension / self.seat_force)

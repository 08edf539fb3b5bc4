"""Threads stretch in proportion to load."""

from __future__ import annotations

from typing import ClassVar

from jaxtyping import Array

from pamjax.model.mechanism import AbstractYielding, Description
from pamjax.parameter import Scalar, parameter


class BraidElasticity(AbstractYielding):
    """Linear threads: ε = C T.

        C  compliance  1/N  strain of all threads together under a newton, 1 / (n E A)
        T  load        N    pull of all threads together

    Neutral: C = 0, the inelastic braid. What it leaves out: crimp, slip, creep.
    Source: Chambers & Wereley, Actuators 2022, 11, 219, Eqs. 5-7.
    """

    id: ClassVar[str] = "braid_elasticity"
    about: ClassVar[Description] = Description(
        title="threads stretch in proportion to load",
        equation="B = B0 (1 + C T),   T = P L B / (2 pi N^2),   C = 1 / (n E A)",
        signature="Force is lost as the square of pressure, most at rest and still 60 % of that at free"
        " contraction; diameter grows with pressure, most at rest. No loop, no history.",
        leaves_out="the soft toe of a crimped thread, slip and creep",
        confusable=("rig_compliance", "thread_crimp", "length_offset", "thread_slip"),
        experiment="Diameter against pressure at rest length, up and down; the rig's share vanishes at free"
        " contraction, a slip stays when the pressure is gone.",
        source="Chambers & Wereley, Actuators 2022, 11, 219, Eqs. 1-10",
    )

    compliance: Scalar = parameter(
        "1/N", low=0.0, high=1e-3, neutral=0.0, about="strain of all threads under a newton, 1/(n E A)",
        source="from infinitely stiff to a soft nylon braid of a miniature muscle", default=0.0,
    )  # fmt: skip

    def strain(self, load: Scalar) -> Array:
        return self.compliance * load

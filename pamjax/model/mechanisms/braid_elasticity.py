"""Elastic stretch of the threads, in proportion to load."""

from __future__ import annotations

from typing import ClassVar

from jaxtyping import Array

from pamjax.model.mechanism import AbstractThreadCompliance, Description
from pamjax.parameter import Scalar, parameter


class BraidElasticity(AbstractThreadCompliance):
    """Linear threads: ε = C T.

        C  compliance  1/N  strain of all threads together per newton, 1 / (n E A)
        T  load        N    pull of all threads together

    Neutral: C = 0, the inelastic braid. Neglects: crimp, slip, creep.
    Source: Chambers & Wereley, Actuators 2022, 11, 219, Eqs. 5-7.
    """

    id: ClassVar[str] = "braid_elasticity"
    about: ClassVar[Description] = Description(
        title="elastic stretch of the threads",
        equation="B = B0 (1 + C T),   T = P L B / (2 pi N^2),   C = 1 / (n E A)",
        signature="The force loss increases with the square of pressure. It is largest at rest length, and"
        " 60 % of that at free contraction. The diameter increases with pressure, most at rest length. There"
        " is no hysteresis, and no dependence on history.",
        neglects="the soft toe of a crimped thread, slip, creep",
        confusable=("rig_compliance", "thread_crimp", "length_offset", "thread_slip"),
        experiment="Measure the diameter against pressure at rest length, up and down. Rig compliance has no"
        " effect at free contraction. A slip remains after the pressure is released.",
        source="Chambers & Wereley, Actuators 2022, 11, 219, Eqs. 1-10",
    )

    compliance: Scalar = parameter(
        "1/N", low=0.0, high=1e-3, neutral=0.0, about="strain of all threads together per newton, 1/(n E A)",
        source="from an infinitely stiff braid to a soft nylon braid of a miniature muscle", default=0.0,
    )  # fmt: skip

    def strain(self, load: Scalar) -> Array:
        return self.compliance * load

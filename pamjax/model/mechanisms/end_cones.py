"""Conical ends of a muscle, an alternative to `end_taper` for comparison."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from pamjax.model.mechanism import AbstractShape, Description
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter


class EndCones(AbstractShape):
    """A cylinder with conical ends. The height of a cone is κ times the increase of radius:

        V −= (2π/3) κ (R − Rf)² (2R + Rf),    D_mean −= 2 κ (R − Rf)² / L

        κ   height  1   height of a cone over R − Rf: the cotangent of its angle to the axis
        Rf  radius  m   radius of the fittings, to the middle of the thread

    so that ΔF = −κ P (R − Rf) L / (πN²). This is zero where fittings and muscle are equally wide, and grows
    with contraction. The force loss of the net in `end_taper` is largest at mid-stroke. Where the fittings
    are wider than the muscle, the same formula adds force, as the net does.

    It is an alternative to `end_taper`; the two are not combined. Neutral: κ = 0. Neglects: the
    constant length of the threads, which excludes such cones; the wider middle, which stretches the bladder.
    Source: Tsagarakis & Caldwell, ICRA 2000, in the form that changes the volume only; force derived here.
    """

    id: ClassVar[str] = "end_cones"
    about: ClassVar[Description] = Description(
        title="conical ends, an alternative to end_taper",
        equation="V = V_cyl - (2 pi/3) k (R - Rf)^2 (2 R + Rf);   dF = -k P (R - Rf) L / (pi N^2)",
        signature="The force loss is proportional to pressure. It is zero at rest length if the fittings are"
        " as wide as the muscle, and increases with contraction. The mean diameter is smaller than that of a"
        " cylinder.",
        neglects="the constant length of the threads, the wider middle",
        confusable=("end_taper", "diameter_offset", "length_offset", "pressure_gain"),
        experiment="Record a stroke to free contraction. The force loss of cones increases until the end,"
        " that of a net is largest at mid-stroke.",
        source="Tsagarakis & Caldwell 2000, volume only; force derived here",
    )

    height: Scalar = parameter(
        "1", low=0.0, high=5.0, neutral=0.0, about="height of a cone over the increase of radius",
        source="of the order of one in drawings of muscles; 0 is a cylinder", default=0.0,
    )  # fmt: skip
    radius: Scalar = parameter(
        "m", show="mm", low=1e-4, high=0.5, scale="log",
        about="radius of the fittings, to the middle of the thread",
        source="as wide as the muscle at rest, or a little less", default=12.67e-3,
    )  # fmt: skip

    def shape(self, state: State) -> State:
        squared = self.height * (state.radius - self.radius) ** 2
        return eqx.tree_at(
            lambda s: (s.diameter, s.volume),
            state,
            (
                state.diameter - 2 * squared / state.length,
                state.volume - 2 * jnp.pi / 3 * squared * (2 * state.radius + self.radius),
            ),
        )

"""The textbook's ends of a muscle: cones that no thread lies on, for comparison with the net."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from pamjax.model.mechanism import AbstractShape, Description
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter


class EndCones(AbstractShape):
    """A cylinder whose ends are cut off as cones, as high as κ times what the radius grows by:

        V −= (2π/3) κ (R − Rf)² (2R + Rf),    D_mean −= 2 κ (R − Rf)² / L

        κ   height  1   of a cone over R − Rf: the cotangent of its angle to the axis
        Rf  radius  m   of the fittings, to mid-thread

    so that ΔF = −κ P (R − Rf) L / (πN²): nothing where the fittings are as wide as the muscle, and more the
    further it contracts, where the net has its most at mid-stroke. The formula goes on as it stands where
    fittings are wider than the muscle, and there adds force, as the net does.

    An alternative to `end_taper`, never beside it. Neutral: κ = 0. What it leaves out: threads, none of
    which can lie on such a cone and keep its length; the wider middle that the bladder sees.
    Source: Tsagarakis & Caldwell, ICRA 2000, in the form that changes the volume only; force derived here.
    """

    id: ClassVar[str] = "end_cones"
    about: ClassVar[Description] = Description(
        title="the ends taken for cones, a textbook's stand-in for end_taper",
        equation="V = V_cyl - (2 pi/3) k (R - Rf)^2 (2 R + Rf);   dF = -k P (R - Rf) L / (pi N^2)",
        signature="Force is lost in proportion to pressure, nothing at rest if the fittings are as wide as"
        " the muscle, and more the further it contracts. Mean diameter is smaller than a cylinder's.",
        leaves_out="that threads keep their length; the wider middle",
        confusable=("end_taper", "diameter_offset", "length_offset", "pressure_gain"),
        experiment="A stroke to free contraction: cones take ever more, the ends of a net the most at"
        " mid-stroke.",
        source="Tsagarakis & Caldwell 2000, volume only; force derived here",
    )

    height: Scalar = parameter(
        "1", low=0.0, high=5.0, neutral=0.0, about="height of a cone over what the radius grows by",
        source="of the order of one where muscles were drawn; 0 is a cylinder", default=0.0,
    )  # fmt: skip
    radius: Scalar = parameter(
        "m", show="mm", low=1e-4, high=0.5, scale="log", about="of the fittings, to mid-thread",
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

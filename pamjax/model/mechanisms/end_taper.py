"""Taper of the muscle near its fittings, where the braid is not a cylinder."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from pamjax.model.form_error import FormError, list_powers
from pamjax.model.mechanism import AbstractShape, Description
from pamjax.model.net_table import NetTable, tabulate_net
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter


class EndTaper(AbstractShape):
    """The braid as a net that is clamped on the fittings and bulges freely between them (`net.py`):

        V = V_cylinder + s (V_net − V_cylinder),   and the diameters in the same way

        s   share        1   share of the net: 0 is a cylinder, 1 is the frictionless net
        Rf  radius       m   radius at which the braid is clamped

    Refinement: truncated cones of a fixed height h are added at both ends, from Rf to the radius R of the
    cylinder. Their force loss is largest near rest length, also with fittings as wide as the muscle:

        V −= (2π/3) h (R − Rf) (2R + Rf),    D_mean −= 2 h (R − Rf) / L

        h   cone_height  m   height of each cone; 0 is none

    Force and thread load follow from the volume, so that F = −P ∂V/∂L as for any conservative muscle. The
    diameter is the mean along the axis, as in a recording. Bladder and friction depend on the radius at
    mid-length, where the wall is stretched most.

    No radius gives a cylinder at every contraction, therefore the share is a parameter. Neutral: s = 0 and
    h = 0.
    Neglects: friction of the crossings, and threads clamped at an angle or over a length. It also neglects
    the axial pull of the bladder, which straightens the meridian, and the shorter stretched part of the
    bladder. For muscles shorter than tan²θ diameters it is an approximation.
    The simpler `end_cones` and `contraction_factor` are available for comparison.
    Source: derived here, as the maximum volume of a pin-jointed net; compared with a net of rings. Cones:
    Tsagarakis & Caldwell, ICRA 2000; Doumit, Fahim & Munro, IEEE Trans. Robot. 25, 1282 (2009).
    """

    id: ClassVar[str] = "end_taper"
    about: ClassVar[Description] = Description(
        title="taper of the muscle near its fittings",
        equation="dV = 0 at given L for a pin-jointed net with r = Rf at both ends;"
        "   V = V_cyl + s (V_net - V_cyl) - (2 pi/3) h (R - Rf) (2 R + Rf),   F = -P dV/dL",
        signature="The force loss is proportional to pressure. It is zero at rest length if the fittings are"
        " as wide as the muscle. It is largest at mid-stroke, a tenth to a fifth of the force, and small at"
        " free contraction. Cones of a fixed height h also reduce the force at rest length. The mean diameter"
        " is smaller than that of a cylinder, and the middle is wider.",
        neglects="friction of the crossings, threads clamped at an angle, the bladder's pull on the meridian",
        confusable=("bladder_elasticity", "length_offset", "diameter_offset", "pressure_gain"),
        experiment="Record strokes at two pressures: the force loss by tapered ends increases with pressure,"
        " that by rubber does not. Take a picture to compare the diameter in the middle with the mean"
        " diameter.",
        source="pin-jointed net derived here; tapered ends in general: Tondu & Lopez 2000, Doumit et al."
        " 2009",
    )
    form_error: ClassVar[FormError] = FormError(
        (*list_powers("pressure", 2), *list_powers("length", 3), "pressure length", "pressure length^2")
    )

    share: Scalar = parameter(
        "1", low=0.0, high=1.5, neutral=0.0, about="share of the frictionless net; 0 is a cylinder",
        source="0 to 1 by definition; the limit is higher, so that a fit can exceed 1", default=0.0,
    )  # fmt: skip
    radius: Scalar = parameter(
        "m", show="mm", low=1e-4, high=0.5, scale="log",
        about="radius of the fittings, to the middle of the thread",
        source="as wide as the muscle at rest, or a little less", default=12.67e-3,
    )  # fmt: skip
    cone_height: Scalar = parameter(
        "m", show="mm", low=0.0, high=0.1, neutral=0.0, is_refinement=True,
        about="height of truncated cones at the ends, in addition to the net; 0 is none",
        source="of the order of the diameter in drawings of muscles", default=0.0,
    )  # fmt: skip

    table: NetTable | None = None

    def prepare(self, thread_length: Scalar, turns: Scalar) -> EndTaper:
        table = tabulate_net(thread_length, turns, self.radius)
        return EndTaper(self.share, self.radius, self.cone_height, table)

    def shape(self, state: State) -> State:
        table = self.table if self.table is not None else tabulate_net(state.thread, state.turns, self.radius)
        difference = table(state.length, state.thread)
        narrowed = self.cone_height * (state.radius - self.radius)
        return eqx.tree_at(
            lambda s: (s.radius, s.diameter, s.volume),
            state,
            (
                state.radius + self.share * difference.mid_radius,
                state.diameter + self.share * 2 * difference.mean_radius - 2 * narrowed / state.length,
                state.volume
                + self.share * difference.volume
                - 2 * jnp.pi / 3 * narrowed * (2 * state.radius + self.radius),
            ),
        )

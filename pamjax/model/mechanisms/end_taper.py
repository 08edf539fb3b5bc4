"""The muscle is no cylinder near its fittings."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax

from pamjax.model.mechanism import AbstractShape, Description
from pamjax.model.net_table import NetExpansion, NetTable, tabulate_net
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter


class EndTaper(AbstractShape):
    """The braid as a net that is clamped on the fittings and bulges freely between them (`net.py`):

        V = V_cylinder + s (V_net − V_cylinder),   and the diameters likewise

        s   share   1   of the net: 0 is a cylinder from end to end, 1 the frictionless net
        Rf  radius  m   on which the braid is clamped

    Force and thread load follow from the volume, so that F = −P ∂V/∂L as for any conservative muscle. The
    diameter is the mean one along the axis, which the recording's is; the radius that the bladder and the
    friction of the braid see is that of the middle, where the wall is stretched most.

    No radius makes a cylinder at every contraction, hence the share. Neutral: s = 0. What it leaves out:
    friction of the crossings; muscles shorter than tan²θ diameters, for which
    it is an approximation; threads clamped at an angle, or over a length; the axial pull of the bladder,
    which straightens the meridian; the shorter distance over which the bladder is stretched at the ends.
    For comparison there are the textbook's `end_cones` and `contraction_factor`.
    Source: derived here, as the largest volume of a pin-jointed net; compared with a net of rings.
    """

    id: ClassVar[str] = "end_taper"
    about: ClassVar[Description] = Description(
        title="the muscle is no cylinder near its fittings",
        equation="dV = 0 at given L for a pin-jointed net with r = Rf at both ends;"
        "   V = V_cyl + s (V_net - V_cyl),   F = -P dV/dL",
        signature="Force is lost in proportion to pressure: nothing at rest if the fittings are as wide as"
        " the muscle, most at mid-stroke (a tenth to a fifth of the force), little at free contraction. Mean"
        " diameter is smaller than a cylinder's, the middle is wider.",
        leaves_out="friction of the crossings, clamped angles of thread, the bladder's pull on the meridian",
        confusable=("bladder_elasticity", "length_offset", "diameter_offset", "pressure_gain"),
        experiment="Strokes at two pressures: the ends' share grows with pressure, that of the rubber does"
        " not; and a picture, for the diameter in the middle against the mean.",
        source="pin-jointed net derived here; ends as such: Tondu & Lopez 2000, Doumit et al. 2009",
    )

    share: Scalar = parameter(
        "1", low=0.0, high=1.5, neutral=0.0, about="of the frictionless net; 0 is a cylinder",
        source="0 to 1 by definition; a little more, so that a fit may say that it is too much", default=0.0,
    )  # fmt: skip
    radius: Scalar = parameter(
        "m", show="mm", low=1e-4, high=0.5, scale="log", about="of the fittings, to mid-thread",
        source="as wide as the muscle at rest, or a little less", default=12.67e-3,
    )  # fmt: skip

    table: NetTable | NetExpansion | None = None

    def prepared(self, thread_length: Scalar, turns: Scalar) -> EndTaper:
        return EndTaper(self.share, self.radius, tabulate_net(thread_length, turns, self.radius))

    def held(self) -> EndTaper:
        table = self.table.stop_gradients() if isinstance(self.table, NetTable) else self.table
        return jax.lax.stop_gradient(EndTaper(self.share, self.radius, table))

    def near(self, length: Scalar, thread: Scalar) -> EndTaper:
        if isinstance(self.table, NetTable):
            return EndTaper(self.share, self.radius, self.table.expand_at(length, thread))
        return self

    def shape(self, state: State) -> State:
        table = self.table if self.table is not None else tabulate_net(state.thread, state.turns, self.radius)
        near = table.expand_at(state.length, state.thread) if isinstance(table, NetTable) else table
        more = near(state.length, state.thread)
        return eqx.tree_at(
            lambda s: (s.radius, s.diameter, s.volume),
            state,
            (
                state.radius + self.share * more.mid_radius,
                state.diameter + self.share * 2 * more.mean_radius,
                state.volume + self.share * more.volume,
            ),
        )

"""The pressure in the muscle lags the measured one, in proportion to flow."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractLine, Description, Past, Samples
from pamjax.parameter import Scalar, parameter


class PressureDrop(AbstractLine):
    """A line with a laminar resistance between gauge and muscle: P = P_measured − Z dV/dt.

        Z  impedance  Pa s/m³  pressure lost to a unit of flow into the muscle
        V             m³       volume of the muscle

    Its work is that of a damper: −∮ Z (dV/dt) dV < 0 is lost from the air. The volume is that at the
    measured pressure, right to first order in Z. Neutral: Z = 0. What it leaves out: turbulence,
    choking, the gas that is stored while it is compressed, regulators with a dead zone.
    Source: Hagen-Poiseuille, linearised; derived here.
    """

    id: ClassVar[str] = "pressure_drop"
    about: ClassVar[Description] = Description(
        title="the pressure in the muscle lags the measured one",
        equation="P = P_measured - Z dV/dt;   dF = Z (dV/dL)^2 dL/dt",
        signature="Force is higher while the muscle lengthens and lower while it shortens, in proportion to"
        " speed, the same at every pressure, most at rest and nothing at free contraction.",
        leaves_out="turbulent and choked flow, gas stored in the line, regulator dead zones",
        confusable=("viscous_damping", "braid_friction", "channel_lag"),
        experiment="The loop at free contraction, where volume is constant; a pressure tap at the muscle.",
        source="laminar flow; derived here",
    )

    impedance: Scalar = parameter(
        "Pa*s/m^3", low=0.0, high=1e11, neutral=0.0, about="pressure lost to a unit of flow",
        source="1e8 for a metre of 4 mm tube with fittings; miniature ones have thinner tubes", default=0.0,
    )  # fmt: skip

    def pressure(self, history: History, past: Past) -> Samples:
        return past.pressure - self.impedance * history.rate(past.state.volume)

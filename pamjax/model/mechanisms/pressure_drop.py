"""Pressure drop between gauge and muscle, in proportion to flow."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.form_error import FormError, list_powers
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractPressureLoss, Description, Past, Samples
from pamjax.parameter import Scalar, parameter


class PressureDrop(AbstractPressureLoss):
    """A laminar flow resistance between gauge and muscle: P = P_measured − Z dV/dt.

        Z  impedance  Pa s/m³  pressure drop per unit of flow into the muscle
        V             m³       volume of the muscle

    It dissipates energy as a damper does: −∮ Z (dV/dt) dV < 0. The volume is that at the measured pressure,
    which is correct to first order in Z. Neutral: Z = 0. Neglects: turbulent and choked flow,
    compression of the gas in the line, regulators with a dead zone.
    Source: Hagen-Poiseuille, linearised; derived here.
    """

    id: ClassVar[str] = "pressure_drop"
    about: ClassVar[Description] = Description(
        title="pressure drop between gauge and muscle",
        equation="P = P_measured - Z dV/dt;   dF = Z (dV/dL)^2 dL/dt",
        signature="Force is higher while the muscle lengthens and lower while it shortens. The difference is"
        " proportional to speed, and the same at every pressure. It is largest at rest length, and zero at"
        " free contraction.",
        neglects="turbulent and choked flow, gas stored in the line, dead zones of the regulator",
        confusable=("viscous_damping", "braid_friction", "channel_lag"),
        experiment="Record the loop at free contraction, where volume is constant. Measure the pressure at"
        " the muscle.",
        source="laminar flow; derived here",
    )
    form_error: ClassVar[FormError] = FormError(
        (*list_powers("pressure", 2), "length", *list_powers("speed", 2))
    )

    impedance: Scalar = parameter(
        "Pa*s/m^3", low=0.0, high=1e11, neutral=0.0, about="pressure drop per unit of flow",
        source="1e8 for a metre of 4 mm tube with fittings; more for the thin tubes of miniature muscles",
        default=0.0,
    )  # fmt: skip

    def pressure(self, history: History, past: Past) -> Samples:
        return past.pressure - self.impedance * history.rate(past.state.volume)

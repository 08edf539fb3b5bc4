"""Pressure drop between gauge and muscle, by laminar and turbulent flow."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from pamjax.model.form_error import FormError, list_powers
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractPressureLoss, Description, Past, Samples
from pamjax.parameter import Scalar, parameter
from pamjax.units import ATMOSPHERIC_PRESSURE


class PressureDrop(AbstractPressureLoss):
    """A flow resistance between gauge and muscle, with Q = dV/dt:

        P = P_measured − Z Q − K (1 + c P_measured / Pa) Q |Q|

        Z  impedance        Pa s/m³   pressure drop per unit of flow into the muscle, laminar
        K  turbulence       Pa s²/m⁶  pressure drop per square of the flow, turbulent or through an orifice
        c  compressibility  1         0 for a liquid; 1 for a gas, whose density is proportional to pressure
        V                   m³        volume of the muscle
        Pa                  Pa        atmospheric pressure

    It dissipates energy as a damper does: −∮ (Z + K |Q|) Q dV < 0. A loss of kinetic energy is proportional
    to the density of the fluid, here to that in the muscle. The viscosity of a gas does not depend on its
    pressure. The volume is that at the measured pressure, which is correct to first order in Z and K.
    Neutral: Z = K = 0. Neglects: choked flow, gas stored in the line, regulators with a dead zone.
    Source: Hagen-Poiseuille; Borda-Carnot loss of an orifice; Boyle's law; derived here.
    """

    id: ClassVar[str] = "pressure_drop"
    needs_time: ClassVar[bool] = True
    mixes_samples: ClassVar[bool] = True
    uses_rate: ClassVar[bool] = True
    about: ClassVar[Description] = Description(
        title="pressure drop between gauge and muscle",
        equation="P = P_m - Z Q - K (1 + c P_m/Pa) Q |Q|,   Q = dV/dt;   dF = (Z + K |Q|) (dV/dL)^2 dL/dt",
        signature="Force is higher while the muscle lengthens and lower while it shortens. The difference is"
        " proportional to speed or, with turbulence, to its square. It is the same at every pressure or, with"
        " turbulent gas, proportional to absolute pressure. It is largest at rest length, and zero at free"
        " contraction.",
        neglects="choked flow, gas stored in the line, dead zones of the regulator",
        confusable=("viscous_damping", "braid_friction", "channel_lag"),
        experiment="Record the loop at free contraction, where volume is constant. Measure the pressure at"
        " the muscle.",
        source="Hagen-Poiseuille; Borda-Carnot; derived here",
    )
    form_error: ClassVar[FormError] = FormError(
        (*list_powers("pressure", 2), "length", *list_powers("speed", 2))
    )

    impedance: Scalar = parameter(
        "Pa*s/m^3", low=0.0, high=1e11, neutral=0.0, about="pressure drop per unit of flow",
        source="1e8 for a metre of 4 mm tube with fittings; more for the thin tubes of miniature muscles",
        default=0.0,
    )  # fmt: skip

    turbulence: Scalar = parameter(
        "Pa*s^2/m^6", low=0.0, high=1e17, neutral=0.0, is_refinement=True,
        about="pressure drop per square of the flow",
        source="1e13 for a fitting of 1 mm bore: half the density over the square of its area",
        default=0.0,
    )  # fmt: skip

    compressibility: Scalar = parameter(
        "1", low=0.0, high=1.0, is_refinement=True,
        about="share of the density that is proportional to absolute pressure",
        source="0 for a liquid, 1 for a gas", default=0.0,
    )  # fmt: skip

    def pressure(self, history: History, past: Past) -> Samples:
        flow = history.rate(past.state.volume)
        density_ratio = 1 + self.compressibility * past.pressure / ATMOSPHERIC_PRESSURE
        return past.pressure - (self.impedance + self.turbulence * density_ratio * jnp.abs(flow)) * flow

"""Other forms of the rig: contact of the bladder, pressure drop, deflection under load."""

from __future__ import annotations

import numpy as np

from pamjax.units import ATMOSPHERIC_PRESSURE


def lose_exponentially(pressure: np.ndarray, threshold: float) -> np.ndarray:
    """Return Pc (1 − e^(−P/Pc)), the pressure that presses on no braid yet, Pa.

    P at low pressure, Pc far above it. Source: a soft threshold; the fit has a sharp one.
    """
    return threshold * -np.expm1(-pressure / threshold) if threshold > 0 else np.zeros_like(pressure)


def lose_hyperbolically(pressure: np.ndarray, threshold: float) -> np.ndarray:
    """Return P Pc/(P + Pc), Pa: contact that spreads slowly over the braid.

    P at low pressure, Pc far above it, half of it at P = Pc. Source: a soft threshold; derived here.
    """
    return pressure * threshold / (pressure + threshold) if threshold > 0 else np.zeros_like(pressure)


def drop_by_turbulence(flow: np.ndarray, reference: float, drop: float) -> np.ndarray:
    """Return ΔP = d sign(Q) |Q/Q1|^1.75, the drop d (Pa) at the flow Q1 (m³/s).

    Zero without flow. Source: turbulent flow in a smooth tube, H. Blasius, 1913; the fit has laminar flow.
    """
    return drop * np.sign(flow) * np.abs(flow / reference) ** 1.75


def drop_by_orifice(flow: np.ndarray, pressure: np.ndarray, reference: float, drop: float) -> np.ndarray:
    """Return ΔP = d (1 + P/Pa) (Q/Q1)|Q/Q1|, the drop of an orifice in a gas of density 1 + P/Pa.

    Q in m³/s, Pa the atmospheric pressure. Zero without flow. Source: Bernoulli's law with losses.
    """
    ratio = flow / reference
    return drop * (1 + pressure / ATMOSPHERIC_PRESSURE) * ratio * np.abs(ratio)


def deflect_by_hertz(force: np.ndarray, deflection: float, reference: float, exponent: float) -> np.ndarray:
    """Return δ = d (F/F1)^m, the deflection d (m) at the force F1 (N); m = 2/3 for round contacts.

    Zero without force. Source: H. Hertz, J. reine angew. Math. 92, 156, 1881; the fit has m = 1.
    """
    return deflection * (np.maximum(force, 0.0) / reference) ** exponent


def deflect_by_seat(force: np.ndarray, deflection: float, half: float) -> np.ndarray:
    """Return δ = d F/(F + Fh): a seat that stiffens, with half of its deflection d (m) at Fh (N).

    Zero without force, d for F → ∞. Source: hyperbolic contact law; the fit has an exponential.
    """
    tension = np.maximum(force, 0.0)
    return deflection * tension / (tension + half)

"""Other forms of friction and damping. The force is positive while the muscle lengthens."""

from __future__ import annotations

import numpy as np


def slide_dahl(position: np.ndarray, distance: float) -> np.ndarray:
    """Return the state z of Dahl's friction, dz = (1 − z sign(dx)) dx / d, from −1 to 1.

    x is the position and d the presliding distance, m. Zero at the first sample. After a reversal
    63 % of the way to the other limit is reached within d. The fit has straight pieces instead.
    Source: P. R. Dahl, Aerospace Corp. TOR-158(3107-18), 1968.
    """
    out, z = np.zeros_like(position), 0.0
    for k, step in enumerate(np.diff(position), start=1):
        limit = np.sign(step)
        z = limit - (limit - z) * np.exp(-abs(step) / distance)
        out[k] = z
    return out


def weaken_with_speed(speed: np.ndarray, slow_speed: float, share: float) -> np.ndarray:
    """Return s + (1 − s) e^(−|v|/vs), the factor on friction at a speed v (Stribeck).

    One at rest, s at high speed; vs in m/s. Source: R. Stribeck, Z. VDI 46, 1341, 1902, in the form of
    Bo & Pavelescu, Wear 82, 277, 1982, with exponent one.
    """
    return share + (1 - share) * np.exp(-np.abs(speed) / slow_speed)


def keep_one_direction(state: np.ndarray, direction: int) -> np.ndarray:
    """Return the part of a friction state that acts in one direction only, ±1; zero in the other.

    Source: a thread that rubs on a fitting on its way in or out only; no measurement.
    """
    return np.where(state * direction > 0, state, 0.0)


def raise_to_power(pressure: np.ndarray, reference: float, exponent: float) -> np.ndarray:
    """Return (P/Pr)^m, the dependence of friction on pressure, for P in Pa; zero without pressure.

    Source: contacts whose number grows with load; the fit has m from 0.5 to 2.
    """
    return (np.maximum(pressure, 0.0) / reference) ** exponent


def damp_by_eyring(velocity: np.ndarray, slow_velocity: float) -> np.ndarray:
    """Return asinh(v/v0), the shear stress of a film that thins, v0 in m/s.

    v/v0 at low speed, ln(2v/v0) at high speed. Source: H. Eyring, J. Chem. Phys. 4, 283, 1936.
    """
    return np.arcsinh(velocity / slow_velocity)


def damp_by_direction(velocity: np.ndarray, reference: float, share: float, direction: int) -> np.ndarray:
    """Return v/v1 in one direction, ±1, and the share s of it in the other.

    Source: unequal dampers for contraction and relaxation, Reynolds, Repperger, Phillips & Bandry, Ann.
    Biomed. Eng. 31, 310, 2003.
    """
    return velocity / reference * np.where(velocity * direction > 0, 1.0, share)

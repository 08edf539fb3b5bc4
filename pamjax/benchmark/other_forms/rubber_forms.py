"""Other forms of the rubber: stored energy, relaxation and softening of the wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gamma

from pamjax.benchmark.other_forms.muscle import Energy, MusclePath, TrueBraid

#: Smallest bore of a compressed wall, over the unstretched one.
_CLOSED_BORE_RATIO = 0.05


@dataclass(frozen=True)
class RubberWall:
    """An incompressible tube in contact with the braid: unstretched bore, thickness and length, m."""

    braid: TrueBraid
    bore: float
    thickness: float
    length: float

    @property
    def volume(self) -> float:
        """Return the volume of the rubber, π t (d + t) l, m³."""
        return np.pi * self.thickness * (self.bore + self.thickness) * self.length

    def compute_stretches(
        self, length: np.ndarray, thread: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the stretches along, around (at mid-wall) and through the wall."""
        radius, axial = self.braid.compute_radius(length, thread), length / self.length
        wall_area = self.thickness * (self.bore + self.thickness) / axial
        inner = np.sqrt(np.maximum(radius**2 - wall_area, (0.5 * _CLOSED_BORE_RATIO * self.bore) ** 2))
        hoop = (radius + inner) / (self.bore + self.thickness)
        return axial, hoop, 1 / (axial * hoop)

    def compute_first_invariant(self, length: np.ndarray, thread: np.ndarray) -> np.ndarray:
        """Return I1 − 3."""
        axial, hoop, radial = self.compute_stretches(length, thread)
        return axial**2 + hoop**2 + radial**2 - 3


def build_yeoh(wall: RubberWall, modulus: float, second: float, third: float) -> Energy:
    """Return Yeoh's energy, W = V μ/2 [x + c2 x² + c3 x³], x = I1 − 3.

    V in m³, μ in Pa. Neo-Hookean for c2 = c3 = 0; without energy at μ = 0.
    Source: O. H. Yeoh, Rubber Chem. Technol. 66, 754, 1993.
    """

    def compute_energy(length: np.ndarray, thread: np.ndarray) -> np.ndarray:
        x = wall.compute_first_invariant(length, thread)
        return 0.5 * modulus * wall.volume * (x + second * x**2 + third * x**3)

    return compute_energy


def build_ogden(wall: RubberWall, modulus: float, exponent: float) -> Energy:
    """Return Ogden's energy with one term, W = V (2μ/α²) (λz^α + λc^α + λr^α − 3).

    V in m³, μ in Pa. Neo-Hookean for α = 2; without energy at μ = 0.
    Source: R. W. Ogden, Proc. R. Soc. A 326, 565, 1972.
    """

    def compute_energy(length: np.ndarray, thread: np.ndarray) -> np.ndarray:
        axial, hoop, radial = wall.compute_stretches(length, thread)
        powers = axial**exponent + hoop**exponent + radial**exponent - 3
        return 2 * modulus / exponent**2 * wall.volume * powers

    return compute_energy


def build_gent(wall: RubberWall, modulus: float, limit: float) -> Energy:
    """Return Gent's energy, W = −V (μ J/2) ln(1 − (I1 − 3)/J), J the limit of I1 − 3.

    V in m³, μ in Pa. Neo-Hookean for J → ∞; without energy at μ = 0.
    Source: A. N. Gent, Rubber Chem. Technol. 69, 59, 1996.
    """

    def compute_energy(length: np.ndarray, thread: np.ndarray) -> np.ndarray:
        stretch_share = np.minimum(wall.compute_first_invariant(length, thread) / limit, 1 - 1e-6)
        return -0.5 * modulus * limit * wall.volume * np.log1p(-stretch_share)

    return compute_energy


def relax_by_power_law(time: np.ndarray, stress: np.ndarray, exponent: float) -> np.ndarray:
    """Return the stress of a spring-pot, ∫ (t − t')^(−α) dS / Γ(1 − α), t in s.

    S is linear between samples and relaxed at the first one. For α → 0 it is S minus its first value; for
    α → 1 the rate of S. Source: fractional Maxwell model, Bagley & Torvik, J. Rheol. 27, 201, 1983.
    """
    return _convolve(time, stress, lambda age: age ** (1 - exponent) / gamma(2 - exponent))


def relax_by_stretched_exponential(
    time: np.ndarray, stress: np.ndarray, time_constant: float, exponent: float
) -> np.ndarray:
    """Return ∫ e^(−((t − t')/τ)^b) dS: Kohlrausch's relaxation, with times in s.

    S is linear between samples and relaxed at the first one. A single Maxwell branch for b = 1.
    Source: R. Kohlrausch, Ann. Phys. 167, 179, 1854.
    """
    ages = np.concatenate([[0.0], np.geomspace(1e-6, 1.0, 2000)]) * max(time[-1] - time[0], 1e-9)
    kernel = np.exp(-((ages / time_constant) ** exponent))
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (kernel[1:] + kernel[:-1]) * np.diff(ages))])
    return _convolve(time, stress, lambda age: np.interp(age, ages, integral))


def _convolve(time: np.ndarray, stress: np.ndarray, integrate) -> np.ndarray:
    """Return ∫ G(t − t') dS from the integral of the kernel G over its age."""
    age = np.maximum(time[:, None] - time[None, :], 0.0)
    integral = integrate(age)
    weights = (integral[:, :-1] - integral[:, 1:]) / np.diff(time)
    return weights @ np.diff(stress)


def build_relaxation(wall: RubberWall, modulus: float, path: MusclePath, relax) -> Energy:
    """Return the potential of relaxing stresses, W = Σ q λ over the axial and the hoop stretch.

    q = V μ relax(S), S the neo-Hookean stress (λ − λr²/λ) of each stretch on the path. Without energy at
    μ = 0. Source: quasi-linear viscoelasticity, Y. C. Fung, 1972, with other kernels.
    """
    axial, hoop, radial = wall.compute_stretches(path.length, path.thread)
    scale = modulus * wall.volume
    along, around = (scale * relax(path.time, stretch - radial**2 / stretch) for stretch in (axial, hoop))

    def compute_energy(length: np.ndarray, thread: np.ndarray) -> np.ndarray:
        stretches = wall.compute_stretches(length, thread)
        return along * stretches[0] + around * stretches[1]

    return compute_energy


def soften_exponentially(energy: np.ndarray, width: float) -> np.ndarray:
    """Return η = e^(−(m − e)/(w m)), m the largest energy e so far.

    One during a first stretch, and less the further the wall is unloaded. The fit has an error function.
    Source: damage of Simo's type, Comput. Methods Appl. Mech. Eng. 60, 153, 1987, as a factor.
    """
    largest = np.maximum(np.maximum.accumulate(energy), 1e-30)
    return np.exp(-(largest - energy) / (width * largest))


def soften_by_travel(energy: np.ndarray, share: float) -> np.ndarray:
    """Return η = e^(−a/(s A)), a the travel Σ|Δe| so far and A that of the recording.

    One at the first sample; it decreases in every stroke, not only in the first.
    Source: cyclic softening; no measurement.
    """
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(energy)))])
    return np.exp(-travel / (share * max(travel[-1], 1e-30)))


def build_softening(wall: RubberWall, modulus: float, path: MusclePath, soften) -> Energy:
    """Return the potential W = μ η e with e = V (I1 − 3)/2 and η from the path; none at μ = 0.

    Source: Ogden & Roxburgh, Proc. R. Soc. A 455, 2861, 1999, on a separate energy.
    """
    scale = 0.5 * wall.volume
    eta = soften(scale * wall.compute_first_invariant(path.length, path.thread))

    def compute_energy(length: np.ndarray, thread: np.ndarray) -> np.ndarray:
        return modulus * eta * scale * wall.compute_first_invariant(length, thread)

    return compute_energy

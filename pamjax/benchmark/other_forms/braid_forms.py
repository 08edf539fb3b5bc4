"""Other forms of the braid: locking, ends, stretch of the threads, slip."""

from __future__ import annotations

import numpy as np

from pamjax.benchmark.other_forms.muscle import Effect, Energy, TrueBraid


def lock_extension(braid: TrueBraid, stiffness: float, start: float, exponent: float) -> Energy:
    """Return W = K l/(m + 1) ⟨x0 − x⟩^(m+1), x = 1 − L/l: a braid that locks in the stretched muscle.

    K in N, l the rest length. The force is K⟨x0 − x⟩^m below the contraction x0, and zero above it. The fit
    has an overlap of threads instead. A force that begins above a contraction is no form of locking here: it
    has the equation of a stop in the way, which is outside the library.
    Source: packing of the braid at the ends of the stroke; exponent 1 (linear) to 3 (compaction).
    """

    def compute_energy(length: np.ndarray, thread: np.ndarray) -> np.ndarray:
        past = np.maximum(start - (1 - length / braid.rest_length), 0.0)
        return stiffness * braid.rest_length / (exponent + 1) * past ** (exponent + 1)

    return compute_energy


def lock_angle(stiffness: float, start: float, exponent: float) -> Energy:
    """Return W = K/(m + 1) ⟨θ − θ0⟩^(m+1): a braid that locks past a steep braid angle.

    K in J, θ the angle from the circumference, sin θ = L/B. It pulls where θ > θ0, and is zero elsewhere.
    Source: trellis shear locking of fabrics, Cao et al., Composites A 39, 1037, 2008, as a power law.
    """

    def compute_energy(length: np.ndarray, thread: np.ndarray) -> np.ndarray:
        past = np.maximum(np.arcsin(np.minimum(length / thread, 1.0)) - start, 0.0)
        return stiffness / (exponent + 1) * past ** (exponent + 1)

    return compute_energy


def taper_as_cone(height: float, fitting_radius: float) -> Effect:
    """Return cut-off cones of a fixed height h at both ends, from radius Rf to R.

    ΔV = 2h [π(R² + R Rf + Rf²)/3 − πR²],   ΔR_mean = −h (R − Rf)/L. Zero for R = Rf or h = 0.
    Source: Tsagarakis & Caldwell, ICRA 2000, with a fixed height: the refinement of `end_taper`.
    """
    return Effect(
        volume=lambda length, radius: (
            2 * height * np.pi * ((radius**2 + radius * fitting_radius + fitting_radius**2) / 3 - radius**2)
        ),
        mean_radius=lambda length, radius: -height * (radius - fitting_radius) / length,
    )


def taper_as_clamp(height: float, fitting_radius: float) -> Effect:
    """Return ends that are clamped at radius Rf over a length h each.

    ΔV = −2h π (R² − Rf²),   ΔR_mean = −2h (R − Rf)/L. Zero for R = Rf or h = 0.
    Source: a hose clamp over the braid; derived here.
    """
    return Effect(
        volume=lambda length, radius: -2 * height * np.pi * (radius**2 - fitting_radius**2),
        mean_radius=lambda length, radius: -2 * height * (radius - fitting_radius) / length,
    )


def taper_as_parabola(height: float, fitting_radius: float) -> Effect:
    """Return ends r = Rf + (R − Rf) s (2 − s), s from 0 to 1 over a length h each.

    ΔV = −2h π [R² − Rf² − (4/3) Rf a − (8/15) a²],   ΔR_mean = −(2/3) h a/L,   a = R − Rf.
    Source: a rounded end, the arc of Kothera et al., J. Mech. Des. 131, 091010, 2009, as a parabola.
    """

    def compute_volume(length: np.ndarray, radius: np.ndarray) -> np.ndarray:
        rise = radius - fitting_radius
        mean_square = fitting_radius**2 + 4 / 3 * fitting_radius * rise + 8 / 15 * rise**2
        return -2 * height * np.pi * (radius**2 - mean_square)

    return Effect(
        volume=compute_volume,
        mean_radius=lambda length, radius: -2 / 3 * height * (radius - fitting_radius) / length,
    )


def uncrimp_with_corner(load: np.ndarray, crimp: float, corner: float) -> np.ndarray:
    """Return ε = c min(T/Tc, 1): crimp that is pulled out with a corner at the load Tc, N.

    Zero at T = 0, c above Tc. Source: bilinear yarn law; the fit has an exponential.
    """
    return crimp * np.minimum(load / corner, 1.0)


def uncrimp_by_recruitment(load: np.ndarray, crimp: float, corner: float) -> np.ndarray:
    """Return ε = c (2 sqrt(u) − u), u = min(T/Tc, 1): filaments with uniformly distributed slack.

    Filaments of slack 0 to 2c carry σ = E ε²/(4c) until all are taut at the load Tc, N; this is their strain
    minus that of taut ones. Zero at T = 0, c above Tc. Source: Kastelic, Palley & Baer, J. Biomech. 13, 887,
    1980, with a uniform distribution.
    """
    share = np.minimum(load / corner, 1.0)
    return crimp * (2 * np.sqrt(share) - share)


def stretch_by_power(load: np.ndarray, strain: float, reference: float, exponent: float) -> np.ndarray:
    """Return ε = a (T/Tr)^m: threads that stiffen with load for m < 1, with strain a at the load Tr, N.

    Zero at T = 0. Source: inverse Ramberg-Osgood law, NACA TN 902, 1943; the fit has m = 1.
    """
    return strain * (load / reference) ** exponent


def slip_twice(time: np.ndarray, strain: float, share: float, moments: tuple[float, float]) -> np.ndarray:
    """Return a H(t − t1) s + a H(t − t2)(1 − s): threads that slip in two steps, at t1 and t2, s.

    Zero before t1, the strain a after t2. Source: stick-slip in a fitting; the fit has one slip.
    """
    return strain * (share * (time >= moments[0]) + (1 - share) * (time >= moments[1]))


def bed_in_by_power(load: np.ndarray, strain: float, exponent: float) -> np.ndarray:
    """Return a (Tmax/T1)^m, Tmax the largest load so far and T1 that of the recording.

    Zero without load, a at the end. Source: constructional stretch of ropes as a power law; the fit
    saturates at large loads.
    """
    largest = np.maximum.accumulate(np.maximum(load, 0.0))
    return strain * (largest / max(largest[-1], 1e-12)) ** exponent

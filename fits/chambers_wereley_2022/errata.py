"""Checks of docs/errata.md: each function computes the numbers of one entry.

`python fits/chambers_wereley_2022/errata.py` prints all of them.
"""

from __future__ import annotations

import numpy as np
import tables as t

from pamjax.model import braid

#: The article's case study and its Kevlar, Pa.
STIFF, SOFT = 80e9, 8e9


def solve_equation_10(sign: float, modulus: float = STIFF) -> float:
    """Return the stretched thread by Eq. 10, m; `sign` in the denominator: +1 as printed, -1 derived."""
    pull = t.FORCE + t.PRESSURE * np.pi * float(braid.radius_squared(t.LENGTH, t.THREAD, t.TURNS))
    return t.THREAD / (1 + sign * t.THREAD * pull / (t.LENGTH * t.AREA * modulus))


def solve_equation_11(one_inside: bool, modulus: float = STIFF) -> np.ndarray:
    """Return the three roots of Eq. 11, m: printed with the 1 inside the bracket, or derived, outside."""
    per_area = t.PRESSURE / (4 * np.pi * t.TURNS**2)
    share = t.THREAD / (t.LENGTH * t.AREA * modulus)
    pull = t.FORCE - per_area * t.LENGTH**2
    linear = share * (pull - 1) if one_inside else share * pull - 1
    return np.sort_complex(np.roots([share * per_area, 0.0, linear, t.THREAD]))


def compute_angle_fall(modulus: float) -> dict[str, float]:
    """Return the decrease of the braid angle at rest, deg and percent of the stretched angle (Table 2)."""
    thread = t.stretch_by_equation_11(np.array([modulus]))[0]
    before, after = (np.degrees(float(braid.angle(t.LENGTH, b))) for b in (t.REFERENCE, thread))
    return {"deg": before - after, "percent": 100 * (before - after) / after}


def compute_free_contraction(force: float = 298.0) -> dict[str, float]:
    """Return the loss of force by stretch at free contraction, N, and the length of that state, m.

    Args:
        force: inelastic force there, N; 210 N and 70.4 % together imply 298 N.
    """
    length = np.sqrt((4 * np.pi * t.TURNS**2 * force / t.PRESSURE + t.REFERENCE**2) / 3)
    falls = {}
    for name, modulus in {"stiff": STIFF, "soft": SOFT}.items():
        strain, _ = t.stretch_measured(0.0, t.PRESSURE, length, t.THREAD, t.TURNS, t.AREA * modulus)
        thread = t.THREAD * (1 + float(strain))
        falls[name] = force - float(braid.gaylord_force(t.PRESSURE, length, thread, t.TURNS))
    return {"length": length, **falls, "overestimate_percent": 100 * falls["soft"] / (force - falls["soft"])}


def compute_areas() -> dict[str, float]:
    """Return the cross-section of one thread from the article (three ways) and from its titre, mm²."""
    fibres = t.STATED["fibres_per_thread"] * np.pi / 4
    return {
        "768 fibres of 0.012 mm": fibres * (t.STATED["fibre_diameter"] * 1e3) ** 2,
        "768 fibres of 0.00047 in": fibres * 0.00047**2 * 25.4**2,
        "1.33e-4 in², cut off": 1.33e-4 * 25.4**2,
        # Kevlar 49 yarn of 1140 denier (g per 9 km) and 1.44 g/cm³: its maker's data.
        "1140 denier at 1.44 g/cm³": 1140 / 9000 / 1.44,
    }


def compute_last_row() -> dict[str, float]:
    """Return the force put into the last row of Table 2, the force that follows, and both tensions, N."""
    thread = t.stretch_by_equation_11(t.MODULI[-1:])[0]
    squared = float(braid.radius_squared(t.LENGTH, thread, t.TURNS))
    tension = (t.FORCE + t.PRESSURE * np.pi * squared) * thread / t.LENGTH / t.STATED["threads"]
    own = (
        float(braid.hoop_pull(t.PRESSURE, t.LENGTH, t.stretch_in_balance()[-1], t.TURNS))
        / t.STATED["threads"]
    )
    out = float(braid.gaylord_force(t.PRESSURE, t.LENGTH, thread, t.TURNS))
    return {"force in": t.FORCE, "force out": out, "tension": tension, "tension in balance": own}


def compute_strains() -> dict[str, float]:
    """Return the greatest strain of Table 1 from each of the two unloaded thread lengths, 1."""
    table = t.compute_table1()["computed thread_length [mm]"].to_numpy() / 1e3
    return {"from 0 kPa of Table 1": table[0] / table[-1] - 1, "from the ruler": table[0] / t.THREAD - 1}


def convert_units() -> dict[str, float]:
    """Return 59.3 lbf in N, and the stress difference of Sec. 3 as tension of one thread, N."""
    return {
        "59.3 lbf": t.STATED["breaking_strength_lbf"],
        "26.66 MPa": t.STATED["test_stress_difference"] * t.STATED["thread_area"],
    }


def format_line(title: str, values: dict[str, float]) -> str:
    """Return one line: the title and each value with its name."""
    return f"{title}: " + ", ".join(f"{name} {value:.5g}" for name, value in values.items())


if __name__ == "__main__":
    print(f"Eq. 10, mm: printed {1e3 * solve_equation_10(+1):.2f}, derived {1e3 * solve_equation_10(-1):.2f}")
    print(f"Eq. 11, mm: printed {1e3 * solve_equation_11(True).round(6)}")
    print(f"Eq. 11, mm: derived {1e3 * solve_equation_11(False).real.round(6)}")
    print(format_line("angle at rest, 80 GPa", compute_angle_fall(STIFF)))
    print(format_line("angle at rest, 8 GPa", compute_angle_fall(SOFT)))
    print(format_line("free contraction, length in m and forces in N", compute_free_contraction()))
    print(format_line("area of a thread, mm²", compute_areas()))
    print(format_line("Table 2, last row, N", compute_last_row()))
    (force, reference, length), _, worst = t.fit_force_and_reference(length_too=True)
    rest = {
        "force, N": force,
        "reference, mm": 1e3 * reference,
        "length, mm": 1e3 * length,
        "worst cell": worst,
    }
    print(format_line("Table 2 with the length fitted too", rest))
    print(format_line("greatest strain", compute_strains()))
    for noise in (0.015e-3, 0.028e-3):
        steeper, sd = t.estimate_stiffening(noise)
        print(f"steeper at high pressure: {steeper:.0f} ± {sd:.0f} GPa with {1e3 * noise:g} mm noise")
    print(format_line("in N", convert_units()))
    print(
        format_line("psi in GPa", dict(zip((f"{psi:.3g} psi" for psi in t.PSI), t.MODULI / 1e9, strict=True)))
    )

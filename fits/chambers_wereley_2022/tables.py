"""Tables 1 and 2 of Chambers & Wereley (2022) computed again, and Table 2 as it should be.

The muscle stands at rest length and 100 psi in Table 2. Three numbers of that table's making are not
in the article; they are found here from its 36 printed cells (`found`) and then held:

    FORCE      4701 N       one blocked force, put into Eq. 11 for every material alike
    REFERENCE  251.364 mm   thread of the inelastic muscle in the columns of diameter and force,
                            while the column of stretch starts from the stated 251.206 mm
    PSI        16.3 Mpsi ...  moduli before they were rounded to GPa (620 ksi is printed as 4.3 GPa)

Percentages are of the elastic value.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from pamjax.model import braid
from pamjax.model.balance import stretch_measured
from pamjax.model.muscle import Muscle, predict
from pamjax.model.thread import LinearThread
from pamjax.records.shipped_tables import in_si, quantities, read_shipped
from pamjax.units import in_unit

ARTICLE = "chambers_wereley_2022"
STATED = quantities(f"{ARTICLE}/materials")
LENGTH, THREAD, TURNS = STATED["rest_length"], STATED["thread_length"], STATED["turns"]
#: Cross-section of all threads together, m².
AREA = STATED["threads"] * STATED["thread_area"]
#: 100 psi, Pa.
PRESSURE = STATED["greatest_pressure"]

FORCE = 4701.0
REFERENCE = 0.251364
PSI = np.array([16.3e6, 11.6e6, 5.8e6, 1.16e6, 620e3, 500e3])
MODULI = PSI * in_unit("psi")

CELLS = [
    "diameter_change [percent]",
    "diameter_change [mm]",
    "thread_stretch [percent]",
    "thread_stretch [mm]",
    "force_change [percent]",
    "force_change [N]",
]


def muscle(modulus: float) -> Muscle:
    """The article's muscle with linear threads of a modulus, Pa."""
    return Muscle(LENGTH, THREAD, TURNS, LinearThread(AREA * modulus))


def table1() -> pd.DataFrame:
    """Table 1 as printed, with thread length and angle from its diameters (Eqs. 1 and 9).

    Beside it what the article plots in Fig. 5: tension of one thread from the hoop balance, so that
    no measured force is needed, and stress. SI but for the columns that say otherwise.
    """
    printed = read_shipped(f"{ARTICLE}/table1")
    table = in_si(printed)
    thread = np.asarray(braid.thread_from_diameter(LENGTH, table["diameter"].to_numpy(), TURNS))
    tension = (
        np.asarray(braid.hoop_pull(table["pressure"].to_numpy(), LENGTH, thread, TURNS)) / STATED["threads"]
    )
    return printed.assign(
        **{
            "computed thread_length [mm]": 1e3 * thread,
            "computed braid_angle [deg]": np.degrees(np.asarray(braid.angle(LENGTH, thread))),
            "tension [N]": tension,
            "stress [MPa]": tension / STATED["thread_area"] / 1e6,
            "strain [percent]": 100 * (thread / thread[-1] - 1),
        }
    )


def slopes() -> pd.DataFrame:
    """Modulus as slope of stress over strain, straight lines through Table 1's measured rows.

    Returns:
        "modulus [GPa]", and "thread_length [mm]" at which the line meets zero stress.
    """
    table = table1().iloc[:5]
    thread, stress = table["computed thread_length [mm]"].to_numpy(), table["stress [MPa]"].to_numpy()
    rows = {}
    for name, part in {
        "all five": slice(None),
        "138 to 414 kPa": slice(2, 5),
        "414 to 689 kPa": slice(0, 3),
    }.items():
        slope, offset = np.polyfit(thread[part], stress[part], 1)
        start = -offset / slope
        rows[name] = {"modulus [GPa]": slope * start / 1e3, "thread_length [mm]": start}
    return pd.DataFrame(rows).T


def stiffening(noise: float) -> tuple[float, float]:
    """By how much the high-pressure line is steeper than the low one, GPa, and its standard deviation.

    Args:
        noise: standard deviation of one diameter, m.
    """
    table = in_si(read_shipped(f"{ARTICLE}/table1")).iloc[:5]

    def steeper(diameter):
        thread = np.asarray(braid.thread_from_diameter(LENGTH, diameter, TURNS))
        stress = np.asarray(braid.hoop_pull(table["pressure"].to_numpy(), LENGTH, thread, TURNS)) / AREA / 1e9
        high, low = (
            np.polyfit(thread[part] / THREAD, stress[part], 1)[0] for part in (slice(0, 3), slice(2, 5))
        )
        return high - low

    diameter, step = table["diameter"].to_numpy(), 1e-7
    slope = [(steeper(diameter + step * e) - steeper(diameter - step * e)) / (2 * step) for e in np.eye(5)]
    return float(steeper(diameter)), float(noise * np.linalg.norm(slope))


def law_slopes(calibrated: Muscle) -> dict[str, float]:
    """Modulus of a fitted thread law, GPa: its chord over the pressures of each of `slopes`' lines."""
    pressure = 1e3 * np.array([138.0, 414.0, 689.0])
    reading = predict(calibrated, pressure, np.full(3, LENGTH))
    stress, strain = np.asarray(reading.load) / AREA / 1e9, np.asarray(reading.strain)
    low, high = np.diff(stress) / np.diff(strain)
    return {"138 to 414 kPa": float(low), "414 to 689 kPa": float(high)}


def cells(
    thread: np.ndarray, reference: float = THREAD, unloaded: float = THREAD, length: float = LENGTH
) -> np.ndarray:
    """The six cells of each row of Table 2, in its units and its order.

    Args:
        thread: (n,) stretched threads, m.
        reference: thread of the inelastic muscle in diameter and force, m.
        unloaded: thread from which stretch is counted, m.
        length: of the muscle, m.
    """
    width, force = _width(thread, length), _force(thread, length)
    wider, stronger = width - _width(reference, length), force - _force(reference, length)
    stretch = thread - unloaded
    shown = [
        wider / width * 100,
        wider * 1e3,
        stretch / thread * 100,
        stretch * 1e3,
        stronger / force * 100,
        stronger,
    ]
    return np.stack(shown, axis=-1)


def as_printed_law(moduli: np.ndarray = MODULI, force: float = FORCE, length: float = LENGTH) -> np.ndarray:
    """Stretched threads by the article's Eq. 11 (corrected) under one force for all materials, m."""
    strain, _ = stretch_measured(force, PRESSURE, length, THREAD, TURNS, AREA * moduli)
    return THREAD * (1 + np.asarray(strain))


def in_balance(moduli: np.ndarray = MODULI) -> np.ndarray:
    """Stretched threads under the force that the stretched muscle itself has, closed form, m."""
    readings = [predict(muscle(modulus), np.array([PRESSURE]), np.array([LENGTH])) for modulus in moduli]
    return np.concatenate([np.asarray(reading.thread) for reading in readings])


def printed() -> np.ndarray:
    """The 36 printed cells, (6, 6)."""
    return read_shipped(f"{ARTICLE}/table2")[CELLS].to_numpy(float)


def readings() -> dict[str, np.ndarray]:
    """Table 2 under each way in which it may have been computed; the last is what was found."""
    rounded = read_shipped(f"{ARTICLE}/table2")["modulus [GPa]"].to_numpy() * 1e9
    inelastic = float(_force(np.asarray(THREAD)))
    return {
        "own force, moduli as printed": cells(in_balance(rounded)),
        "inelastic force 4785 N, moduli as printed": cells(as_printed_law(rounded, inelastic)),
        "4701 N, moduli in psi": cells(as_printed_law()),
        "4701 N, moduli in psi, reference 251.364 mm": cells(as_printed_law(), REFERENCE),
    }


def agreement(computed: np.ndarray) -> dict[float, int]:
    """How many of the 36 cells lie within half a printed unit, one unit, one and a half."""
    off = np.abs(computed - printed())
    return {limit: int((off <= limit + 1e-9).sum()) for limit in (0.05, 0.10, 0.15)}


def counts() -> pd.DataFrame:
    """Cells of Table 2 that agree, for each way of computing it."""
    return pd.DataFrame(
        {"computed with": how} | {f"within {limit:g}": n for limit, n in agreement(computed).items()}
        for how, computed in readings().items()
    )


def side_by_side() -> pd.DataFrame:
    """Table 2 as the article computed it, each cell as "printed | computed"."""
    computed = list(readings().values())[-1]
    pairs = np.array([f"{p:g} | {c:.2f}" for p, c in zip(printed().ravel(), computed.ravel(), strict=True)])
    table = pd.DataFrame(pairs.reshape(6, 6), columns=CELLS)
    table.insert(0, "material", _materials())
    return table


def found(length_too: bool = False) -> tuple[np.ndarray, np.ndarray, float]:
    """FORCE (N) and REFERENCE (m), and the length (m) if asked, from the 36 printed cells.

    Each cell weighs as a number rounded to 0.1, whose standard deviation is 0.1/√12.

    Returns:
        values, their standard deviations, and how far off the worst cell then is.
    """
    scale = np.array([FORCE, REFERENCE, LENGTH][: 2 + length_too])

    def off(numbers):
        force, reference, length = (*(numbers * scale), LENGTH)[:3]
        return (cells(as_printed_law(MODULI, force, length), reference, length=length) - printed()).ravel()

    # The three-point slope of a function this smooth is good to nine digits.
    result = least_squares(off, np.ones_like(scale), jac="3-point", x_scale=1e-5, xtol=1e-12)
    sd = 0.1 / np.sqrt(12) * np.sqrt(np.diag(np.linalg.inv(result.jac.T @ result.jac)))
    return result.x * scale, sd * scale, float(np.abs(result.fun).max())


def table2() -> pd.DataFrame:
    """Table 2 in balance: one unloaded thread, each material under the force it leaves.

    The percentages are of the elastic value, as printed; those of the inelastic value stand beside
    them, because a designer starts from the inelastic one.
    """
    thread = in_balance()
    values = cells(thread)
    inelastic = 100 * np.stack([values[:, 1] / 1e3 / _width(THREAD), values[:, 5] / _force(THREAD)], axis=-1)
    pull = np.asarray(braid.hoop_pull(PRESSURE, LENGTH, thread, TURNS)) / STATED["threads"]
    table = pd.DataFrame(values, columns=CELLS)
    table.insert(0, "modulus [GPa]", MODULI / 1e9)
    table.insert(0, "material", _materials())
    table["diameter_change [% of inelastic]"] = inelastic[:, 0]
    table["force_change [% of inelastic]"] = inelastic[:, 1]
    table["strain [percent]"] = 100 * (thread / THREAD - 1)
    table["tension [N]"] = pull
    return table


def _materials() -> pd.Series:
    return read_shipped(f"{ARTICLE}/table2")["material"].str.replace(r"( stiffness)? \(.*", "", regex=True)


def _width(thread, length: float = LENGTH) -> np.ndarray:
    return np.asarray(braid.diameter(length, thread, TURNS))


def _force(thread, length: float = LENGTH) -> np.ndarray:
    return np.asarray(braid.gaylord_force(PRESSURE, length, thread, TURNS))

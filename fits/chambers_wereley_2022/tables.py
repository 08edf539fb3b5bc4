"""Tables 1 and 2 of Chambers & Wereley (2022) computed again, and Table 2 in balance.

In Table 2 the muscle has its rest length and 100 psi. The article does not print three inputs of that
table. Force and reference length are fitted to its 36 printed cells (`fit_force_and_reference`) and then
fixed. The moduli are round numbers of psi, chosen to agree as well. The agreement with Table 2 is therefore
a reconstruction and no prediction.

    FORCE      4701 N       one blocked force, put into Eq. 11 for every material alike
    REFERENCE  251.364 mm   thread of the inelastic muscle in the columns of diameter and force,
                            while the column of stretch starts from the stated 251.206 mm
    PSI        16.3 Mpsi ...  moduli before they were rounded to GPa (620 ksi is printed as 4.3 GPa)

As in the article, percentages are of the elastic value.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from pamjax.model import braid
from pamjax.model.balance import stretch_measured
from pamjax.model.muscle import Muscle, predict
from pamjax.model.thread import LinearThread
from pamjax.records.shipped_tables import convert_to_si, read_quantities, read_shipped
from pamjax.units import compute_si_factor

ARTICLE = "chambers_wereley_2022"
STATED = read_quantities(f"{ARTICLE}/materials")
LENGTH, THREAD, TURNS = STATED["rest_length"], STATED["thread_length"], STATED["turns"]
#: Cross-section of all threads together, m².
AREA = STATED["threads"] * STATED["thread_area"]
#: 100 psi, Pa.
PRESSURE = STATED["greatest_pressure"]

FORCE = 4701.0
REFERENCE = 0.251364
PSI = np.array([16.3e6, 11.6e6, 5.8e6, 1.16e6, 620e3, 500e3])
MODULI = PSI * compute_si_factor("psi")

CELLS = [
    "diameter_change [percent]",
    "diameter_change [mm]",
    "thread_stretch [percent]",
    "thread_stretch [mm]",
    "force_change [percent]",
    "force_change [N]",
]


def build_muscle(modulus: float) -> Muscle:
    """Return the article's muscle with linear threads of this modulus, Pa."""
    return Muscle(LENGTH, THREAD, TURNS, LinearThread(AREA * modulus))


def compute_table1() -> pd.DataFrame:
    """Return Table 1 as printed, with thread length and angle computed from its diameters (Eqs. 1 and 9).

    Two more columns are those of Fig. 5: tension of one thread and stress. The tension follows from the
    hoop balance, which needs no measured force. Columns without a unit are in SI.
    """
    printed = read_shipped(f"{ARTICLE}/table1")
    table = convert_to_si(printed)
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


def fit_slopes() -> pd.DataFrame:
    """Return the modulus as slope of stress over strain: straight lines through the rows of Table 1.

    Returns:
        "modulus [GPa]", and "thread_length [mm]" at which the line has zero stress.
    """
    table = compute_table1().iloc[:5]
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


def estimate_stiffening(noise: float) -> tuple[float, float]:
    """Return the slope at high pressure less the slope at low pressure, GPa, and its sd.

    Args:
        noise: standard deviation of one diameter, m.
    """
    table = convert_to_si(read_shipped(f"{ARTICLE}/table1")).iloc[:5]

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


def compute_law_slopes(calibrated: Muscle) -> dict[str, float]:
    """Return the modulus of a fitted thread law over the pressures of each line of `fit_slopes`, GPa."""
    pressure = 1e3 * np.array([138.0, 414.0, 689.0])
    reading = predict(calibrated, pressure, np.full(3, LENGTH))
    stress, strain = np.asarray(reading.load) / AREA / 1e9, np.asarray(reading.strain)
    low, high = np.diff(stress) / np.diff(strain)
    return {"138 to 414 kPa": float(low), "414 to 689 kPa": float(high)}


def compute_cells(
    thread: np.ndarray, reference: float = THREAD, unloaded: float = THREAD, length: float = LENGTH
) -> np.ndarray:
    """Return the six cells of each row of Table 2, in the units and the order of the article.

    Args:
        thread: (n,) stretched threads, m.
        reference: thread of the inelastic muscle in diameter and force, m.
        unloaded: thread from which stretch is counted, m.
        length: of the muscle, m.
    """
    width, force = _compute_diameter(thread, length), _compute_force(thread, length)
    wider, stronger = width - _compute_diameter(reference, length), force - _compute_force(reference, length)
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


def stretch_by_equation_11(
    moduli: np.ndarray = MODULI, force: float = FORCE, length: float = LENGTH
) -> np.ndarray:
    """Return the stretched threads by the article's Eq. 11 (corrected), one force for all materials, m."""
    strain, _ = stretch_measured(force, PRESSURE, length, THREAD, TURNS, AREA * moduli)
    return THREAD * (1 + np.asarray(strain))


def stretch_in_balance(moduli: np.ndarray = MODULI) -> np.ndarray:
    """Return the stretched threads under the muscle's own force, in closed form, m."""
    readings = [
        predict(build_muscle(modulus), np.array([PRESSURE]), np.array([LENGTH])) for modulus in moduli
    ]
    return np.concatenate([np.asarray(reading.thread) for reading in readings])


def read_printed_cells() -> np.ndarray:
    """Return the 36 printed cells, (6, 6)."""
    return read_shipped(f"{ARTICLE}/table2")[CELLS].to_numpy(float)


def compute_alternatives() -> dict[str, np.ndarray]:
    """Return Table 2 for each set of inputs; the last set was fitted to the table."""
    rounded = read_shipped(f"{ARTICLE}/table2")["modulus [GPa]"].to_numpy() * 1e9
    inelastic = float(_compute_force(np.asarray(THREAD)))
    return {
        "own force, moduli as printed": compute_cells(stretch_in_balance(rounded)),
        "inelastic force 4785 N, moduli as printed": compute_cells(
            stretch_by_equation_11(rounded, inelastic)
        ),
        "4701 N, moduli in psi": compute_cells(stretch_by_equation_11()),
        "4701 N, moduli in psi, reference 251.364 mm": compute_cells(stretch_by_equation_11(), REFERENCE),
    }


def count_agreement(computed: np.ndarray) -> dict[float, int]:
    """Return how many of the 36 cells agree within half, one, and one and a half printed units."""
    off = np.abs(computed - read_printed_cells())
    return {limit: int((off <= limit + 1e-9).sum()) for limit in (0.05, 0.10, 0.15)}


def tabulate_agreement() -> pd.DataFrame:
    """Return the number of cells of Table 2 that agree, for each set of inputs."""
    return pd.DataFrame(
        {"computed with": how} | {f"within {limit:g}": n for limit, n in count_agreement(computed).items()}
        for how, computed in compute_alternatives().items()
    )


def tabulate_side_by_side() -> pd.DataFrame:
    """Return Table 2 with the fitted inputs, each cell as "printed | computed"."""
    computed = list(compute_alternatives().values())[-1]
    pairs = np.array(
        [f"{p:g} | {c:.2f}" for p, c in zip(read_printed_cells().ravel(), computed.ravel(), strict=True)]
    )
    table = pd.DataFrame(pairs.reshape(6, 6), columns=CELLS)
    table.insert(0, "material", _read_materials())
    return table


def fit_force_and_reference(length_too: bool = False) -> tuple[np.ndarray, np.ndarray, float]:
    """Fit FORCE (N) and REFERENCE (m), and optionally the length (m), to the 36 printed cells.

    The sd of each cell is that of a number rounded to 0.1, which is 0.1/√12.

    Returns:
        values, their standard deviations, and the largest deviation of a cell.
    """
    scale = np.array([FORCE, REFERENCE, LENGTH][: 2 + length_too])

    def off(numbers):
        force, reference, length = (*(numbers * scale), LENGTH)[:3]
        return (
            compute_cells(stretch_by_equation_11(MODULI, force, length), reference, length=length)
            - read_printed_cells()
        ).ravel()

    # Three-point differences of this smooth function are accurate to nine digits.
    result = least_squares(off, np.ones_like(scale), jac="3-point", x_scale=1e-5, xtol=1e-12)
    sd = 0.1 / np.sqrt(12) * np.sqrt(np.diag(np.linalg.inv(result.jac.T @ result.jac)))
    return result.x * scale, sd * scale, float(np.abs(result.fun).max())


def compute_table2() -> pd.DataFrame:
    """Return Table 2 in balance: one unloaded thread, each material under the muscle's own force.

    The percentages are of the elastic value, as printed. Two more columns have those of the inelastic
    value, which a designer knows first.
    """
    thread = stretch_in_balance()
    values = compute_cells(thread)
    inelastic = 100 * np.stack(
        [values[:, 1] / 1e3 / _compute_diameter(THREAD), values[:, 5] / _compute_force(THREAD)], axis=-1
    )
    pull = np.asarray(braid.hoop_pull(PRESSURE, LENGTH, thread, TURNS)) / STATED["threads"]
    table = pd.DataFrame(values, columns=CELLS)
    table.insert(0, "modulus [GPa]", MODULI / 1e9)
    table.insert(0, "material", _read_materials())
    table["diameter_change [% of inelastic]"] = inelastic[:, 0]
    table["force_change [% of inelastic]"] = inelastic[:, 1]
    table["strain [percent]"] = 100 * (thread / THREAD - 1)
    table["tension [N]"] = pull
    return table


def _read_materials() -> pd.Series:
    return read_shipped(f"{ARTICLE}/table2")["material"].str.replace(r"( stiffness)? \(.*", "", regex=True)


def _compute_diameter(thread, length: float = LENGTH) -> np.ndarray:
    return np.asarray(braid.diameter(length, thread, TURNS))


def _compute_force(thread, length: float = LENGTH) -> np.ndarray:
    return np.asarray(braid.gaylord_force(PRESSURE, length, thread, TURNS))

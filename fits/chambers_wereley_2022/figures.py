"""Figures 5, 7, 8, 9 and 10 of Chambers & Wereley (2022), redrawn from the model.

Every line is the muscle in balance under its own force. The article drew its elastic lines with the
measured force, which is not tabulated. Isobars run from rest length to the model's free contraction. Only
Fig. 5 has points, those of Table 1.
"""

from __future__ import annotations

import numpy as np
import tables as t
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pamjax.model import braid
from pamjax.model.muscle import Muscle, MuscleReading, predict
from pamjax.units import compute_si_factor
from pamjax.view.theme import (
    DOUBLE_COLUMN,
    OKABE_ITO,
    REFERENCE_COLOUR,
    add_panel_letters,
    add_pressure_bar,
    build_pressure_colours,
    create_figure,
    save_figure,
)

#: The ten isobars, Pa and kPa.
ISOBARS = np.arange(1, 11) * t.STATED["pressure_step"]
LEVELS = ISOBARS / 1e3
#: Moduli of the article's case studies and of the last row of Table 2, Pa.
STIFF, SOFT, SOFTEST = 80e9, 8e9, 500e3 * compute_si_factor("psi")
PERCENT = "contraction [%]"


def compute_free_length(modulus: float, pressure: float) -> float:
    """Return the length at which the muscle has no force, m.

    F = 0 where B = √3 L; with B = B0 / (1 − k L), k = P B0 / (2πN² S), that is √3 k L² − √3 L + B0 = 0,
    whose smaller root has here a form that also holds for inelastic threads (k = 0).
    """
    k = pressure * t.THREAD / (2 * np.pi * t.TURNS**2 * t.AREA * modulus)
    return 2 * t.THREAD / (np.sqrt(3) + np.sqrt(3 - 4 * np.sqrt(3) * k * t.THREAD))


def compute_isobar(
    modulus: float, pressure: float, points: int = 150
) -> tuple[np.ndarray, np.ndarray, MuscleReading]:
    """Return contraction in percent, length and reading on one isobar, from rest to free contraction."""
    length = np.linspace(t.LENGTH, compute_free_length(modulus, pressure), points)
    return (
        100 * (1 - length / t.LENGTH),
        length,
        predict(t.build_muscle(modulus), np.full(points, pressure), length),
    )


def _draw_isobars(panel: Axes, modulus: float, shown) -> None:
    """Draw one line per isobar; `shown(length, reading)` returns its values."""
    colours, norm = build_pressure_colours(LEVELS)
    for pressure, level in zip(ISOBARS, LEVELS, strict=True):
        percent, length, reading = compute_isobar(modulus, pressure)
        panel.plot(percent, shown(length, reading), color=colours(norm(level)), lw=1.0)


def _compute_angle(length, thread):
    return np.degrees(np.asarray(braid.angle(length, thread)))


def _compute_diameter(length, thread):
    return 1e3 * np.asarray(braid.diameter(length, thread, t.TURNS))


def draw_figure_5(calibrated: Muscle) -> Figure:
    """Draw Table 1 as points and the calibrated muscle as line."""
    table = t.compute_table1()
    line = np.linspace(1.0, 720e3, 80)
    reading = predict(calibrated, line, np.full(80, t.LENGTH))
    strain = 100 * np.asarray(reading.strain)
    stress = np.asarray(reading.load) / t.AREA / 1e6
    own = table["computed thread_length [mm]"] / (1e3 * float(calibrated.thread_length))
    pressure = table["pressure [kPa]"]
    panels = {
        "mean diameter [mm]": (pressure, table["diameter [mm]"], line / 1e3, 1e3 * reading.diameter),
        "thread length [mm]": (
            pressure,
            table["computed thread_length [mm]"],
            line / 1e3,
            1e3 * reading.thread,
        ),
        "tension of a thread [N]": (
            pressure,
            table["tension [N]"],
            line / 1e3,
            reading.load / t.STATED["threads"],
        ),
        "thread stress [MPa]": (100 * (own - 1), table["stress [MPa]"], strain, stress),
    }
    result = create_figure(DOUBLE_COLUMN, 4.6)
    grid = list(result.subplots(2, 2).flat)
    for panel, (name, (x, y, line_x, line_y)) in zip(grid, panels.items(), strict=True):
        panel.plot(line_x, line_y, color=OKABE_ITO["blue"], label="model", zorder=2)
        panel.plot(x[:5], y[:5], "o", color="black", label="measured (Table 1)", zorder=3)
        panel.plot(x[5:], y[5:], "o", mfc="white", mec="black", label="extrapolated (Table 1)", zorder=3)
        panel.set(ylabel=name, xlabel="pressure [kPa]", xlim=(-20, 730))
    modulus = float(calibrated.thread.stiffness) / t.AREA / 1e9
    cited = t.STATED["modulus_cited"] / 1e9
    last = grid[3]
    last.plot([0, 0.46], [0, 4.6 * cited], "--", color=REFERENCE_COLOUR, lw=1, zorder=1)
    last.annotate(
        f"{cited:.0f} GPa, cited",
        (0.40, 4.0 * cited),
        (-6, 0),
        "data",
        "offset points",
        ha="right",
        color=REFERENCE_COLOUR,
    )
    last.annotate(
        f"{modulus:.0f} GPa, fitted",
        (0.36, 3.6 * modulus),
        (8, -6),
        "data",
        "offset points",
        va="top",
        color=OKABE_ITO["blue"],
    )
    last.set(xlabel="thread strain [%]", xlim=(-0.03, 0.6))
    grid[0].legend(loc="upper left")
    rise = float(table["diameter [mm]"].iloc[0] - table["diameter [mm]"].iloc[5])
    stretch = float(
        table["computed thread_length [mm]"].iloc[0] - table["computed thread_length [mm]"].iloc[5]
    )
    grid[0].set_title(f"{rise:.1f} mm wider at 689 kPa")
    grid[1].set_title(f"threads {stretch:.1f} mm longer")
    grid[2].set_title(f"at most {table['tension [N]'].max():.0f} N, from pressure and diameter")
    grid[3].set_title(f"modulus {modulus:.0f} GPa in place")
    add_panel_letters(grid)
    result.suptitle("Held at its rest length, the muscle widens as its threads stretch", x=0.01, ha="left")
    return result


def draw_figure_7() -> Figure:
    """Draw thread tension and thread length along the isobars."""
    result = create_figure(DOUBLE_COLUMN, 2.9)
    left, right = result.subplots(1, 2)
    _draw_isobars(left, STIFF, lambda length, reading: reading.load / t.STATED["threads"])
    _draw_isobars(right, STIFF, lambda length, reading: 1e3 * reading.thread)
    right.axhline(1e3 * t.THREAD, color=REFERENCE_COLOUR, ls="--", lw=1)
    right.annotate(
        "unloaded", (0, 1e3 * t.THREAD), (2, -3), "data", "offset points", va="top", color=REFERENCE_COLOUR
    )
    reading = predict(t.build_muscle(STIFF), ISOBARS[-1:], np.array([t.LENGTH]))
    tension, stretch = (
        float(reading.load[0]) / t.STATED["threads"],
        1e3 * (float(reading.thread[0]) - t.THREAD),
    )
    left.set(
        xlabel=PERCENT, ylabel="tension of a thread [N]", ylim=(0, None), title=f"at most {tension:.0f} N"
    )
    right.set(xlabel=PERCENT, ylabel="thread length [mm]", title=f"at most {stretch:.1f} mm longer")
    right.set_ylim(1e3 * t.THREAD - 0.15, None)
    add_panel_letters([left, right])
    add_pressure_bar([left, right], LEVELS)
    result.suptitle("Threads are tightest, and longest, at rest length (80 GPa)", x=0.01, ha="left")
    return result


def draw_dimensions(modulus: float, finding: str) -> Figure:
    """Draw Fig. 8 or 9: thread, angle and diameter along the isobars, elastic and inelastic."""
    result = create_figure(DOUBLE_COLUMN, 4.8)
    grid = list(result.subplots(2, 2).flat)
    shown = {
        "thread length [mm]": lambda length, thread: 1e3 * thread * np.ones_like(length),
        "braid angle [°]": _compute_angle,
        "diameter [mm]": _compute_diameter,
    }
    percent, length, _ = compute_isobar(np.inf, ISOBARS[-1])
    for panel, (name, what) in zip(grid, shown.items(), strict=False):
        _draw_isobars(
            panel, modulus, lambda length, reading, what=what: what(length, np.asarray(reading.thread))
        )
        panel.plot(percent, what(length, t.THREAD), "--", color="black", lw=1.0, label="inelastic")
        panel.set(xlabel=PERCENT, ylabel=name)

    def widening(length, reading):
        return _compute_diameter(length, np.asarray(reading.thread)) - _compute_diameter(length, t.THREAD)

    _draw_isobars(grid[3], modulus, widening)
    grid[3].axhline(0, color="black", ls="--", lw=1.0)
    grid[3].set(xlabel=PERCENT, ylabel="wider than inelastic [mm]")
    thread = float(predict(t.build_muscle(modulus), ISOBARS[-1:], np.array([t.LENGTH])).thread[0])
    fall = _compute_angle(t.LENGTH, t.THREAD) - _compute_angle(t.LENGTH, thread)
    rise = _compute_diameter(t.LENGTH, thread) - _compute_diameter(t.LENGTH, t.THREAD)
    grid[0].set_title(f"at most {1e3 * (thread - t.THREAD):.1f} mm longer")
    grid[1].set_title(f"at most {fall:.1f}° smaller")
    grid[2].set_title(f"at most {100 * rise / _compute_diameter(t.LENGTH, t.THREAD):.0f} % wider")
    grid[3].set_title(f"at most {rise:.1f} mm wider, at rest length")
    grid[1].legend(loc="upper right")
    add_panel_letters(grid)
    add_pressure_bar(grid, LEVELS)
    result.suptitle(finding, x=0.01, ha="left")
    return result


def draw_figure_10() -> Figure:
    """Draw the force along the isobars for three braids, elastic and inelastic."""
    result = create_figure(DOUBLE_COLUMN, 2.9)
    panels = list(result.subplots(1, 3, sharey=True))
    for panel, modulus in zip(panels, (STIFF, SOFT, SOFTEST), strict=True):
        for pressure in ISOBARS:
            percent, length, _ = compute_isobar(np.inf, pressure)
            force = np.asarray(braid.gaylord_force(pressure, length, t.THREAD, t.TURNS))
            panel.plot(percent, force / 1e3, "--", color="black", lw=0.6, label="inelastic")
        _draw_isobars(panel, modulus, lambda length, reading: np.asarray(reading.force) / 1e3)
        thread = float(predict(t.build_muscle(modulus), ISOBARS[-1:], np.array([t.LENGTH])).thread[0])
        force, inelastic = (
            float(braid.gaylord_force(ISOBARS[-1], t.LENGTH, b, t.TURNS)) for b in (thread, t.THREAD)
        )
        panel.set_title(f"{modulus / 1e9:.3g} GPa: {100 * (1 - force / inelastic):.1f} % less at rest")
        panel.set(xlabel=PERCENT, ylim=(0, None), xlim=(0, None))
    panels[0].set_ylabel("force [kN]")
    panels[0].legend(handles=panels[0].lines[:1], loc="upper right")
    add_panel_letters(panels)
    add_pressure_bar(panels, LEVELS)
    result.suptitle(
        "The softer the threads, the less force and stroke; Kevlar loses little", x=0.01, ha="left"
    )
    return result


def draw_figures(folder, calibrated: Muscle) -> list:
    """Write all five figures as PNG and PDF into a folder and return the paths."""
    made = {
        "figure-5": draw_figure_5(calibrated),
        "figure-7": draw_figure_7(),
        "figure-8": draw_dimensions(STIFF, "Kevlar of 80 GPa: elastic and inelastic braid are nearly equal"),
        "figure-9": draw_dimensions(
            SOFT,
            "A braid of 8 GPa is far wider than an inelastic one, most of all at rest length",
        ),
        "figure-10": draw_figure_10(),
    }
    return [path for name, drawn in made.items() for path in save_figure(drawn, folder / name)]

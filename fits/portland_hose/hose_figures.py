"""Figures of the hoses: force loops before and after a diagnosis, and the wall of one series."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from shared_wall import HOSES, average_values

from pamjax.diagnosis.result import Diagnosis
from pamjax.records.levels import find_levels, find_nearest_level
from pamjax.view.theme import DOUBLE_COLUMN, OKABE_ITO, REFERENCE_COLOUR, apply_theme, create_figure


def draw_loops(diagnosis: Diagnosis, path: Path) -> None:
    """Draw force against pressure at each length: measured, baseline, and with the named mechanisms."""
    problem = diagnosis.problem
    recording, muscle_toml = problem.case.recording, problem.case.muscle_toml
    lengths = find_levels(recording.length)
    level = find_nearest_level(recording.length, lengths)
    before = problem.predict(diagnosis.baseline.estimate.values)[0]
    after = problem.predict(diagnosis.model.estimate.values)[0]
    rmse = [float(np.sqrt(np.nanmean((problem.measured[0] - force) ** 2))) for force in (before, after)]
    with apply_theme():
        drawing = create_figure(DOUBLE_COLUMN, 3.4)
        panels = drawing.subplots(1, len(lengths), sharey=True)
        for k, panel in enumerate(panels):
            rows = np.flatnonzero((level == k) & np.isfinite(problem.measured[0]))
            p = recording.pressure[rows] / 1e3
            panel.plot(p, problem.measured[0, rows], ".", ms=2, color=REFERENCE_COLOUR, label="measured")
            panel.plot(p, before[rows], ".", ms=1.2, color=OKABE_ITO["vermilion"], label="inelastic braid")
            panel.plot(p, after[rows], ".", ms=1.2, color=OKABE_ITO["blue"], label="named mechanisms added")
            contraction = 100 * (1 - lengths[k] / muscle_toml.rest_length.value)
            panel.set(xlabel="pressure [kPa]", title=f"{1e3 * lengths[k]:.0f} mm, {contraction:.0f} %")
        panels[0].set_ylabel("force [N]")
        names = ", ".join(name.id for name in diagnosis.named_mechanisms) or "no mechanism named"
        title = (
            f"{muscle_toml.name}: rmse {rmse[0]:.3g} N, {rmse[1]:.2g} N with the named mechanisms\n{names}"
        )
        drawing.suptitle(title, x=0.01, ha="left")
        handles, labels = panels[0].get_legend_handles_labels()
        drawing.legend(handles, labels, loc="outside lower center", ncols=3, markerscale=4)
        drawing.savefig(path, dpi=110)


def draw_wall_moduli(results: dict[str, dict], path: Path) -> None:
    """Draw the wall's modulus of each hose of the series and their mean; nothing for fewer than two hoses.

    Args:
        results: by hose, as `diagnose.py` writes them to gains.json.
        path: of the figure.
    """
    key = "bladder_elasticity.modulus"
    names = [name for name in HOSES if name in results and key in results[name]["numbers"]]
    if len(names) < 2:
        return
    values, sds = (np.array([results[n]["numbers"][key][k] for n in names]) / 1e6 for k in (0, 1))
    average = average_values(list(zip(values, sds, strict=True)))
    lengths = [f"{n.rpartition('-')[2]} mm" for n in names]
    summary = f"mean {average.mean:.2f} ± {average.sd:.2f} MPa, χ² {average.chi2:.2g}"
    with apply_theme():
        drawing = create_figure(4.2, 2.6)
        panel = drawing.subplots()
        at = np.arange(len(names))
        low, high = average.mean - average.sd, average.mean + average.sd
        panel.axvspan(low, high, color=OKABE_ITO["blue"], alpha=0.2, lw=0)
        panel.errorbar(values, at, xerr=sds, fmt="o", color=OKABE_ITO["blue"])
        panel.set_yticks(at, lengths)
        panel.set(xlabel="shear modulus of the wall [MPa]")
        panel.set_title(f"{len(names)} lengths of one hose: {summary}")
        drawing.savefig(path, dpi=110)

"""Figures of the hoses: loops before and after naming, and the wall of one series."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from together import HOSES, agreement

from pamjax.diagnosis.result import Diagnosis
from pamjax.records.levels import find_levels, nearest_level
from pamjax.view.theme import DOUBLE, OKABE_ITO, QUIET, figure, theme


def loops(one: Diagnosis, path: Path) -> None:
    """Force against pressure at each length: measured, inelastic baseline, with names."""
    recording, found = one.found.case.recording, one.found
    lengths = find_levels(recording.length)
    at = nearest_level(recording.length, lengths)
    before, after = found.shows(one.baseline.at.values)[0], found.shows(one.model.at.values)[0]
    left = [float(np.sqrt(np.nanmean((found.measured[0] - shown) ** 2))) for shown in (before, after)]
    with theme():
        made = figure(DOUBLE, 3.4)
        panels = made.subplots(1, len(lengths), sharey=True)
        for k, panel in enumerate(panels):
            rows = np.flatnonzero((at == k) & np.isfinite(found.measured[0]))
            p = recording.pressure[rows] / 1e3
            panel.plot(p, found.measured[0, rows], ".", ms=2, color=QUIET, label="measured")
            panel.plot(p, before[rows], ".", ms=1.2, color=OKABE_ITO["vermilion"], label="inelastic braid")
            panel.plot(p, after[rows], ".", ms=1.2, color=OKABE_ITO["blue"], label="with names")
            shorter = 100 * (1 - lengths[k] / one.found.case.entry.rest_length.value)
            panel.set(xlabel="pressure [kPa]", title=f"{1e3 * lengths[k]:.0f} mm, {shorter:.0f} %")
        panels[0].set_ylabel("force [N]")
        names = ", ".join(name.id for name in one.names) or "nothing named"
        told = f"{found.case.entry.name}: {left[0]:.3g} N of misfit, {left[1]:.2g} N with names\n{names}"
        made.suptitle(told, x=0.01, ha="left")
        handles, labels = panels[0].get_legend_handles_labels()
        made.legend(handles, labels, loc="outside lower center", ncols=3, markerscale=4)
        made.savefig(path, dpi=110)


def walls(found: dict[str, dict], path: Path) -> None:
    """Wall modulus of the specimens of one series, apart and together."""
    key = "bladder_elasticity.modulus"
    names = [name for name in HOSES if name in found and key in found[name]["numbers"]]
    if len(names) < 2:
        return
    values, sds = (np.array([found[n]["numbers"][key][k] for n in names]) / 1e6 for k in (0, 1))
    mean, sd, square, _ = agreement(list(zip(values, sds, strict=True)))
    lengths = [f"{n.rpartition('-')[2]} mm" for n in names]
    told = ", ".join(f"{n} {v:.2f} ± {s:.2f}" for n, v, s in zip(lengths, values, sds, strict=True))
    answer = f"{mean:.2f} ± {sd:.2f} MPa together, χ² {square:.2g} for {len(names) - 1}"
    print(f"wall modulus, MPa: {told}; {answer}")
    with theme():
        made = figure(4.2, 2.6)
        panel = made.subplots()
        at = np.arange(len(names))
        panel.axvspan(mean - sd, mean + sd, color=OKABE_ITO["blue"], alpha=0.2, lw=0)
        panel.errorbar(values, at, xerr=sds, fmt="o", color=OKABE_ITO["blue"])
        panel.set_yticks(at, lengths)
        panel.set(xlabel="shear modulus of the wall [MPa]")
        panel.set_title(f"Four lengths of one hose: {answer}")
        made.savefig(path, dpi=110)

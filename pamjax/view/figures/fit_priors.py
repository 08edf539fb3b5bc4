"""Figure of the priors of a fit: how much did the recording change them?"""

from __future__ import annotations

import math

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pamjax.infer.fitting.result import Estimate, Fit
from pamjax.units import format_estimate
from pamjax.view.figures.layout import (
    create_mark,
)
from pamjax.view.theme import (
    DOUBLE_COLUMN,
    OKABE_ITO,
    REFERENCE_COLOUR,
    SINGLE_COLUMN,
    apply_theme,
    create_figure,
)
from pamjax.view.wording import format_signed, wrap_title

#: Smallest shift that is reported, in standard deviations of the prior.
_MIN_PRIOR_SHIFT = 0.05


def plot_prior(fit: Fit, narrow: bool = False) -> Figure | None:
    """Return prior and estimate of each parameter in sd of the prior; None if no prior was stated."""
    estimates = select_with_prior(fit)
    names = list(estimates)
    if not names:
        return None
    with apply_theme():
        drawing = create_figure(SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 1.3 + 0.22 * max(len(names), 3))
        panel = drawing.subplots()
        panel.axvspan(-1, 1, color=REFERENCE_COLOUR, alpha=0.3, lw=0, gid="prior")
        panel.axvline(0, color=REFERENCE_COLOUR, lw=0.6)
        for y, estimate in enumerate(estimates.values()):
            _plot_estimate(panel, y, estimate)
        panel.set_yticks(range(len(names)), names)
        panel.set_ylim(len(names) - 0.5, -0.5)
        low, high = panel.get_xlim()
        panel.set_xlim(min(low, -2.5), max(high, 2.5))
        panel.set(xlabel="estimate − prior [sd of the prior]")
        title = _format_sd_reduction(fit)
        # Use the width of the figure, because the panel of a phone is too narrow.
        drawing.suptitle(wrap_title(title, 48) if narrow else title, x=0.01, ha="left", fontsize=8)
        handles = [
            create_mark("prior ± 1 sd", marker="s", ms=7, alpha=0.3),
            create_mark("estimate ± 1 sd", marker="o", ls="-", color=OKABE_ITO["blue"]),
        ]
        if any(estimate.sd is None for estimate in estimates.values()):
            handles.append(create_mark("at a limit, or without sd", marker="x", color=OKABE_ITO["vermilion"]))
        drawing.legend(handles=handles, loc="outside lower center", ncols=2 if narrow else 3)
    return drawing


def select_with_prior(fit: Fit) -> dict[str, Estimate]:
    """Return the estimates with a finite prior standard deviation."""
    return {name: estimate for name, estimate in fit.estimates.items() if math.isfinite(estimate.prior_sd)}


def _plot_estimate(panel: Axes, y: int, estimate: Estimate) -> None:
    """Draw one row: the estimate in sd of the prior, and its value as text at the right edge."""
    text = format_estimate(estimate.value, estimate.sd, estimate.meaning.show)
    shift = (estimate.value - estimate.prior) / estimate.prior_sd
    if estimate.sd is None:
        panel.plot([shift], [y], "x", color=OKABE_ITO["vermilion"], gid="undetermined")
    else:
        panel.errorbar(
            [shift],
            [y],
            xerr=[estimate.sd / estimate.prior_sd],
            fmt="o",
            color=OKABE_ITO["blue"],
            gid="estimate",
        )
    panel.text(1.01, y, text, transform=panel.get_yaxis_transform(), va="center", fontsize=7)


def _format_sd_reduction(fit: Fit) -> str:
    """Return the title: how many standard deviations the recording halves, and the largest shift."""
    estimates = select_with_prior(fit)
    determined_count = sum(estimate.is_determined for estimate in estimates.values())
    group = "parameters" if len(estimates) == len(fit.estimates) else "parameters with a prior"
    text = f"The recording at least halves the sd of {determined_count} of {len(estimates)} {group}"
    shifts = {
        name: (estimate.value - estimate.prior) / estimate.prior_sd for name, estimate in estimates.items()
    }
    most_shifted = max(shifts, key=lambda name: abs(shifts[name]))
    if abs(shifts[most_shifted]) < _MIN_PRIOR_SHIFT:
        return f"{text};\nno estimate differs from its prior"
    return f"{text};\nlargest shift: {most_shifted}, {format_signed(shifts[most_shifted])} sd of its prior"

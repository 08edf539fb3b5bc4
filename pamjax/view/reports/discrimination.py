"""Report of a discrimination: the best protocol to distinguish two mechanisms, then all protocols."""

from __future__ import annotations

import math
import textwrap
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from pamjax.diagnosis.next_experiment.experiment import Experiment
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.model.registry import find_mechanism
from pamjax.planning.discriminate import Discrimination
from pamjax.units import format_quantity
from pamjax.view.reports.page import build_picture, write_page
from pamjax.view.theme import (
    DOUBLE_COLUMN,
    OKABE_ITO,
    REFERENCE_COLOUR,
    SINGLE_COLUMN,
    apply_theme,
    create_figure,
)
from pamjax.view.wording import capitalise_sentence

#: Largest number of protocols in the figure.
_MAX_DRAWN_PROTOCOLS = 8


def _plot_power(discrimination: Discrimination, narrow: bool = False) -> Figure:
    """Return a bar chart of the most powerful protocols, with the sufficient power."""
    rows = discrimination.ranked_experiments[:_MAX_DRAWN_PROTOCOLS]
    labels = [
        "\n".join(textwrap.wrap(_format_protocol(experiment), 26 if narrow else 62)) for experiment in rows
    ]
    lines = sum(name.count("\n") + 1 for name in labels)
    with apply_theme():
        drawing = create_figure(
            SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 0.8 + 0.14 * lines + 0.12 * len(rows)
        )
        panel = drawing.subplots()
        colours = [
            OKABE_ITO["blue"] if experiment is discrimination.chosen_experiment else REFERENCE_COLOUR
            for experiment in rows
        ]
        panel.barh(range(len(rows)), [experiment.power for experiment in rows], color=colours, height=0.55)
        for k, experiment in enumerate(rows):
            panel.annotate(
                _format_duration(experiment), (experiment.power, k), (4, 0), textcoords="offset points",
                va="center", fontsize=7,
            )  # fmt: skip
        sufficient_power = DEFAULT_SETTINGS.sufficient_power
        panel.axvline(sufficient_power, color=REFERENCE_COLOUR, ls=":", lw=0.9, gid="sufficient")
        panel.set_yticks(range(len(rows)), labels)
        panel.invert_yaxis()
        panel.set(xlim=(0, 1.15), xticks=(0, 0.5, sufficient_power, 1), xlabel="power")
        verb = "would have" if discrimination.neither_explains else "has"
        experiment = discrimination.chosen_experiment
        panel.set_title(f"{experiment.id} {verb} a power of {_format_power(experiment)}")
    return drawing


def _format_protocol(experiment: Experiment) -> str:
    """Return the protocol without its duration."""
    return f"{experiment.id}: {experiment.protocol.rpartition(' (')[0]}"


def _format_power(experiment: Experiment) -> str:
    return "above 0.99" if experiment.power > 0.99 else f"{experiment.power:.2f}"


def _format_duration(experiment: Experiment) -> str:
    return f"{experiment.minutes:.0f} min" if experiment.minutes < 90 else f"{experiment.minutes / 60:.0f} h"


def write_discrimination_report(discrimination: Discrimination, path: str | Path, command: str = "") -> Path:
    """Write the report of a discrimination between two mechanisms.

    Args:
        discrimination: the discrimination.
        path: the HTML file; its folder must exist.
        command: shell command that repeats it.
    """
    return write_page(
        path,
        "discrimination.html.jinja",
        title=format_headline(discrimination),
        kicker=f"Next experiment for {discrimination.case.name} · {' or '.join(discrimination.ids)}",
        answer=format_answer(discrimination),
        power=build_picture(partial(_plot_power, discrimination), "power"),
        protocols=[_build_row(experiment) for experiment in discrimination.ranked_experiments],
        alarm=f"{DEFAULT_SETTINGS.false_alarm_rate:.0%}",
        ids=discrimination.ids,
        about=[f"{id}: {find_mechanism(id).about.title}" for id in discrimination.ids],
        rig=_list_rig_rows(discrimination),
        checksum=discrimination.case.checksum,
        command=command or "pamjax.discriminate(...)",
    )


def format_headline(discrimination: Discrimination) -> str:
    """Return the result in one line."""
    if discrimination.neither_explains:
        return f"Neither {' nor '.join(discrimination.ids)} explains this recording"
    if discrimination.is_distinguished:
        return f"This recording already distinguishes {' from '.join(discrimination.ids)}"
    sufficient_power = DEFAULT_SETTINGS.sufficient_power
    if discrimination.chosen_experiment.power < sufficient_power:
        return f"No protocol distinguishes the mechanisms with a power of {sufficient_power:g}"
    duration = _format_duration(discrimination.chosen_experiment)
    return f"A protocol of {duration} distinguishes {' from '.join(discrimination.ids)}"


def format_answer(discrimination: Discrimination) -> tuple[str, ...]:
    """Return the protocol with its power, and the present verdict; a misfit of both comes first."""
    is_sufficient = discrimination.chosen_experiment.power >= DEFAULT_SETTINGS.sufficient_power
    kind = "Recommended" if is_sufficient else "Most powerful"
    protocol = _format_protocol(discrimination.chosen_experiment).partition(": ")[2]
    protocol_text = f"protocol: {protocol} ({_format_duration(discrimination.chosen_experiment)})."
    power_text = (
        f"If {discrimination.ids[0]} is present, the test selects it with probability"
        f" {_format_power(discrimination.chosen_experiment)}."
    )
    models_text = f"{capitalise_sentence(discrimination.model_sentence)}."
    if not discrimination.neither_explains:
        sentences = (
            f"{kind} {protocol_text} {power_text}",
            f"{capitalise_sentence(discrimination.comparison_sentence)}.",
        )
        return (*(sentences[::-1] if discrimination.is_distinguished else sentences), models_text)
    summary = discrimination.residual_summary
    return (
        f"{summary[:1].upper()}{summary[1:]}. Until then the test cannot select one of the two.",
        f"{kind} {protocol_text} {power_text} The power is valid only if one of the two is present.",
        models_text,
    )


def _build_row(experiment: Experiment) -> list[str]:
    limit = f"{experiment.chi2_limit:.1f}" if math.isfinite(experiment.chi2_limit) else "never rejected"
    return [
        experiment.id,
        _format_protocol(experiment).partition(": ")[2],
        f"{experiment.power:.2f}",
        _format_duration(experiment),
        limit,
    ]


def _list_rig_rows(discrimination: Discrimination) -> list[list[str]]:
    rig = discrimination.testbed.rig
    # An isotonic rig sets the force, and measures no force.
    rows = (
        [
            ["highest pressure", format_quantity(rig.max_pressure, "kPa", 3)],
            ["largest contraction", f"{rig.max_contraction:.0%}"],
            ["speed of a stroke", f"{1e3 * rig.speed:.3g} mm/s"],
            ["time between two samples", f"{rig.step:.3g} s"],
            ["noise of force, per row", format_quantity(rig.force_noise, "N", 2)],
        ]
        if rig.load is None
        else [
            ["highest pressure", format_quantity(rig.max_pressure, "kPa", 3)],
            ["set force", format_quantity(rig.load, "N", 3)],
            ["speed of a pressure ramp", f"{rig.pressure_speed / 1e3:.3g} kPa/s"],
            ["time between two samples", f"{rig.step:.3g} s"],
        ]
    )
    rows += [
        ["noise of diameter, per row", format_quantity(rig.diameter_noise, "mm", 2)],
        ["noise of pressure, per row", format_quantity(rig.pressure_noise, "kPa", 2)],
        ["noise of length, per row", format_quantity(rig.length_noise, "mm", 2)],
    ]
    noise_factor = discrimination.testbed.sd_inflation
    return rows + (
        [["factor on the noise, because of the misfit of both models", f"{noise_factor:.2f}"]]
        if noise_factor > 1
        else []
    )

"""Report of a fleet: its findings, distributions over specimens, mechanisms, and a row for each case."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from pamjax.fleet.analysis import FleetAnswers, ParameterDistribution
from pamjax.fleet.fleet import Fleet
from pamjax.fleet.frames import list_rows
from pamjax.fleet.store import DONE, OPEN
from pamjax.fleet.summary import (
    format_distribution,
    format_sd,
    format_states,
    format_value,
    list_findings,
    name_distribution,
    name_frequency,
)
from pamjax.units import format_count
from pamjax.view.figures import fleet as figures
from pamjax.view.reports.page import Picture, build_picture, write_page
from pamjax.view.wording import capitalise_sentence

#: Largest number of distributions with figures; the others are in the table.
_MAX_DRAWN_DISTRIBUTIONS = 6
#: Largest number of findings at the top of the page.
_MAX_TOP_FINDINGS = 3
#: Largest number of cases in the table; of more, those with a finding come first.
_MAX_TABLE_CASES = 1000


@dataclass(frozen=True)
class LinkedRow:
    """Row of a table whose first cell is a link.

    Attributes:
        name: text of the first cell.
        link: relative address of its page; "" without one.
        cells: the other cells.
    """

    name: str
    link: str
    cells: list[str]


def write_fleet_report(fleet: Fleet, answers: FleetAnswers, path: Path, command: str) -> Path:
    """Write the report of a fleet.

    Args:
        fleet: the fleet.
        answers: its answers.
        path: the HTML file, in the folder of the store, so that its links lead to the reports of the cases.
        command: shell command that repeats the report.
    """
    findings = list_findings(answers)
    failed = [row for row in list_rows(fleet.cases) if row["state"] not in (DONE, OPEN)]
    return write_page(
        path,
        "fleet.html.jinja",
        title=capitalise_sentence(findings[0].rstrip(".")),
        kicker=f"Fleet {fleet.name} · {format_states(fleet)}",
        answer=findings[1:_MAX_TOP_FINDINGS],
        more=findings[_MAX_TOP_FINDINGS:],
        distributions=_draw_distributions(answers),
        distribution_rows=[_build_distribution_row(distribution) for distribution in answers.distributions],
        mechanism_map=build_picture(
            lambda narrow: figures.plot_mechanism_map(fleet, answers, narrow), "mechanisms"
        ),
        frequencies=[
            [
                name_frequency(frequency),
                f"{frequency.count} of {frequency.total}",
                f"{frequency.interval[0]:.0%} to {frequency.interval[1]:.0%}",
                ", ".join(f"{bench} {n} of {total}" for bench, (n, total) in frequency.by_bench.items())
                or "–",
            ]
            for frequency in answers.mechanisms
        ],
        cases=_build_case_rows(fleet, answers),
        dash_note=_format_dash_note(fleet),
        hidden_cases=max(len(fleet.cases) - _MAX_TABLE_CASES, 0),
        failed=[LinkedRow(row["case"], "", [row["state"], row["reason"]]) for row in failed],
        inputs=_describe_settings(fleet),
        command=command,
    )


def _draw_distributions(answers: FleetAnswers) -> list[dict[str, Any]]:
    """Return the figures of the distributions with findings first."""
    ranked = sorted(answers.distributions, key=lambda d: -_count_findings(d))[:_MAX_DRAWN_DISTRIBUTIONS]
    return [
        {
            "name": name_distribution(distribution),
            "ridge": _draw(partial(figures.plot_ridge, distribution), f"ridge-{k}"),
            "ridge_caption": _format_ridge_caption(distribution),
            "chart": _draw(partial(figures.plot_control_chart, distribution), f"chart-{k}"),
        }
        for k, distribution in enumerate(ranked)
    ]


def _draw(plot: Any, name: str) -> Picture | None:
    return build_picture(lambda narrow: plot(narrow=narrow), name)


def _count_findings(distribution: ParameterDistribution) -> int:
    findings = int(distribution.pooled.outliers.sum()) + len(distribution.deviating_benches)
    return findings + int(distribution.drifts)


def _format_ridge_caption(distribution: ParameterDistribution) -> str:
    """Return what the curves of a ridge are, and which specimens it leaves out."""
    text = "Each curve: one specimen with its own uncertainty. Lowest curve: the distribution over specimens."
    if distribution.shares_prior:
        text += " A prior that several specimens share is removed."
    if distribution.unusable_count:
        text += (
            f" {format_count(distribution.unusable_count, 'recording')} without a usable estimate left out."
        )
    drawn = len(figures.select_ridges(distribution.pooled.estimate, distribution.pooled.outliers))
    count = len(distribution.pooled.estimate)
    if drawn < count:
        text += f" {drawn} of {count} specimens are drawn."
    return text


def _build_distribution_row(distribution: ParameterDistribution) -> list[str]:
    pooled, unit = distribution.pooled, distribution.unit
    low, high = pooled.between_interval
    return [
        name_distribution(distribution),
        str(len(pooled.estimate)),
        format_value(pooled.mean, pooled.mean_sd, unit),
        format_sd(pooled.between_sd, unit),
        f"{format_sd(low, '1')} to {format_sd(high, unit)}",
        format_sd(float(np.median(pooled.sd)), unit),
    ]


def _build_case_rows(fleet: Fleet, answers: FleetAnswers) -> list[LinkedRow]:
    deviations = _list_deviations(answers)
    mechanisms = fleet.mechanisms.groupby("case")["id"].agg(list).to_dict()
    rows = []
    for row in list_rows(fleet.cases):
        name = row["case"]
        cells = ["–" if row[key] is None else str(row[key]) for key in ("bench", "serial", "date")]
        cells += [row["state"], ", ".join(mechanisms.get(name, [])) or "–"]
        cells += [
            "yes" if row["unexplained"] else "–",
            _format_validation(row),
            "; ".join(deviations.get(name, [])) or "–",
        ]
        rows.append(LinkedRow(name, quote(row["report"] or ""), cells))
    if len(rows) > _MAX_TABLE_CASES:
        rows = sorted(rows, key=lambda row: row.name not in deviations)[:_MAX_TABLE_CASES]
    return rows


def _format_validation(row: dict[str, Any]) -> str:
    """Return how many blocks the tested model predicts to the noise."""
    if row["validation_blocks"] is None:
        return "–"
    text = f"{row['validation_blocks_within_noise']} of {row['validation_blocks']}"
    text += f", {row['validation_failed_rows']} rows failed" if row["validation_failed_rows"] else ""
    return f"{text} (fitted)" if row["validation_seen"] else text


def _format_dash_note(fleet: Fleet) -> str:
    """Return the meaning of a dash in the table of the cases."""
    note = "A dash means: not stated, or none."
    if "diagnose" in fleet.settings["stages"]:
        return note
    return f"{note} No diagnosis ran, so that mechanisms and unexplained misfit are not known."


def _list_deviations(answers: FleetAnswers) -> dict[str, list[str]]:
    """Return the parameters in which the specimen of a case is an outlier, with its deviation."""
    deviations: dict[str, list[str]] = {}
    for distribution in answers.distributions:
        for k in np.flatnonzero(distribution.pooled.outliers):
            text = f"{distribution.name} {distribution.pooled.deviation[k]:+.1f} sd"
            for case in distribution.estimates.cases[k]:
                deviations.setdefault(case, []).append(text)
    return deviations


def _describe_settings(fleet: Fleet) -> list[list[str]]:
    """Return the settings and versions of the run as rows of a table."""
    settings, versions = fleet.settings["settings"], fleet.settings["versions"]
    rows = [["stages", ", ".join(fleet.settings["stages"])], ["seed", str(settings["seed"])]]
    rows += [
        [f"{stage}, {name}", str(value)]
        for stage in ("fit", "sample", "validate")
        for name, value in settings.get(stage, {}).items()
        if value not in (None, [])
    ]
    return [*rows, *([f"version of {name}", str(value)] for name, value in versions.items())]


def format_fleet_summary(fleet: Fleet, answers: FleetAnswers) -> str:
    """Return the findings and distributions of a fleet as text for the screen."""
    lines = [f"{fleet.name}: {format_states(fleet)}", *(f"  {line}" for line in list_findings(answers))]
    return "\n".join(lines + [f"  {format_distribution(d)}" for d in answers.distributions])

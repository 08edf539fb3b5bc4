"""The report of a sizing: diameters at rest and under pressure, tables, and the shortfall if infeasible."""

import math
import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import pamjax
from pamjax.sizing import chance_constraints
from pamjax.sizing.infeasible import format_amount
from pamjax.sizing.io import build_design_document
from pamjax.sizing.shopping import list_checks
from pamjax.view.figures.sizing import plot_chart, plot_sensitivities
from pamjax.view.reports.sizing import format_answer, format_headline, write_design_report
from tests.view.html_page import Page

SPEC = {
    "name": "test",
    "minimise": "diameter",
    "supply": {"pressure": "600 kPa"},
    "force": [{"at_least": "400 N", "contraction": 0.1}],
    "envelope": {"length": "250 mm", "diameter": "40 mm"},
    "threads": {"kinds": "pet", "counts": [48, 72], "diameters": "0.3 mm"},
    "bladders": {"kinds": "latex"},
    "tolerance": {"turns": 0.005},
}
HARD = SPEC | {
    "supply": {"pressure": "300 kPa"},
    "force": [{"at_least": "5 kN", "contraction": 0.2}],
    "envelope": {"length": "200 mm", "diameter": "15 mm"},
    "threads": {"kinds": "aramid", "counts": 144, "diameters": "1 mm"},
    "tolerance": {},
}

pytestmark = pytest.mark.slow


@cache
def size_spec(hard):
    """Return a feasible design with a required probability, or an infeasible one if `hard`."""
    return pamjax.size(HARD if hard else SPEC, inelastic_and_front=False, starts=2)


@cache
def page(hard):
    with TemporaryDirectory() as folder:
        return Page(write_design_report(size_spec(hard), Path(folder) / "report.html").read_text("utf-8"))


def test_each_diameter_is_labelled_at_rest_or_under_pressure():
    design = size_spec(False)
    widest, bladder = (f"{1e3 * x:.4g} mm" for x in (design.output("widest"), design.numbers["diameter"]))
    assert widest != bladder
    assert format_headline(design).endswith(f"diameter {widest} under pressure")
    assert f"outer diameter of {bladder}" in format_answer(design)[0]
    assert f"largest outer diameter is {widest}" in format_answer(design)[0]


def test_table_of_choices_marks_the_chosen_and_the_nearest():
    design = size_spec(False)
    rows = page(False).table(["choice", "minimum diameter"])
    assert [mark for _, _, mark in rows.values()].count("chosen") == 1
    value, probability, _ = rows[str(design.choice)]
    assert float(value.split()[0]) == pytest.approx(1e3 * design.objective, rel=1e-3)
    assert float(probability) >= 0.9
    # The chosen one is the best of those that reach the probability.
    reaching = [float(row[0].split()[0]) for row in rows.values() if float(row[1]) >= 0.9]
    assert min(reaching) == float(value.split()[0])
    assert page(True).table(["choice", "at typical properties"])[str(size_spec(True).choice)][1] == "nearest"


def test_table_of_requirements_has_no_empty_column():
    assert len(page(False).table(["requirement", "margin"])["working pressure at most 600 kPa"]) == 3
    rows = page(True).table(["requirement", "margin"])
    assert {len(row) for row in rows.values()} == {2}
    assert rows["force at least 5000 N at 20 % contraction"][1] == "the spec"
    assert rows["safety factor at least 2 for rubber elongation"][1] == "pamjax"


def test_receipt_lists_sources_and_tolerances():
    for hard in (False, True):
        assert not re.search(r"sources \w+;", page(hard).text)
        assert "Tension Technology International" in page(hard).text
    assert "one standard deviation: turns ± 0.005 (from the spec); rest length ±" in page(False).text
    assert "Ace Hose" in page(False).text


def test_page_states_the_cost_of_the_probability_and_of_sold_parts():
    design, sentences = size_spec(False), format_answer(size_spec(False))
    nominal, sold = (
        1e3 * math.exp(result.optimum.log_objective) for result in (design.nominal, design.nominal_stock)
    )
    assert nominal <= sold <= 1e3 * design.objective
    assert f"{nominal:.4g} mm for the nominal design" in sentences[2]
    assert f"{sold:.4g} mm with parts that are sold" in sentences[2]
    assert f"{1e3 * design.objective:.4g} mm with this probability" in sentences[2]
    # Each requirement is at least as probable as all of them together.
    rows = page(False).table(["requirement", "margin"])
    assert min(float(row[1]) for row in rows.values()) >= float(sentences[1].split()[6])
    assert all(0 <= float(row[1]) <= 1 for row in rows.values())


def test_page_lists_the_parts_and_their_checks():
    design = size_spec(False)
    parts = page(False).table(["part", "quantity"])
    assert len(parts) == 4
    assert f"{design.choice.threads} threads of" in " ".join(row[1] for row in parts.values())
    for check in list_checks(design):
        assert check in page(False).text
    assert "Parts to buy" not in page(True).text


def test_infeasible_design_reports_the_shortfall():
    design = size_spec(True)
    force = design.output("force", 1)
    shortfall = f"{format_amount(force, 'N')}, {format_amount(5000 - force, 'N')} too low"
    assert all(relaxation.relaxed_bound is None for relaxation in design.relaxations)
    assert f"force at least 5000 N at 20 % contraction: the nearest muscle has {shortfall}" in str(design)
    assert "Removing one requirement alone is not sufficient" in page(True).text
    assert shortfall in plot_chart(design).axes[0].get_title("left")


def test_operating_point_above_the_supply_has_an_isobar():
    design = size_spec(True)
    assert design.numbers["pressure"] > 1.1 * design.spec.supply
    figure = plot_chart(design)
    (isobar,) = (line for line in figure.axes[0].lines if line.get_gid() == "working")
    (points,) = (line for line in figure.axes[0].lines if line.get_gid() == "available")
    x, y = points.get_data()
    assert np.interp(x[0], *isobar.get_data()) == pytest.approx(y[0], rel=5e-3)
    assert any("above the supply pressure" in text.get_text() for text in figure.legends[0].get_texts())


def test_title_reports_the_saving_of_a_relaxation():
    assert re.search(
        r"” by 1 % reduces diameter by \S+ %", plot_sensitivities(size_spec(False)).get_suptitle()
    )


def test_without_a_fitting_tube_no_part_counts_as_sold():
    # No latex tube of the table has a wall between 0.79 and 1.19 mm.
    design = pamjax.size(
        SPEC | {"limits": {"wall": ["0.9 mm", "1.1 mm"]}}, inelastic_and_front=False, starts=2
    )
    assert design.feasible
    assert design.misses_stock
    assert design.nominal_stock is None
    assert design.choice_count == len(design.results)
    assert "with parts that are sold" not in str(design)
    assert "No tube of the table fits" in format_answer(design)[-1]
    document = build_design_document(design)
    assert document["nominal"]["any_size"] == pytest.approx(
        1e3 * math.exp(design.nominal.optimum.log_objective)
    )
    assert document["nominal"]["sold_parts"] is None
    assert not document["sold_parts"]
    assert "no tube that is sold fits" in document["receipt"]["searched"]
    assert not any("with tubes that are sold" in line for line in document["receipt"]["searched"])
    with TemporaryDirectory() as folder:
        text = write_design_report(design, Path(folder) / "report.html").read_text("utf-8")
    assert "no tube that is sold fits" in text


def test_probability_of_the_table_is_that_of_the_answer():
    design = size_spec(False)
    assert design.finalists[0].probability == design.probability


def test_reported_probability_has_draws_that_selected_nothing(monkeypatch):
    draw_builds, uses = chance_constraints.draw_builds, []

    def record(problem, transfer, errors, count, seed):
        uses.append((count, seed))
        return draw_builds(problem, transfer, errors, count, seed)

    monkeypatch.setattr(chance_constraints, "draw_builds", record)
    design = pamjax.size(SPEC, inelastic_and_front=False, starts=2, stock=False, seed=5)
    assert design.misses_probability == (design.probability < 0.9)
    *selecting, reporting = uses
    assert reporting == (chance_constraints.REPORT_DRAWS, 7)
    assert {seed for _, seed in selecting} == {5, 6}

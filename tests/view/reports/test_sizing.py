"""The report of a sizing: which width is which, what a table's numbers are, and by how much nothing fits."""

import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import pamjax
from pamjax.sizing.infeasible import format_amount
from pamjax.view.figures.sizing import plot_chart, plot_prices
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
def sized(hard):
    """A design that keeps all, wanted with a probability, or one that cannot."""
    return pamjax.size(HARD if hard else SPEC | {"probability": 0.9}, margins=False, starts=2)


@cache
def page(hard):
    with TemporaryDirectory() as folder:
        return Page(write_design_report(sized(hard), Path(folder) / "report.html").read_text("utf-8"))


def test_a_width_says_whether_it_is_at_rest_or_under_pressure():
    design = sized(False)
    widest, bladder = (f"{1e3 * x:.4g} mm" for x in (design.output("widest"), design.numbers["diameter"]))
    assert widest != bladder
    assert format_headline(design).endswith(f"diameter {widest} under pressure")
    assert f"a bladder of {bladder} outside" in format_answer(design)[0]
    assert f"widens to {widest} at most" in format_answer(design)[0]


def test_other_choices_are_marked_and_told_as_what_they_are():
    rows = page(False).table(["choice", "at typical values"])
    assert [mark for _, mark in rows.values()].count("chosen") == 1
    typical, _ = rows[str(sized(False).choice)]
    assert float(typical.split()[0]) < 1e3 * sized(False).objective
    assert "To hold with probability 0.9 a muscle takes more" in page(False).text
    assert page(True).table(["choice", "at typical values"])[str(sized(True).choice)][1] == "nearest"


def test_a_column_without_a_number_is_not_shown():
    assert len(page(False).table(["requirement", "room"])["work at 600 kPa at most"]) == 3
    rows = page(True).table(["requirement", "room"])
    assert {len(row) for row in rows.values()} == {2}
    assert rows["pull 5000 N at 20 %"][1] == "the spec"
    assert rows["rubber stretched to 1/2 of its break"][1] == "pamjax"


def test_a_receipt_names_its_sources_and_what_is_not_known():
    for hard in (False, True):
        assert not re.search(r"sources \w+;|taken as exact", page(hard).text)
        assert "Tension Technology International" in page(hard).text
    assert "how exactly it is built, one standard deviation: turns ± 0.005" in page(False).text
    assert "it is built exactly as drawn: the spec states no [tolerance]" in page(True).text


def test_what_is_out_of_reach_is_told_by_how_much():
    design = sized(True)
    force = design.output("force", 1)
    says = f"{format_amount(force, 'N')}, {format_amount(5000 - force, 'N')} short"
    assert all(give.relaxed_bound is None for give in design.relaxations)
    assert f"pull 5000 N at 20 %: the nearest muscle has {says}" in str(design)
    assert "No one requirement, given up alone, is enough" in page(True).text
    assert says in plot_chart(design).axes[0].get_title("left")


def test_a_working_point_beyond_the_supply_lies_on_a_line():
    design = sized(True)
    assert design.numbers["pressure"] > 1.1 * design.spec.supply
    figure = plot_chart(design)
    (own,) = (line for line in figure.axes[0].lines if line.get_gid() == "working")
    (there,) = (line for line in figure.axes[0].lines if line.get_gid() == "there")
    x, y = there.get_data()
    assert np.interp(x[0], *own.get_data()) == pytest.approx(y[0], rel=5e-3)
    assert any("beyond the supply" in text.get_text() for text in figure.legends[0].get_texts())


def test_a_price_is_what_easier_saves():
    assert re.search(r"” made 1 % easier saves \S+ % of diameter", plot_prices(sized(False)).get_suptitle())

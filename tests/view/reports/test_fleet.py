"""The report of a fleet: links to the cases, figures, and names that are shown as text."""

import pytest

pytest.importorskip("pyarrow", reason="needs the extra pamjax[fleet]")

from pamjax.fleet.analysis import analyse_fleet
from pamjax.fleet.fleet import open_fleet
from pamjax.view.figures.fleet import plot_control_chart
from pamjax.view.reports.fleet import write_fleet_report
from tests.fleet.made_store import write_made_store
from tests.view.html_page import Page


def write_report(folder, count=12, **entries):
    values = [90.0 + 2 * ((7 * k) % 5) for k in range(count)]
    store = write_made_store(folder, values, **entries)
    fleet = open_fleet(store)
    path = write_fleet_report(fleet, analyse_fleet(fleet), store / "report.html", "pamjax fleet report store")
    return path.read_text("utf-8")


def find_links(page):
    return [attributes["href"] for tag, attributes in page.elements if tag == "a"]


def test_each_case_leads_to_its_report(tmp_path):
    benches = ["north", "south"] * 6
    mechanisms = [["pressure_gain"] if bench == "south" else [] for bench in benches]
    text = write_report(tmp_path, benches=benches, mechanisms=mechanisms)
    page = Page(text)
    links = find_links(page)
    assert links == [f"cases/case-{k:02d}/diagnose/report.html" for k in range(12)]
    assert all((tmp_path / link).is_file() for link in links)
    assert "pressure_gain is identified in 6 of 6 recordings of made on rig south" in text
    # Map of mechanisms, ridge and control chart, each wide and narrow.
    assert sum(tag == "svg" for tag, _ in page.elements) == 6
    assert not [tag for tag, _ in page.elements if tag in ("script", "img", "link", "iframe")]


def test_dashes_are_explained(tmp_path):
    note = "No diagnosis ran, so that mechanisms and unexplained misfit are not known."
    assert note in write_report(tmp_path / "fit")
    assert note not in write_report(tmp_path / "both", mechanisms=[[]] * 12)


def test_serial_numbers_are_whole_numbers_on_the_axis(tmp_path):
    fleet = open_fleet(write_made_store(tmp_path, [90.0, 92.0, 91.0]))
    fleet.cases["date"] = None
    (distribution,) = analyse_fleet(fleet).distributions
    assert distribution.order_name == "serial number"
    (axes,) = plot_control_chart(distribution).axes
    assert all(tick == round(tick) for tick in axes.get_xticks())


def test_names_are_shown_as_text(tmp_path):
    hostile = ["<script>alert(1)<", "a$b^{", "javascript:alert(1)", '"onclick="x', "c#d?e", "plain"]
    mechanisms = [["pressure_gain"]] * 6
    text = write_report(tmp_path, 6, names=hostile, benches=["<b>", "$x"] * 3, mechanisms=mechanisms)
    page = Page(text)
    assert not [tag for tag, _ in page.elements if tag in ("script", "b")]
    assert not [attributes for _, attributes in page.elements if "onclick" in attributes]
    assert all(link.startswith("cases/") for link in find_links(page))
    assert set(hostile) <= {entry.strip() for entry in page.entries}


def test_each_recording_of_an_outlier_is_marked(tmp_path):
    values = [90.0 + (k // 2) % 5 + (60 if k // 2 == 4 else 0) for k in range(24)]
    store = write_made_store(
        tmp_path,
        values,
        serials=[f"A-{k // 2}" for k in range(24)],
        benches=["north", "south"] * 12,
        mechanisms=[["pressure_gain"]] * 24,
    )
    fleet = open_fleet(store)
    page = Page(
        write_fleet_report(fleet, analyse_fleet(fleet), store / "report.html", "c").read_text("utf-8")
    )
    marks = [entry for entry in page.entries if entry.strip().startswith("thread.modulus +")]
    assert len(marks) == 2
    assert "A-4 (2 recordings)" in " ".join(page.entries)


def test_large_fleet_has_a_short_page(tmp_path):
    text = write_report(
        tmp_path, 150, benches=["north", "south"] * 75, mechanisms=[["pressure_gain"], []] * 75
    )
    assert "40 of 150 specimens are drawn" in text
    assert "Share of the recordings of each rig" in text


def test_equal_fleets_give_equal_reports(tmp_path):
    first, second = write_report(tmp_path / "a"), write_report(tmp_path / "b")
    assert first == second

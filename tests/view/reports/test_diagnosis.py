"""The report of a diagnosis: one whole file, readable by anyone, saying what diagnosis.json says."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import pytest

from pamjax.diagnosis.result import ParameterEstimate, format_named_estimate
from pamjax.model.parameters import find_meaning
from pamjax.records.reading.muscle_toml import Sensors
from pamjax.view.figures.diagnosis import plot_shifts
from pamjax.view.reports.diagnosis import _list_shifts, format_answer, format_headline, write_diagnosis_report
from pamjax.view.reports.page import render_svg
from pamjax.view.wording import format_noise
from tests.view.html_page import Page
from tests.view.made_up import diagnosis, holds, lengths, planned, table

VARIANTS = {
    "friction": {},
    "tied": {"ties": ("channel_lag",), "experiments": (planned(),), "protocol": table},
    "nothing": {"detected": False, "protocol": holds},
    "unknown": {"named": False, "unexplained": True, "diameter": False, "protocol": lengths},
}


@cache
def written(variant):
    """The report of a variant; drawn once for all tests."""
    with TemporaryDirectory() as folder:
        path = write_diagnosis_report(diagnosis(**VARIANTS[variant]), Path(folder) / "report.html")
        assert [file.name for file in path.parent.iterdir()] == ["report.html"]
        return path.read_text("utf-8")


@pytest.fixture
def page():
    return Page(written("friction"))


@pytest.mark.parametrize("variant", VARIANTS)
def test_it_is_whole_offline_and_has_words_for_every_picture(variant):
    text = written(variant)
    found = Page(text)
    # Nothing is loaded: all that is pointed at is in the file itself.
    assert not re.search(
        r"""(?:src|href)\s*=\s*["'](?!#|data:)|url\((?!#)|@import|https?://(?!www\.w3)""", text
    )
    assert found.every("script") == []
    pictures = found.every("svg")
    assert len(pictures) >= 4
    assert all(p["role"] == "img" and len(p["aria-label"]) > 20 for p in pictures)
    names = [attrs["id"] for _, attrs in found.elements if "id" in attrs]
    assert len(names) == len(set(names))
    links = set(re.findall(r'href="#([^"]+)"|url\(#([^)]+)\)', text))
    assert {one or other for one, other in links} <= set(names)
    heads = [tag for tag, _ in found.elements if tag in ("h1", "h2", "h3")]
    assert heads.count("h1") == 1
    assert not re.search(r"\bnan\b|\bNone\b|\binf\b", found.text)


def test_it_says_what_the_verdict_says(page):
    told = diagnosis().as_dict()
    held = page.table(["channel", "baseline"])
    for channel, unit in (("force", "N"), ("diameter", "mm")):
        score = told["improvement"]["held_out"][channel]
        wanted = (score["rmse_before"], score["rmse_after"], told["noise"][channel]["sd"])
        assert [float(cell.removesuffix(unit)) for cell in held[channel]] == pytest.approx(wanted, rel=1e-3)
    (name,) = told["missing_physics"]
    number = name["parameters"]["coefficient"]
    assert page.table(["number", "value"])["coefficient"][0] == f"{number['value']:.3f} ± {number['sd']:.3f}"
    moved = page.table(["number", "baseline alone"])["thread.modulus"]
    assert moved == ["80.0 ± 1.2 GPa", "92.0 ± 1.2 GPa", "+8.9 sd"]
    (box,) = told["mismatch"]["where"]
    row = page.table(["box", "channel"])["1"]
    assert row[:3] == ["force", "lengthening", "100 to 400 kPa"]
    assert row[-1] == f"{100 * box['share']:.0f} %"
    assert box["says"] in page.text
    assert "probability 0.98" in page.text


def test_noise_is_the_lab_s_and_what_is_added(page):
    assert "Noise of force is 2 N a sample, as the lab states it; neighbours share it by 0.30." in page.text
    case = SimpleNamespace(entry=SimpleNamespace(sensors=Sensors(force=2.0)))
    says = format_noise(case, "force", 3.18)
    assert says.startswith("Noise of force is 3.18 N a sample: 2 N as the lab states it, the rest added")


def test_what_did_not_move_has_no_sign():
    one = diagnosis()
    one.parameter_shifts["muscle.turns"] = replace(one.parameter_shifts["muscle.turns"], shift=-0.04)
    assert [row[-1] for row in _list_shifts(one)] == ["+8.9 sd", "0.0 sd"]


@pytest.mark.parametrize("variant", VARIANTS)
def test_what_to_do_next_is_named(variant):
    text = Page(written(variant)).text
    for command in ("validate model.json OTHER", "inverse model.json", "simulate model.json"):
        assert f"pamjax {command}" in text
    assert ("no names tied" in text) == (variant == "friction")
    assert "No experiment was planned" not in text


def test_a_note_has_the_digits_of_its_report(page):
    cell = page.table(["number", "value"])["coefficient"][0]
    assert f"    coefficient {cell}" in str(diagnosis()).splitlines()
    assert format_named_estimate(
        "constant", ParameterEstimate(9.2e-6, 0.48, find_meaning("braid_friction.constant"))
    ) == ("constant 0.00 ± 0.48 N")


def test_a_long_name_may_break_and_a_table_that_goes_on_says_so(page):
    assert "thread.<wbr>modulus" in written("friction")
    assert "thread.modulus" in page.table(["number", "baseline alone"])
    assert re.search(r"\.scroll \{[^}]*no-repeat local[^}]*no-repeat scroll", written("friction"))


def test_the_first_screen_answers_in_two_sentences():
    one = diagnosis()
    assert format_headline(one) == "Left out: friction between braid threads"
    first, second = format_answer(one)
    assert first.startswith("The elastic baseline misses something (p\u00a0<\u00a01e-12): above 100 kPa")
    before, after = (s["force"] for s in (one.gain.rmse_before, one.gain.rmse_after))
    assert f"held-out force is missed by {after:.3g} instead of {before:.3g} N" in second
    assert "diameter" not in second


@pytest.mark.parametrize(
    ("more", "title", "words"),
    [
        ({"detected": False}, "Nothing is missing that this recording could show", "to its noise (p = 0.43)"),
        (
            {"named": False, "unexplained": True},
            "Something is missing, and it is nothing that pamjax knows",
            "No mechanism in pamjax's library explains it",
        ),
        ({"named": False}, "Something is missing, too faint to be named", "a name would be a guess"),
        (
            {"unexplained": True},
            "Left out: friction between braid threads, and something that pamjax does not know",
            "12% of the misfit is left unexplained.",
        ),
    ],
    ids=["null", "unknown", "faint", "partly"],
)
def test_other_answers(more, title, words):
    one = diagnosis(**more)
    assert format_headline(one) == title
    assert words in " ".join(format_answer(one)).replace("\u00a0", " ")


def test_ties_and_the_next_experiment_are_told():
    page = Page(written("tied"))
    assert "This recording cannot tell it from channel_lag" in page.text
    assert page.table(["protocol", "separates"])["stroke at 1 and at 50 mm/s"] == [
        "viscous_damping and braid_friction",
        "0.97",
    ]


def test_without_a_name_nothing_stands_after():
    found = Page(written("nothing"))
    (score,) = (row for name, row in found.table(["channel", "baseline"]).items() if name == "force")
    assert len(score) == 2
    assert "Which numbers had swallowed the effect" not in found.text
    assert found.table(["number", "value"])["thread.modulus"][0] == "80.0 ± 1.2 GPa"


def test_it_ends_with_how_to_repeat_it(page):
    assert "pamjax diagnose 'lab/my bench'" in page.text
    assert "SHA-256 c0ffee" in page.text
    assert re.search(r"pamjax \d+\.\d+\.\d+, jax ", page.text)
    assert "turns and thread length only together" in page.text


def test_the_same_figure_gives_the_same_element():
    drawn = [render_svg(plot_shifts(diagnosis()), "moved", "<as told>") for _ in range(2)]
    assert drawn[0] == drawn[1]
    assert 'aria-label="&lt;as told&gt;"' in drawn[0]

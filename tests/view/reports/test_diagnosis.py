"""The report of a diagnosis: one complete offline file that agrees with diagnosis.json."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pamjax.baselines.comparison import ComparisonSplit, ModelComparison
from pamjax.diagnosis.estimates import ParameterEstimate
from pamjax.diagnosis.settings import DiagnosisSettings, describe_settings
from pamjax.diagnosis.suggested_commands import list_suggested_commands
from pamjax.diagnosis.summary import format_named_estimate
from pamjax.model.parameters import find_meaning
from pamjax.records.reading.muscle_toml import Sensors
from pamjax.view.figures.diagnosis import plot_shifts
from pamjax.view.reports.diagnosis import (
    _format_changed_settings,
    _list_settings,
    _list_shifts,
    write_diagnosis_report,
)
from pamjax.view.reports.diagnosis_answer import list_answers, list_held_out_bars
from pamjax.view.reports.page import render_svg
from pamjax.view.wording import format_noise
from tests.view.html_page import Page
from tests.view.made_up import add_form_error, diagnosis, holds, lengths, planned, table

VARIANTS = {
    "friction": {},
    "tied": {"ties": ("channel_lag",), "experiments": (planned(),), "protocol": table},
    "nothing": {"detected": False, "protocol": holds},
    "unknown": {"named": False, "unexplained": True, "diameter": False, "protocol": lengths},
}


@cache
def read_report(variant):
    """Return the report of a variant, written once for all tests."""
    with TemporaryDirectory() as folder:
        path = write_diagnosis_report(diagnosis(**VARIANTS[variant]), Path(folder) / "report.html")
        assert [file.name for file in path.parent.iterdir()] == ["report.html"]
        return path.read_text("utf-8")


@pytest.fixture
def page():
    return Page(read_report("friction"))


@pytest.mark.parametrize("variant", VARIANTS)
def test_report_is_offline_and_describes_each_figure(variant):
    text = read_report(variant)
    page = Page(text)
    # The page loads nothing: all links point into the file.
    assert not re.search(
        r"""(?:src|href)\s*=\s*["'](?!#|data:)|url\((?!#)|@import|https?://(?!www\.w3)""", text
    )
    assert page.every("script") == []
    pictures = page.every("svg")
    assert len(pictures) >= 4
    assert all(p["role"] == "img" and len(p["aria-label"]) > 20 for p in pictures)
    names = [attrs["id"] for _, attrs in page.elements if "id" in attrs]
    assert len(names) == len(set(names))
    links = set(re.findall(r'href="#([^"]+)"|url\(#([^)]+)\)', text))
    assert {first or second for first, second in links} <= set(names)
    heads = [tag for tag, _ in page.elements if tag in ("h1", "h2", "h3")]
    assert heads.count("h1") == 1
    assert not re.search(r"\bnan\b|\bNone\b|\binf\b", page.text)


def test_the_last_section_lists_all_settings(page):
    shown = page.table(["setting", "value"])
    assert list(shown) == [setting.name for setting in describe_settings()]
    assert shown["detection_p_value"][0] == "0.01"


def test_a_changed_setting_is_shown_with_its_default():
    changed = diagnosis()
    problem: Any = changed.problem
    problem.settings = DiagnosisSettings(detection_p_value=1e-3)
    rows = {row[0]: row[1] for row in _list_settings(changed)}
    assert rows["detection_p_value"] == "0.001 (default 0.01)"
    assert rows["tie_chi2"] == "12"


def test_report_agrees_with_the_result(page):
    document = diagnosis().as_dict()
    errors = page.table(["channel", "baseline"])
    for channel, unit in (("force", "N"), ("diameter", "mm")):
        score = document["improvement"]["held_out"][channel]
        rmse = (score[f"rmse_{kind}"] for kind in ("before", "after", "expected"))
        expected = (*rmse, document["noise"][channel]["sd"])
        shown = [float(cell.removesuffix(unit)) for cell in errors[channel]]
        assert shown == pytest.approx(expected, rel=1e-3)
    (name,) = document["missing_physics"]
    number = name["parameters"]["coefficient"]
    assert (
        page.table(["parameter", "value"])["coefficient"][0] == f"{number['value']:.3f} ± {number['sd']:.3f}"
    )
    shift = page.table(["parameter", "baseline alone"])["thread.modulus"]
    assert shift == ["80.0 ± 1.2 GPa", "92.0 ± 1.2 GPa", "+8.9 sd"]
    (region,) = document["mismatch"]["where"]
    row = page.table(["region", "channel"])["1"]
    assert row[:3] == ["force", "lengthening", "100 to 400 kPa"]
    assert row[-1] == f"{100 * region['share']:.0f} %"
    assert region["says"].rstrip(".") in page.text
    assert "probability 0.98" in page.text


def test_noise_is_split_into_stated_and_added_noise(page):
    noise = "Noise of force is 2 N per row, as stated in muscle.toml."
    assert f"{noise} The autocorrelation of adjacent rows is 0.30." in page.text
    case = SimpleNamespace(muscle_toml=SimpleNamespace(sensors=Sensors(force=2.0)))
    sentence = format_noise(case, "force", 3.18)
    assert sentence.startswith(
        "Noise of force is 3.18 N per row. Stated in muscle.toml: 2 N; the difference is due to the noise"
    )


@pytest.mark.slow
def test_form_error_is_shown_beside_the_textbook_part(tmp_path):
    result = add_form_error(diagnosis())
    page = Page(write_diagnosis_report(result, tmp_path / "report.html").read_text("utf-8"))
    assert "Form error: 2 N rms, 10 % of the textbook part." in page.text
    # The effect on the diameter is far below its noise.
    assert "Textbook part: 20 N rms, according to" in page.text
    scores = page.table(["channel", "baseline"])
    errors = [float(cell.split()[0]) for cell in scores["force"]]
    # The made-up form error is wrong by 2 N.
    assert errors[2] ** 2 == pytest.approx(errors[1] ** 2 + 2.0**2, rel=0.1)


def test_exact_mechanism_has_no_form_error(tmp_path):
    result = add_form_error(diagnosis(), share=0.0)
    page = Page(write_diagnosis_report(result, tmp_path / "report.html").read_text("utf-8"))
    assert (
        "Textbook part: 20 N rms, according to the equation of the mechanism. Form error: none." in page.text
    )
    assert "with form errors" not in page.text
    assert "Textbook part" not in Page(read_report("friction")).text


def test_unchanged_parameter_has_no_sign():
    result = diagnosis()
    shift = result.parameter_shifts["muscle.turns"]
    result.parameter_shifts["muscle.turns"] = replace(shift, shift_in_sd=-0.04)
    assert [row[-1] for row in _list_shifts(result)] == ["+8.9 sd", "0.0 sd"]


@pytest.mark.parametrize(("scale", "text"), [(10.0, "2100 N"), (0.01, "2.1 N")])
def test_example_force_has_no_exponent(scale, text):
    result = diagnosis()
    recording = result.problem.case.recording
    force = scale * np.where(
        np.arange(recording.n) == 5, 210.0, np.where(np.arange(recording.n) == 6, 420.0, 0)
    )
    case = replace(result.problem.case, recording=replace(recording, force=force))
    problem = SimpleNamespace(**vars(result.problem) | {"case": case})
    commands = " ".join(command for _, command in list_suggested_commands(replace(result, problem=problem)))
    assert f'--force "{text}"' in commands


@pytest.mark.parametrize("variant", VARIANTS)
def test_next_experiment_is_named(variant):
    text = Page(read_report(variant)).text
    for command in ("validate model.json OTHER", "inverse model.json", "simulate model.json"):
        assert f"pamjax {command}" in text
    assert ("The recording distinguishes each named mechanism from all others." in text) == (
        variant == "friction"
    )
    assert "from the others" not in text


def test_text_and_report_have_the_same_digits(page):
    cell = page.table(["parameter", "value"])["coefficient"][0]
    assert f"    coefficient {cell}" in str(diagnosis()).splitlines()
    assert format_named_estimate(
        "constant", ParameterEstimate(9.2e-6, 0.48, find_meaning("braid_friction.constant"))
    ) == ("constant 0.00 ± 0.48 N")


def test_long_names_wrap_and_wide_tables_are_marked(page):
    assert "thread.<wbr>modulus" in read_report("friction")
    assert "thread.modulus" in page.table(["parameter", "baseline alone"])
    assert re.search(r"\.scroll \{[^}]*no-repeat local[^}]*no-repeat scroll", read_report("friction"))


def test_questions_precede_the_map_and_the_evidence():
    text = read_report("friction")
    places = [
        text.index(word) for word in ("<h1>", ">How sure<", ">How much better<", ">Next<", "<svg", "<h2>")
    ]
    assert places == sorted(places)


def test_bars_show_the_channels_that_improve(page):
    (bar,) = list_held_out_bars(diagnosis())
    assert bar.channel == "force"
    assert [label for label, _, _ in bar.rows] == ["baseline", "with mechanisms", "noise"]
    assert bar.rows[0][2] == pytest.approx(100)
    assert bar.rows[1][2] < 20
    (picture,) = (attrs for attrs in page.every("div") if attrs.get("class") == "bars")
    assert picture["aria-label"].startswith("RMS error of force on held-out blocks: baseline")
    assert list_held_out_bars(diagnosis(detected=False)) == []


@pytest.mark.parametrize(("share", "is_shown"), [(0.5, True), (0.99, False)])
def test_a_formula_with_a_smaller_error_is_on_the_first_screen(share, is_shown):
    result = diagnosis()
    model_rmse = result.held_out_errors.model_rmse["force"]
    rmse = {
        "baseline": {"force": 50.0},
        "named": {"force": model_rmse},
        "sarosi": {"force": share * model_rmse},
    }
    split = ComparisonSplit("held out", "276 kPa", result.held_out_errors.held_out_mask, rmse, {})
    comparison = ModelComparison((split,), {"force": 1.0})
    (answer,) = (a for a in list_answers(result, comparison) if a.question == "How much better")
    assert ("interpolate with it" in " ".join(answer.sentences)) == is_shown
    (bar,) = list_held_out_bars(result, comparison)
    assert ("Sárosi's formula" in [label for label, _, _ in bar.rows]) == is_shown
    assert ("interpolate with it" in str(comparison)) == is_shown


def test_pointer_shows_the_value_of_each_cell():
    shortening, lengthening = re.findall(r'<g class="misfit">(.*?)</g>', read_report("friction"), re.S)[:2]
    for svg, sign in ((shortening, "−"), (lengthening, "+")):
        titles = re.findall(r"<title>(.*?)</title></path>", svg)
        assert len(titles) == svg.count("<path") == 4 * 18
        assert sum(title.startswith(sign) for title in titles) > 60
        assert re.fullmatch(
            r"[+−]\d+\.\d sd: contraction 0\.00 to 0\.56 %, pressure 50 to 150 kPa", titles[0]
        )
    titles = re.findall(r"<title>(.*?)</title></path>", read_report("tied"))
    assert titles.count("no measurement: row 0.00 to 0.22, pressure 133 to 167 kPa") == 2  # wide and narrow


def test_isobars_of_the_loops_can_be_chosen_without_a_script(page):
    labels = [attrs["id"] for attrs in page.every("input")]
    assert labels == ["group-all", "group-0", "group-1", "group-2", "group-3"]
    text = read_report("friction")
    for k in range(4):
        assert f"body:has(#group-{k}:checked)" in text
        assert f'class="measured group-{k}"' in text
    assert "Show" not in Page(read_report("tied")).text


def test_settings_are_folded_and_changed_ones_are_named():
    text = read_report("friction")
    assert text.index("<details>") < text.index("detection_p_value") < text.index("</details>")
    assert "settings of the diagnosis have their default values." in Page(text).text
    changed = diagnosis()
    problem: Any = changed.problem
    problem.settings = DiagnosisSettings(detection_p_value=1e-3)
    assert _format_changed_settings(changed).endswith("default values: detection_p_value = 0.001.")


def test_ties_and_the_next_experiment_are_reported():
    page = Page(read_report("tied"))
    three = replace(planned(), separates=("viscous_damping", "braid_friction", "channel_lag"))
    summary = str(diagnosis(ties=("channel_lag",), experiments=(three,)))
    assert "separates viscous_damping, braid_friction and channel_lag with probability 0.97" in summary
    assert "This recording cannot distinguish it from channel_lag" in page.text
    assert page.table(["protocol", "separates"])["stroke at 1 and at 50 mm/s"] == [
        "viscous_damping and braid_friction",
        "0.97",
    ]


def test_report_without_a_mechanism_has_no_improved_model():
    page = Page(read_report("nothing"))
    (score,) = (row for name, row in page.table(["channel", "baseline"]).items() if name == "force")
    assert len(score) == 2
    assert "Bias of the baseline parameters" not in page.text
    assert page.table(["parameter", "value"])["thread.modulus"][0] == "80.0 ± 1.2 GPa"


def test_a_recording_with_too_few_blocks_says_that_nothing_was_held_out():
    result = diagnosis()
    held_out = result.held_out_errors.held_out_mask
    assert "The mechanisms were selected without the held-out blocks." in read_report("friction")
    assert "no block was held out" not in str(result)
    errors = replace(
        result.held_out_errors,
        held_out_mask=np.zeros_like(held_out),
        baseline_rmse={},
        model_rmse={},
        expected_rmse={},
    )
    without = replace(result, held_out_errors=errors)
    assert "no block was held out (too few blocks): no independent rows confirm" in str(without)
    with TemporaryDirectory() as folder:
        text = write_diagnosis_report(without, Path(folder) / "report.html").read_text("utf-8")
    assert "All rows were used to select the mechanisms" in text
    assert "selected without the held-out blocks" not in text


def test_report_ends_with_the_command(page):
    assert "pamjax diagnose 'lab/my bench'" in page.text
    assert "SHA-256 of the recording and muscle.toml: c0ffee" in page.text
    assert re.search(r"pamjax \d+\.\d+\.\d+, jax ", page.text)
    assert "turns and thread length are determined only in combination" in page.text


def test_identical_figures_give_identical_elements():
    svgs = [render_svg(plot_shifts(diagnosis()), "moved", "<finding>") for _ in range(2)]
    assert svgs[0] == svgs[1]
    assert 'aria-label="&lt;finding&gt;"' in svgs[0]


#: A name that runs a script in a page that does not escape it.
HOSTILE_NAME = """<img src=x onerror=alert(1)><script>alert(1)</script>"' onclick='alert(1) $x^{ {{ 7*7 }}"""


def test_names_are_shown_as_text(tmp_path):
    hostile = diagnosis()
    case = hostile.problem.case
    hostile.problem.case = replace(
        case,
        name=HOSTILE_NAME,
        folder=Path("lab") / HOSTILE_NAME,
        muscle_toml=replace(case.muscle_toml, name=HOSTILE_NAME),
        warnings=(HOSTILE_NAME,),
    )
    page = Page(write_diagnosis_report(hostile, tmp_path / "report.html").read_text("utf-8"))
    assert page.list_active_parts() == Page(read_report("friction")).list_active_parts()
    assert HOSTILE_NAME in page.text


def test_active_part_of_a_page_is_detected():
    assert Page("<p>a</p>").list_active_parts() == []
    assert Page(f"<p>{HOSTILE_NAME}</p>").list_active_parts() == ["script", "onerror", "x"]


@pytest.mark.parametrize("variant", VARIANTS)
def test_no_line_breaks_within_a_p_value(variant):
    text = read_report(variant)
    p_values = re.findall(r"p (?:&lt;|=) \d", text)
    assert p_values
    assert len(re.findall(r'<span class="whole">p (?:&lt;|=) [\d.e-]+</span>', text)) == len(p_values)
    assert ".whole { white-space: nowrap; }" in text
    # A search for the text of the summary finds it.
    assert variant != "friction" or "p < 1e-12" in Page(text).text


@pytest.mark.parametrize("variant", VARIANTS)
def test_expected_error_is_explained_where_it_is_shown(variant):
    text = Page(read_report(variant)).text
    explanation = (
        "The expected error is that of a correct model, from the noise and the uncertainty of its parameters."
        " If the error with mechanisms is more than 3 times as large, part of the misfit counts as"
        " unexplained."
    )
    assert (explanation in text) == ("expected from noise and parameters" in text)
    assert ("expected from noise and parameters" in text) == (variant in ("friction", "tied"))


def test_commands_have_the_path_of_the_model(tmp_path):
    path = write_diagnosis_report(diagnosis(), tmp_path / "report.html", folder="out/my case")
    text = Page(path.read_text("utf-8")).text.replace("\u00a0", " ")
    for command in ("validate", "inverse", "simulate"):
        assert f"pamjax {command} 'out/my case/model.json' " in text
    assert "Run these commands in the folder in which you ran the diagnosis:" in text
    assert "Run this command" not in text
    assert not re.search(r"pamjax \w+ model\.json", text)


def test_commands_without_a_path_state_their_folder():
    text = Page(read_report("friction")).text
    assert "pamjax validate model.json OTHER. Run this command in the folder of this report." in " ".join(
        text.split()
    ).replace(" .", ".")
    assert "Run these commands in the folder of this report:" in text

"""A plan of an isotonic rig sets forces; its information has the closed form of inextensible threads."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pamjax.errors import BadInput
from pamjax.planning.isotonic_runs import list_isotonic_runs
from pamjax.planning.plan import plan
from pamjax.planning.prior_information import build_prior_information
from pamjax.planning.report import format_usual_protocol
from pamjax.planning.rig_capabilities import read_capabilities
from pamjax.records.dataframe import case_from
from pamjax.records.reading.muscle_toml import read_muscle_toml
from pamjax.view.figures.plan import PrecisionCourse, plot_commands, plot_precision
from pamjax.view.reports.plan import write_plan_report
from tests.agreement import SOLVED, agree

REST, THREAD, TURNS = 0.2, 0.214, 1.2
TOML = """
[muscle]
name = "free"
rest_length = "200 mm"
thread_length = {value = "214 mm", sd = "2 mm"}
turns = 1.2

[test]
measured = "length"
load = "10 N"

[sensors]
length = "0.1 mm"
pressure = "1 kPa"
"""


def solve_length(pressure, force, thread=THREAD):
    """Return L of P (3 L² − B²) / (4 π N²) = F."""
    return np.sqrt((4 * np.pi * TURNS**2 * force / pressure + thread**2) / 3)


@pytest.fixture(scope="module")
def muscle_toml():
    return read_muscle_toml(TOML.encode())


@pytest.fixture(scope="module")
def capabilities(muscle_toml):
    return read_capabilities(muscle_toml, pressure="600 kPa", load="100 N")


def find_hold(capabilities, share):
    """Return the hold with the largest set force at a share of the highest pressure."""
    return next(
        run
        for run in list_isotonic_runs(capabilities)
        if "hold" in run.description
        and run.load is not None
        and run.load[0] == capabilities.max_load
        and run.pressure[0] == pytest.approx(share * capabilities.max_pressure)
    )


def test_information_agrees_with_the_closed_form(muscle_toml, capabilities):
    prior = build_prior_information(muscle_toml, capabilities)
    high = find_hold(capabilities, 1.0)
    pressure, force = 600e3, 100.0
    length, slope = solve_length(pressure, force), THREAD / (3 * solve_length(pressure, force))
    by_pressure = -4 * np.pi * TURNS**2 * force / pressure**2 / (6 * length)
    variance = 1e-4**2 + (1e3 * by_pressure) ** 2
    got = prior.compute_run_information([high], prior.mean)[0]
    columns = {
        "muscle.thread_length": slope,
        "pressure_offset.offset": -by_pressure,
        "pressure_gain.gain": -pressure * by_pressure,
        "length_offset.offset": 1.0,
        "rig_compliance.compliance": force,
    }
    assert set(columns) == set(prior.space.names)
    expected = np.array([columns[n] for n in prior.space.names]) * prior.scale
    expected = high.pressure.size * np.outer(expected, expected) / variance
    agree(got, expected, SOLVED, scale=np.abs(expected).max())
    # Information of a set length would depend on the noise of a load cell.
    wrong = expected * (1e-4 / 2.0) ** 2
    assert not np.allclose(got, wrong, rtol=0.5)


def test_weight_that_the_muscle_cannot_lift_gives_no_information(muscle_toml, capabilities):
    prior = build_prior_information(muscle_toml, capabilities)
    assert prior.compute_run_information([find_hold(capabilities, 0.2)], prior.mean).any()
    heavy = replace(capabilities, max_load=1000.0)
    assert solve_length(0.2 * 600e3, 1000.0) > REST
    assert not prior.compute_run_information([find_hold(heavy, 0.2)], prior.mean).any()


def test_plan_sets_forces_and_measures_length(muscle_toml, tmp_path):
    result = plan(muscle_toml, goal="muscle.thread_length", to="0.1 mm", minutes=30.0)
    text, table = str(result), result.schedule()
    assert list(table.columns) == ["time [s]", "pressure [kPa]", "force [N]", "cycle"]
    assert len(table) == result.rows > 0
    assert set(np.round(table["force [N]"], 6)) <= set(np.round(result.prior.capabilities.loads, 6))
    assert not any(word in text for word in ("stroke", "% contraction", "rest length", "load cell", "force_"))
    assert "it measures length" in text
    assert "pressure ramps at 10 N in the same time" in text
    assert "ramps_in_the_same_time" in result.as_dict()
    assert not result.single_channel
    course = PrecisionCourse.from_plan(result)
    assert plot_precision(result, course).axes
    commands = plot_commands(result)
    assert commands is not None
    assert [panel.get_ylabel() for panel in commands.axes] == ["pressure [kPa]", "force [N]"]
    page = write_plan_report(result, course, tmp_path / "report.html").read_text()
    assert "set forces" in page
    assert "speed of a stroke" not in page


def test_a_ramp_needs_no_fast_rig(muscle_toml):
    result = plan(muscle_toml, goal="muscle.thread_length", to="0.1 mm", minutes=30.0)
    after = result.expected_sds[result.goal].expected_sd
    better = format_usual_protocol(replace(result, usual_sd=0.5 * after))
    assert better.startswith(
        "pressure ramps at 10 N in the same time would determine muscle.thread_length to"
    )
    assert "better than this plan" in better


def test_diameter_of_a_camera_is_a_second_channel(muscle_toml):
    rig = read_capabilities(muscle_toml, pressure="600 kPa", diameter="0.1 mm")
    assert rig.channels == ("length", "diameter")
    assert rig.keep_channel("length").channels == ("length",)
    result = plan(muscle_toml, rig, "muscle.thread_length", "0.1 mm", minutes=30.0)
    assert list(result.single_channel) == ["length"]
    assert "length alone determines muscle.thread_length" in str(result)


def test_loads_are_those_of_the_test_and_a_weight_that_the_muscle_can_lift(muscle_toml, tmp_path):
    rig = read_capabilities(muscle_toml, pressure="600 kPa")
    ideal = 600e3 * (3 * REST**2 - THREAD**2) / (4 * np.pi * TURNS**2)
    agree(rig.loads, [10.0, (10.0 + 0.2 * ideal) / 2, 0.2 * ideal], SOLVED)
    file = tmp_path / "rig.toml"
    file.write_text('[rig]\nload = "0 N"\n')
    assert read_capabilities(muscle_toml, file).loads.tolist() == [0.0]

    recorded = read_capabilities(muscle_toml, recorded_loads=(20.0, 30.0), load="30 N")
    assert recorded.loads.tolist() == [20.0, 25.0, 30.0]


@pytest.mark.parametrize("entry", ["contraction = 0.2", 'speed = "1 mm/s"', 'force_zero = "5 N"'])
def test_entry_of_a_rig_that_measures_force_is_refused(muscle_toml, tmp_path, entry):
    file = tmp_path / "rig.toml"
    file.write_text(f"[rig]\n{entry}\n")
    with pytest.raises(BadInput, match="has no meaning on a rig that sets the force"):
        read_capabilities(muscle_toml, file)


def test_load_of_a_rig_that_measures_force_is_refused(tmp_path):
    kevlar = Path(__file__).parents[2] / "fits" / "chambers_wereley_2022" / "muscle.toml"
    file = tmp_path / "rig.toml"
    file.write_text('[rig]\nload = "50 N"\n')
    with pytest.raises(BadInput, match="`load` has no meaning on a rig that measures the force"):
        read_capabilities(read_muscle_toml(kevlar.read_bytes()), file)


def test_residual_of_a_recording_without_stated_noise_counts_as_noise():
    table = {"pressure [kPa]": np.linspace(50, 600, 12)}
    exact = solve_length(table["pressure [kPa]"] * 1e3, 10.0) * 1e3
    residual = np.where(np.arange(12) % 2, 3.0, -3.0)
    muscle = {
        "muscle": {"rest_length": "200 mm", "thread_length": {"value": "214 mm", "sd": "2 mm"}, "turns": 1.2},
        "test": {"measured": "length", "load": "10 N"},
    }
    case = case_from(pd.DataFrame(table | {"length [mm]": exact + residual}), muscle, name="free")
    result = plan(case, goal="muscle.thread_length", to="1 mm", minutes=20.0)
    assert 2.5e-3 < result.prior.capabilities.length_sd < 4e-3
    assert re.search(r"the residual of the recording counts as noise \(3\.\d mm\)", str(result))
    stated = case_from(
        pd.DataFrame(table | {"length [mm]": exact + residual}),
        muscle | {"sensors": {"length": "3 mm"}},
        name="free",
    )
    assert "counts as noise" not in str(plan(stated, goal="muscle.thread_length", to="1 mm", minutes=20.0))

"""The information of a plan follows from exact derivatives, and its predicted sd is reached."""

import re
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.infer.problem.priors import collect_stated_values
from pamjax.model.assembly import assemble
from pamjax.model.muscle import predict
from pamjax.planning.information import build_placeholder_case
from pamjax.planning.plan import compute_sd_course, plan
from pamjax.planning.prior_information import build_prior_information
from pamjax.planning.report import format_usual_protocol
from pamjax.planning.rig_capabilities import RigCapabilities, read_capabilities
from pamjax.planning.runs import list_runs
from pamjax.records.case import Case
from pamjax.records.reading.muscle_toml import Sensors, read_muscle_toml
from pamjax.records.recording import Recording
from pamjax.view.figures.plan import PrecisionCourse, plot_commands, plot_precision
from pamjax.view.reports.plan import format_answer, format_headline
from tests.agreement import ROUNDING, SOLVED, agree, difference
from tests.benchmarks.plan import report, rms, shown, trial
from tests.infer.made import made

KEVLAR = Path(__file__).parents[2] / "fits" / "chambers_wereley_2022" / "muscle.toml"


@pytest.fixture(scope="module")
def muscle_toml():
    return read_muscle_toml(KEVLAR.read_bytes())


def test_information_agrees_with_finite_differences_through_the_rig(muscle_toml):
    known = build_prior_information(
        muscle_toml, RigCapabilities(max_pressure=690e3, pressure_sd=0.0, length_sd=0.0)
    )
    pressure, length = np.array([200e3, 400e3, 690e3]), np.array([0.2357, 0.21, 0.19])
    values, label = known.mean.copy(), np.zeros(3, int)
    rig = [k for k in range(values.size) if k not in known.muscle_indices]
    values[rig] = 0.0  # where the plan's derivatives are taken
    got = known.compute_information(build_placeholder_case(muscle_toml, pressure, length), label, 1, values)[
        0
    ]
    fixed = {"muscle.rest_length": 0.2357, "muscle.threads": 144.0, "muscle.thread_area": 0.0858e-6}

    def show(k):
        def at(step):
            moved = jnp.asarray(values).at[k].add(step * known.scale[k])
            return shown(
                "elastic", known.space.names, fixed, moved, jnp.asarray(pressure), jnp.asarray(length)
            )

        return difference(at, 0.0, 1e-3)

    slopes = np.stack([show(k) for k in range(values.size)])
    weight = 1 / np.array([known.capabilities.force_sd, known.capabilities.diameter_sd]) ** 2
    expected = np.einsum("icn,jcn,c->ij", slopes, slopes, weight)
    root = np.sqrt(np.diag(expected))
    agree(got / np.outer(root, root), expected / np.outer(root, root), 1e-5, scale=1.0)


@pytest.fixture(scope="module")
def by_ruler(muscle_toml):
    """Return the muscle on a bench whose lengths are set by ruler, with one error for each length."""
    sensors = Sensors(force=2.0, diameter=1e-4, pressure=700.0, length=1e-3, length_per_level=True)
    return replace(muscle_toml, sensors=sensors)


def test_ruler_error_is_shared_by_all_samples_of_a_length(by_ruler):
    means = read_capabilities(by_ruler, pressure="690 kPa")
    assert (means.length_level_sd, means.length_sd) == (1e-3, 0.0)
    known = build_prior_information(by_ruler, replace(means, pressure_sd=0.0))
    pressure, length = np.array([200e3, 400e3, 690e3]), np.array([0.2357, 0.2357, 0.19])
    length_level, label, shared = np.array([0, 0, 3]), np.zeros(3, int), len(known.free_parameters) - 5
    values = np.where(np.arange(known.mean.size) < len(known.muscle_indices), known.mean, 0.0)
    run_information = known.compute_information(
        build_placeholder_case(by_ruler, pressure, length), label, 1, values, length_level
    )[0]
    rulers = run_information[shared:, shared:] + np.eye(5)
    got = run_information[:shared, :shared] - run_information[:shared, shared:] @ np.linalg.solve(
        rulers, run_information[shared:, :shared]
    )
    fixed = {"muscle.rest_length": 0.2357, "muscle.threads": 144.0, "muscle.thread_area": 0.0858e-6}
    at = "elastic", known.space.names[:shared], fixed
    start, p, x = (jnp.asarray(v) for v in (values[:shared], pressure, length))

    def show(k):
        return difference(lambda d: shown(*at, start.at[k].add(d * known.scale[k]), p, x), 0.0, 1e-3)

    slopes = np.stack([show(k) for k in range(shared)]).reshape(shared, -1)
    by_length = difference(lambda d: shown(*at, start, p, x + 1e-3 * d), 0.0, 1e-2).ravel()
    same = np.tile(length_level, 2)
    covariance = np.diag(np.repeat([4.0, 1e-8], 3)) + np.outer(by_length, by_length) * np.equal.outer(
        same, same
    )
    expected = slopes @ np.linalg.solve(covariance, slopes.T)
    root = np.sqrt(np.diag(expected))
    agree(got / np.outer(root, root), expected / np.outer(root, root), 1e-4, scale=1.0)


@pytest.mark.parametrize("goal", [None, "muscle.turns", "all"])
def test_plan_supports_lengths_set_by_ruler(by_ruler, goal):
    result = plan(by_ruler, read_capabilities(by_ruler, pressure="690 kPa"), goal, minutes=20.0)
    assert "length_error.each 1 mm" in str(result)
    assert result.as_dict()["assumed_sds"]["length_error.each"] == 1e-3
    assert not any("length_error" in name for name in result.expected_sds)


def test_ruler_of_a_rig_is_noise_per_sample(by_ruler):
    once, each = (read_capabilities(by_ruler, ruler=ruler) for ruler in (None, "0.1 mm"))
    assert (once.length_level_sd, once.length_sd) == (1e-3, 0.0)
    assert (each.length_level_sd, each.length_sd) == (0.0, pytest.approx(1e-4))


def test_recording_with_lengths_set_by_ruler_is_used(by_ruler):
    pressure, length = np.tile(np.linspace(1e5, 6e5, 20), 3), np.repeat([0.2357, 0.22, 0.2], 20)
    numbers = {n: m.value for n, m in collect_stated_values(by_ruler, "elastic").items()}
    error = np.repeat([1e-3, -1e-3, 5e-4], 20)
    got = predict(assemble("elastic", numbers), jnp.asarray(pressure), jnp.asarray(length + error))
    recording = Recording.from_arrays(
        pressure=pressure, length=length, force=np.asarray(got.force), diameter=np.asarray(got.diameter)
    )
    result = plan(Case("made", Path(), by_ruler, recording, ""), to="30 GPa", minutes=20.0)
    # The errors of the lengths explain the recording; without them it has a misfit.
    assert max(result.prior.misfit_ratios.values()) < 1.5
    assert result.expected_sds["thread.modulus"].current_sd < 20e9
    k = result.prior.muscle_indices[-1]
    information = result.prior.matrix
    assert np.all(np.linalg.eigvalsh(information) > 0)
    assert information[k, k] > 0


def test_information_of_readings_and_repeats_is_additive(muscle_toml):
    known = build_prior_information(muscle_toml, RigCapabilities(max_pressure=690e3))
    offered = list_runs(known.capabilities, 0.2357)
    each = known.compute_run_information(offered, known.mean)
    vent = next(k for k, run in enumerate(offered) if "vented" in run.description)
    k = known.find_index("force_offset.offset")
    agree(each[vent, k, k], (known.scale[k] / offered[vent].direct_sds["force_offset.offset"]) ** 2, 1e-12)
    assert np.count_nonzero(each[vent]) == 2
    assert np.all(np.linalg.eigvalsh(each) > -1e-6 * np.abs(each).max())


def test_information_is_proportional_to_the_sampling_rate(muscle_toml):
    means = RigCapabilities(max_pressure=690e3)
    slow, fast = (build_prior_information(muscle_toml, replace(means, rate=rate)) for rate in (1.0, 50.0))
    run_information = [
        prior.compute_run_information(list_runs(prior.capabilities, 0.2357)[:6], prior.mean)
        for prior in (slow, fast)
    ]
    root = np.sqrt(np.einsum("rii->ri", run_information[0]) + 1e-300)
    unit = root[:, :, None] * root[:, None, :]
    # Only two hundred of 7,000 samples are evaluated: the path between them is linear.
    agree(run_information[1] / 50 / unit, run_information[0] / unit, 5e-3, scale=1.0)


def test_diameter_determines_the_thread_modulus_and_force_does_not(muscle_toml):
    result = plan(muscle_toml, read_capabilities(muscle_toml, pressure="690 kPa", minutes=60))
    assert result.goal == "thread.modulus"
    assert result.reaches_goal
    assert result.minutes < 30
    force, diameter = result.single_channel["force"], result.single_channel["diameter"]
    assert diameter[0] <= result.target_sd
    assert force[1] > 1.5 * diameter[1]
    assert result.usual_sd > result.sd
    note = str(result)
    assert "force alone" in note
    assert "thread.modulus to ±" in note
    assert len(result.schedule()) == result.rows


def test_sensor_offsets_stay_uncertain_without_their_channel(muscle_toml):
    force, diameter = np.array([900.0, 400.0]), np.array([0.0225, 0.0262])
    recording = Recording.from_arrays(
        pressure=np.array([4e5, 5e5]), length=np.array([0.2357, 0.21]), force=force, diameter=diameter
    )
    case = Case("made", Path(), muscle_toml, recording, "")
    both, alone = (
        build_prior_information(muscle_toml, means, case=case)
        for means in (RigCapabilities(), RigCapabilities().keep_channel("force"))
    )
    assert both.space.names == alone.space.names
    agree(alone.matrix, both.matrix, ROUNDING, scale=1.0)


@pytest.fixture(scope="module")
def stroke(muscle_toml):
    """Return a noise-free stroke of the paper's muscle."""
    pressure, length = np.full(60, 5e5), np.linspace(0.2357, 0.2, 60)
    shown = predict(
        assemble("elastic", {n: m.value for n, m in collect_stated_values(muscle_toml, "elastic").items()}),
        jnp.asarray(pressure),
        jnp.asarray(length),
    )
    return pressure, length, np.asarray(shown.force), np.asarray(shown.diameter)


def recorded(muscle_toml, stroke, more):
    pressure, length, force, diameter = stroke
    recording = Recording.from_arrays(pressure=pressure, length=length, force=force + more, diameter=diameter)
    return Case("made", Path(), muscle_toml, recording, "")


@pytest.mark.slow
def test_misfit_of_a_recording_is_reported_and_counts_as_noise(muscle_toml, stroke):
    sure = replace(muscle_toml, sensors=Sensors(force=2.0, diameter=1e-4, pressure=700.0, length=2e-5))
    noise = 2.0 * np.random.default_rng(2).standard_normal(60)
    bent = 40.0 * np.sin(np.linspace(0, 4 * np.pi, 60))
    met, missed = (plan(recorded(sure, stroke, more), to="1 %") for more in (noise, noise + bent))
    assert "does not fit" not in str(met)
    first, promised = str(missed).partition("\n")[0], str(met).partition("\n")[0]
    assert "the model does not fit its recording (rms of residual over noise, row by row:" in first
    assert "`pamjax diagnose` first; if the model were correct" in first
    # A predicted value has its sd; one that depends on a wrong muscle has one digit.
    assert " ± " in promised
    assert " ± " not in first
    assert "to about " in first
    assert format_headline(missed) == "Diagnose first: the model does not fit its recording"
    assert not any(" ± " in words for words in format_answer(missed))
    assert missed.prior.misfit_ratios["force"] > 5 > 1.5 > met.prior.misfit_ratios["force"]
    k = met.prior.find_index("force_offset.offset")
    learned = [result.prior.matrix[k, k] - 1 for result in (met, missed)]
    assert 0 < learned[1] < 1.05 * learned[0] / missed.prior.misfit_ratios["force"] ** 2
    # The next runs have the same misfit.
    run = list_runs(met.prior.capabilities, 0.2357)[:1]
    run_information = [
        result.prior.compute_run_information(run, met.prior.mean)[0] for result in (met, missed)
    ]
    again = missed.prior.misfit_ratios["force"] / max(met.prior.misfit_ratios["force"], 1.0)
    agree(run_information[0][k, k], run_information[1][k, k] * again**2, SOLVED)


def test_plan_stays_below_the_recorded_or_stated_pressure(muscle_toml, stroke, tmp_path):
    case = recorded(muscle_toml, stroke, 0.0)
    assert plan(case, minutes=10.0).schedule()["pressure [kPa]"].max() <= 500 + 1e-6
    (tmp_path / "rig.toml").write_text('[rig]\npressure = "6 bar"\n')
    assert plan(case, tmp_path / "rig.toml", minutes=10.0).prior.capabilities.max_pressure == pytest.approx(
        6e5
    )


@pytest.mark.parametrize("minutes", [2.5, 19.0])
def test_minutes_are_formatted_consistently(muscle_toml, minutes):
    """2.5 minutes must not be 2 in one line and 2.5 in the next."""
    result = plan(muscle_toml, RigCapabilities(), to="30 GPa")
    ramp = next(run for run in list_runs(result.prior.capabilities, 0.2357) if "ramp" in run.description)
    alone = {"force": (5e9, minutes)}
    run_plan = replace(
        result, chosen_runs=((1, replace(ramp, minutes=minutes)),), minutes=minutes, single_channel=alone
    )
    course = PrecisionCourse("thread.modulus", "GPa", np.array([0.0, minutes]), np.array([20.0, 5.0]))
    figure = plot_precision(run_plan, course)
    for text in (
        str(run_plan),
        format_headline(run_plan),
        format_answer(run_plan)[0],
        figure.axes[0].get_title("left"),
    ):
        assert f"{minutes:g} min" in text
        assert not set(re.findall(r"([\d.]+) min\b", text)) - {f"{minutes:g}"}


def test_title_of_a_plan_fits_a_narrow_screen(muscle_toml, stroke):
    result = plan(recorded(muscle_toml, stroke, 40.0 * np.sin(np.linspace(0, 4 * np.pi, 60))), to="30 GPa")
    wrong = replace(result, prior=replace(result.prior, misfit_ratios={"force": 9.0}))
    course = PrecisionCourse("thread.modulus", "GPa", np.array([0.0, 2.5]), np.array([20.0, 5.0]))
    figure = plot_precision(wrong, course, narrow=True)
    figure.draw_without_rendering()
    title = figure.axes[0]._left_title
    assert " ".join(title.get_text().split()).endswith("if the model were correct")
    assert title.get_window_extent().x1 <= figure.bbox.x1


def test_better_isobars_are_reported(muscle_toml):
    result = plan(muscle_toml, RigCapabilities(), to="30 GPa")
    after = result.expected_sds["thread.modulus"].expected_sd
    better, worse = (format_usual_protocol(replace(result, usual_sd=share * after)) for share in (0.9, 1.1))
    assert "better than this plan (± 20 GPa); of complete runs, this plan is the shortest found" in better
    assert "times the sd" not in better
    assert worse.endswith("to ± 22 GPa, 1.1 times the sd of this plan")


def test_known_parameter_needs_no_run(muscle_toml):
    result = plan(muscle_toml, RigCapabilities(), to="30 GPa")
    assert (result.chosen_runs, result.minutes, result.rows) == ((), 0.0, 0)
    assert "no measurement is needed: thread.modulus is already determined to ± 20 GPa" in str(result)
    assert len(result.schedule()) == 0
    minutes, sds = compute_sd_course(result, "thread.modulus")
    agree(minutes, [0.0], ROUNDING)
    agree(sds, [result.expected_sds["thread.modulus"].current_sd], ROUNDING)
    assert "already" in format_headline(result)
    assert plot_precision(result, PrecisionCourse.from_plan(result)).axes
    assert plot_commands(result) is None


def test_muscle_toml_path_is_accepted(muscle_toml, tmp_path):
    wanted = {"goal": "thread.modulus", "minutes": 30.0}
    expected = plan(muscle_toml, **wanted).as_dict()
    for place in (KEVLAR, str(KEVLAR)):
        assert plan(place, **wanted).as_dict() == expected
    # If the folder has a recording, its information is included.
    assert plan(KEVLAR.parent, **wanted).as_dict() != expected
    with pytest.raises(BadInput, match=r"muscle\.toml"):
        plan(tmp_path, **wanted)
    with pytest.raises(BadInput, match="a muscle must be a case"):
        plan(3, **wanted)  # pyright: ignore[reportArgumentType]


def test_channels_of_a_rig_are_recorded_or_stated(muscle_toml):
    silent, both = replace(muscle_toml, sensors=Sensors()), ("force", "diameter")
    assert read_capabilities(silent).channels == both
    assert read_capabilities(silent, recorded_channels=("force",)).channels == ("force",)
    assert read_capabilities(silent, recorded_channels=("force",), diameter="0.1 mm").channels == both
    assert (
        read_capabilities(
            replace(muscle_toml, sensors=Sensors(diameter=1e-4)), recorded_channels=("force",)
        ).channels
        == both
    )


def test_rig_is_read_and_an_invalid_one_is_refused(muscle_toml, tmp_path):
    file = tmp_path / "rig.toml"
    file.write_text('[rig]\npressure = "100 psi"\nforce = "none"\nforce_zero = "1 lbf"\ngive = "0.1 mm/kN"\n')
    means = read_capabilities(muscle_toml, file)
    assert means.max_pressure == pytest.approx(689_476, rel=1e-5)
    assert means.channels == ("diameter",)
    assert means.error_sds["rig_compliance.compliance"] == pytest.approx(1e-7)
    file.write_text('[rig]\ncontraction = "15 %"\nminutes = "0.5 h"\n')
    means = read_capabilities(muscle_toml, file)
    assert (means.max_contraction, means.minutes) == (pytest.approx(0.15), pytest.approx(30.0))
    file.write_text('[rig]\npresure = "1 bar"\n')
    with pytest.raises(BadInput, match="Did you mean `pressure`"):
        read_capabilities(muscle_toml, file)
    with pytest.raises(BadInput, match=r"no free parameter of this muscle.*thread\.modulus"):
        plan(muscle_toml, RigCapabilities(), "thread.modulu")


def test_wrong_goal_is_refused_before_the_recording_is_used(monkeypatch):
    def compute_information(*_):
        raise AssertionError("the information of a recording takes seconds")

    monkeypatch.setattr("pamjax.planning.plan.build_prior_information", compute_information)
    with pytest.raises(BadInput, match=r"'muscle\.rest_length' is no free parameter of this muscle"):
        plan(made("elastic"), goal="muscle.rest_length")
    with pytest.raises(AssertionError, match="takes seconds"):
        plan(made("elastic"), goal="thread.modulus")


def test_minutes_of_a_plan_replace_those_of_the_rig(muscle_toml):
    long = plan(muscle_toml, RigCapabilities(minutes=30.0), "all")
    short = plan(muscle_toml, RigCapabilities(minutes=30.0), "all", minutes=6.0)
    assert short.minutes <= 6.0 < long.minutes
    with pytest.raises(BadInput, match="the shortest run of this rig takes"):
        plan(muscle_toml, RigCapabilities(), minutes=-1.0)


@pytest.mark.slow
def test_predicted_sd_is_reached_for_a_few_muscles():
    trials = [trial(seed, 40.0) for seed in range(8)]
    fitted = np.array([p.sd / result.sd for result, p, _ in trials])
    errors = np.array([(p.value - p.true) / result.sd for result, p, _ in trials])
    assert 0.85 < rms(fitted) < 1.15
    # The mean of eight squared normals is within these limits in 999 of 1,000 cases.
    assert 0.33 < rms(errors) < 1.8
    assert "8 muscles" in report(trials)

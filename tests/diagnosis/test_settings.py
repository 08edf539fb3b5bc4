"""Check the settings of a diagnosis: their limits, their descriptions, and that each step uses them."""

import ast
import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pamjax
from pamjax.diagnosis.crossval.block_cross_validation import _compute_explained_fraction
from pamjax.diagnosis.crossval.held_out_errors import build_held_out_mask
from pamjax.diagnosis.detect.locate import _find_motion
from pamjax.diagnosis.detect.recording_axes import RecordingAxes
from pamjax.diagnosis.detect.residual_test import is_residual_large, is_residual_significant
from pamjax.diagnosis.detect.significance import ResidualTest
from pamjax.diagnosis.detect.tested_subsets import split_into_subsets
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_parameters import _compute_limits
from pamjax.diagnosis.next_experiment.experiment import Experiment, choose_experiment
from pamjax.diagnosis.refit.least_squares import find_parameters_at_limit
from pamjax.diagnosis.select.rivals import NamedMechanism
from pamjax.diagnosis.select.search import MechanismSearch
from pamjax.diagnosis.select.selection import shrink_to_even_odds
from pamjax.diagnosis.settings import DEFAULT_SETTINGS, DiagnosisSettings, describe_settings
from pamjax.errors import BadInput
from pamjax.infer.noise.estimate import _build_channel_noise, _ChannelSamples
from pamjax.parameter import Meaning
from pamjax.progress import ignore_progress
from pamjax.records.blocks import Blocks
from pamjax.records.simulate import draw_ar1_noise
from tests.diagnosis.bank import build_plan_problem
from tests.diagnosis.plain_fits import build_estimate, build_fit
from tests.view import made_up

NAMES = [setting.name for setting in dataclasses.fields(DiagnosisSettings)]

#: The thresholds on which the results in docs/validation.md depend.
DEFAULTS = {
    "max_noise_correlation": 0.98, "min_correlation_se": 2.0, "sensor_variance_sd_share": 0.1,
    "max_noise_ratio": math.exp(0.75),
    "min_samples_for_correlation": 30, "min_near_step_share": 0.9, "max_input_noise_chi2_share": 0.1,
    "max_prior_deviation_sd": 3.0, "max_stiffness_factor": 5.0, "min_presliding_noise_ratio": 10.0,
    "fitted_size_sd_share": 0.1, "slip_time_count": 24, "min_speed_ratio_for_power": 1.5,
    "max_stated_chi2": 12.0, "max_search_rows": 2000, "max_refit_evaluations": 40,
    "start_limit_distance_share": 0.15,
    "at_limit_range_share": 1e-3, "min_input_noise_chi2_share": 0.02, "max_correction_steps": 6,
    "min_correction_decrease": 1.0,
    "min_misfit_mean_square": 1.5, "misfit_weighting_rounds": 2, "correlation_sweeps": 2,
    "min_correlation_change": 0.005, "detection_p_value": 0.01, "mean_square_level_share": 0.05,
    "significance_draws": 10000, "min_unexplained_rms": 0.3, "min_unexplained_rms_share": 0.15,
    "ranges_per_axis": 5, "time_ranges": 20, "min_samples_in_subset": 12, "min_speed_share": 0.05,
    "min_speed_noise_sd": 4.5, "false_inclusion_probability": 1e-4, "min_excess_share": 0.2,
    "min_rms_share": 0.1, "complete_excess_share": 0.95, "min_small_rms_share": 0.025,
    "min_effect_rms": 0.25, "min_direction_chi2_share": 0.5, "max_form_share": 0.3, "shortlist_length": 6,
    "final_refit_count": 2, "rough_evaluations": 10, "strained_prior_sd": 2.5, "max_mechanisms": 4,
    "tie_chi2": 12.0, "tie_excess_share": 0.1, "rivals_refitted": 5, "comparison_excess_chi2": 8.0,
    "rough_chi2_margin": 36.0, "unknown_rival_weight": 0.1, "established_probability": 0.5,
    "pairs_refitted": 3, "pair_swap_rounds": 2,
    "max_noise_chi2_sd": 2.0, "same_pair_chi2_share": 1e-3, "min_joint_excess_share": 2 / 3,
    "min_single_excess_share": 0.1, "false_addition_probability": 0.01, "min_prior_p_value": 0.01,
    "min_extreme_amplitude_share": 0.25, "max_starting_candidates": 9, "alternative_fit_evaluations": 10,
    "max_alternative_chi2": 20.0, "min_chi2_improvement": 0.5, "distance_chi2_tolerance": 4.0,
    "min_explained_fraction": 5 / 6,
    "min_blocks_for_cross_validation": 3, "min_information_share": 0.05,
    "doubtful_certainty_share": 0.5, "max_held_out_error_ratio": 3.0,
    "held_out_interval": 5, "min_blocks_for_hold_out": 3,
    "region_low_quantile": 0.05, "region_high_quantile": 0.95, "min_direction_share": 0.15,
    "min_moving_misfit_share": 0.5, "min_region_rms_ratio": 0.5, "min_region_chi2": 4.0,
    "min_channel_excess_share": 0.2,
    "min_reported_noise_ratio": 1.15, "min_stuck_readings": 3, "min_clipped_readings": 5,
    "max_regions": 5, "smoothing_rows": 7, "min_one_sided_ratio": 0.4, "min_trend_correlation": 0.9,
    "trend_end_share": 0.1, "ranges_per_region": 5, "min_part_share": 0.02, "min_part_distance_share": 0.2,
    "min_likeness": 0.05, "min_likeness_excess_share": 0.5,
    "false_alarm_rate": 0.05, "sufficient_power": 0.9, "power_draws": 4000,
    "rival_candidates_refitted": 3, "max_rivals_per_mechanism": 2, "max_rival_pairs": 4,
}  # fmt: skip


def test_the_defaults_are_those_of_the_validation():
    assert dataclasses.asdict(DEFAULT_SETTINGS) == DEFAULTS


def test_every_setting_has_a_description():
    settings = list(describe_settings())
    assert [setting.name for setting in settings] == NAMES
    for setting in settings:
        assert all((setting.unit, setting.meaning, setting.larger))
        assert setting.name in (DiagnosisSettings.__doc__ or "")
    assert {setting.group for setting in settings} == {
        "noise", "library", "refit", "detect", "select", "crossval", "report", "next experiment",
    }  # fmt: skip


def test_every_setting_is_used():
    """A setting without a reader in the package would promise an effect that it does not have."""
    home = Path(pamjax.__file__).parent
    read = {
        node.attr
        for folder in ("diagnosis", "infer/noise")
        for path in (home / folder).rglob("*.py")
        if path.name != "settings.py"
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Attribute)
    }
    assert sorted(set(NAMES) - read) == []


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        (
            "detection_p_value",
            2.0,
            "`detection_p_value` of DiagnosisSettings must be a number between 1e-300 and 1; got 2.0.",
        ),
        (
            "max_mechanisms",
            2.5,
            "`max_mechanisms` of DiagnosisSettings must be an integer between 0 and 20; got 2.5.",
        ),
        (
            "tie_chi2",
            "12",
            "`tie_chi2` of DiagnosisSettings must be a number between 0 and 1e+06; got '12'.",
        ),
        (
            "tie_chi2",
            float("nan"),
            "`tie_chi2` of DiagnosisSettings must be a number between 0 and 1e+06; got nan.",
        ),
    ],
)
def test_a_bad_value_is_refused_in_one_sentence(name, value, message):
    with pytest.raises(BadInput) as error:
        DiagnosisSettings(**{name: value})
    assert str(error.value) == message


def test_settings_are_public_and_frozen():
    assert pamjax.DiagnosisSettings is DiagnosisSettings
    with pytest.raises(dataclasses.FrozenInstanceError):
        DEFAULT_SETTINGS.tie_chi2 = 1.0  # type: ignore[misc]


def estimate_correlation(settings):
    residual = draw_ar1_noise(np.random.default_rng(1), 2000, 0.6)
    samples = _ChannelSamples(residual, np.arange(2000), np.zeros(2000), np.zeros(2000))
    noise = _build_channel_noise(samples, np.array([1.0]), settings=settings)
    return round(noise.correlation, 1)


def compute_upper_limit(settings):
    inputs = np.array([1.0]), np.array([0.1]), np.array([True])
    meaning = Meaning("1", "1", 0.0, 9.0, "linear", "turns", "test")
    _, high = _compute_limits(["muscle.turns"], [meaning], *inputs, settings)
    return float(high[0])


def build_problem(settings):
    return dataclasses.replace(build_plan_problem(), settings=settings)


def count_parameters_at_limit(settings):
    problem = build_problem(settings)
    k = problem.index("force_gain.gain")
    values = problem.neutral.copy()
    values[k] = problem.high[k] - 0.01 * (problem.high[k] - problem.low[k])
    return find_parameters_at_limit(problem, build_estimate(values, [k])).size


FAINT = ResidualTest(p_value=0.005, largest_deviation=4.0, direction_count=100, mean_square=1.2)


def build_search(settings, baseline):
    return MechanismSearch(build_problem(settings), np.ones(1, bool), baseline, (), ignore_progress)


def is_worthwhile(settings):
    """A mechanism that explains a half of a misfit of one standard deviation."""
    baseline = build_fit(n=1000, chi2=2000.0)
    extended = build_fit(n=1000, chi2=1500.0, mechanisms=(Candidate("force_gain", ("force_gain.gain",)),))
    return build_search(settings, baseline).is_worthwhile(baseline, extended, may_be_small=False)


def is_pair_worthwhile(settings):
    """A pair that leaves 3 % of the excess χ² of the baseline."""
    baseline = build_fit(n=1000, chi2=2000.0)
    return build_search(settings, baseline).is_complete(build_fit(n=1000, chi2=1030.0), baseline)


def reduce_probability(settings):
    names = NamedMechanism("end_taper", 0.9, (), 1.0), NamedMechanism("end_cones", 0.9, (), 1.0)
    probabilities = {m.id: m.probability for m in shrink_to_even_odds(names, settings, {"end_taper"})}
    assert probabilities["end_cones"] == 0.9
    return round(probabilities["end_taper"], 3)


def count_held_out(settings):
    blocks = Blocks(np.arange(12), tuple("abcdefghijkl"), "isobars")
    return int(build_held_out_mask(blocks, settings).sum())


def count_subsets(settings):
    axes = RecordingAxes(np.linspace(0, 1, 50), np.zeros(50), np.arange(50.0), np.zeros(50, int))
    return len(split_into_subsets(axes, settings))


OFFER = [Experiment("short", ("a", "b"), 0.8, 5.0), Experiment("long", ("a", "b"), 0.95, 60.0)]


@pytest.mark.parametrize(
    ("step", "changes", "before", "after"),
    [
        (estimate_correlation, {"max_noise_correlation": 0.3}, 0.6, 0.3),
        (estimate_correlation, {"min_samples_for_correlation": 5000}, 0.6, 0.0),
        (compute_upper_limit, {"max_prior_deviation_sd": 1.0}, 1.3, 1.1),
        (count_parameters_at_limit, {"at_limit_range_share": 0.02}, 0, 1),
        (count_subsets, {"time_ranges": 10}, 5 + 1 + 20 + 5, 5 + 1 + 10 + 5),
        (lambda s: is_residual_large(FAINT, FAINT, s), {"min_unexplained_rms": 0.5}, True, False),
        (lambda s: is_residual_significant(FAINT, FAINT, s), {"detection_p_value": 1e-3}, True, False),
        (is_worthwhile, {"min_excess_share": 0.6}, True, False),
        (is_worthwhile, {"min_effect_rms": 0.8}, True, False),
        (is_pair_worthwhile, {"complete_excess_share": 0.99}, True, False),
        (reduce_probability, {"doubtful_certainty_share": 1.0}, 0.7, 0.9),
        (count_held_out, {"held_out_interval": 3}, 2, 3),
        (
            lambda s: _compute_explained_fraction(5.0, 10.0, 100.0, s.min_information_share),
            {"min_information_share": 0.2},
            0.5,
            1.0,
        ),
        (
            lambda s: _find_motion(s, np.array([-1, 1]), np.array([0.2, 1.0])),
            {"min_direction_share": 0.3},
            "both",
            "lengthening",
        ),
        (lambda s: choose_experiment(OFFER, s).protocol, {"sufficient_power": 0.75}, "long", "short"),
    ],
)
def test_a_changed_setting_changes_its_step(step, changes, before, after):
    assert step(DEFAULT_SETTINGS) == before
    assert step(DiagnosisSettings(**changes)) == after


def test_a_result_keeps_its_settings_and_applies_them():
    diagnosis = made_up.diagnosis()
    assert diagnosis.settings is DEFAULT_SETTINGS
    problem: Any = diagnosis.problem
    problem.settings = DiagnosisSettings(detection_p_value=1e-50)
    assert not diagnosis.is_detected

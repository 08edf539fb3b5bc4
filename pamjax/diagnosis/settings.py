"""Settings of a diagnosis: every threshold that decides its outcome, with its meaning, unit and limits.

`pamjax.diagnose(case, settings=DiagnosisSettings(...))` uses other values. The report prints all of them.
Pure numerical constants (tolerances of a minimiser, nodes of an interpolation) stay in their modules.

Units: "χ²" is a difference of −2 ln likelihood. "BIC" is a difference of the Bayesian information criterion,
about twice the logarithm of the Bayes factor: 12 is odds of 400 to 1. "Excess χ²" is χ² minus its expected
value for noise alone. Names with "chi2" have either unit: both are on the scale of χ².
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, cast

from pamjax.errors import BadInput
from pamjax.infer.form_errors.shares import MAX_FORM_SHARE
from pamjax.infer.noise.noise_settings import NOISE_SETTINGS
from pamjax.infer.problem.prior_limits import (
    MAX_PRIOR_DEVIATION_SD,
    MAX_STIFFNESS_FACTOR,
    MIN_MISFIT_MEAN_SQUARE,
)


def _define(group: str, default: float, unit: str, low: float, high: float, meaning: str, larger: str) -> Any:
    """Return a field with its description.

    Args:
        group: step of the diagnosis.
        default: default value.
        unit: unit; "1" for a pure number, "count" for an integer.
        low, high: smallest and largest valid value.
        meaning: what the value decides, as a sentence without full stop that begins with a verb.
        larger: what a larger value does.
    """
    metadata = {
        "group": group,
        "unit": unit,
        "meaning": meaning,
        "larger": larger,
        "low": low,
        "high": high,
    }
    return field(default=default, metadata=metadata)


_noise = partial(_define, "noise")
_library = partial(_define, "library")
_refit = partial(_define, "refit")
_detect = partial(_define, "detect")
_select = partial(_define, "select")
_crossval = partial(_define, "crossval")
_report = partial(_define, "report")
_next = partial(_define, "next experiment")


@dataclass(frozen=True, kw_only=True)
class DiagnosisSettings:
    """All thresholds of a diagnosis, by step; a value outside its limits raises `BadInput`."""

    # fmt: off
    # Noise: estimated from differences of neighbouring samples.
    max_noise_correlation: float = _noise(NOISE_SETTINGS.max_noise_correlation, "1", 0.01, 0.9999,
        "Limit the correlation of neighbouring noise samples to this",
        "slower misfit can count as noise")
    min_correlation_se: float = _noise(NOISE_SETTINGS.min_correlation_se, "standard errors", 0.0, 100.0,
        "Treat noise samples as independent if their correlation is below this many standard errors",
        "fewer recordings get correlated noise")
    sensor_variance_sd_share: float = _noise(NOISE_SETTINGS.sensor_variance_sd_share,
        "share of the variance", 0.0, 1.0,
        "Assume this standard deviation of the stated noise variance of a sensor",
        "deviations are less significant")
    max_noise_ratio: float = _noise(math.exp(3 * 0.25), "1", 1.0, 1e3,
        "Use the noise of neighbouring samples up to this ratio to the stated sd (3 sd of a prior of 25 %)",
        "fast misfit can count as noise")
    min_samples_for_correlation: int = _noise(NOISE_SETTINGS.min_samples_for_correlation, "count", 4, 10**6,
        "Estimate the noise correlation of a channel if it has at least this many samples",
        "short recordings count as uncorrelated")
    min_near_step_share: float = _noise(NOISE_SETTINGS.min_near_step_share, "share of the steps", 0.0, 1.0,
        "Exclude larger steps as outliers if at least this share is within 3.5 robust sd",
        "large steps count as noise more often")
    max_input_noise_chi2_share: float = _noise(0.1, "χ² per sample", 0.0, 1.0,
        "Subtract at most this from the χ² of a model with memory, for noise of pressure and length",
        "favours models that amplify input noise")

    # Library: limits of the parameters, and the candidates.
    max_prior_deviation_sd: float = _library(MAX_PRIOR_DEVIATION_SD, "sd of the prior", 0.1, 100.0,
        "Limit the distance of a baseline parameter from its stated value to this",
        "the baseline absorbs more misfit")
    max_stiffness_factor: float = _library(MAX_STIFFNESS_FACTOR, "1", 1.01, 1e3,
        "Limit the ratio of fitted and stated thread stiffness to this, in both directions",
        "the threads absorb more misfit")
    min_presliding_noise_ratio: float = _library(10.0, "sd of the length noise", 0.0, 1e4,
        "Limit the presliding distance of friction to at least this",
        "friction responds less to length noise")
    fitted_size_sd_share: float = _library(0.1, "share of the size", 0.0001, 10.0,
        "Assume this prior sd of the bladder's inner diameter if none is stated",
        "the bladder's size is less certain")
    slip_time_count: int = _library(24, "count", 1, 1000,
        "Test a thread slip at this many times",
        "slips are located on a finer grid")
    min_speed_ratio_for_power: float = _library(1.5, "1", 1.0, 1e3,
        "Estimate the power of viscous damping if fast strokes are at least this much faster than slow ones",
        "fewer recordings estimate the power")
    max_stated_chi2: float = _library(12.0, "BIC", 0.0, 1e4,
        "Decrease the BIC of a mechanism with a stated value (thread compliance) by at most this",
        "favours mechanisms with stated values")

    max_search_rows: int = _library(2000, "count", 100, 10**9,
        "Search mechanisms in means of 3, 5, ... neighbouring rows of a recording with more rows than this",
        "slower; faster effects are identified")

    # Refit: least squares with priors.
    max_refit_evaluations: int = _refit(40, "count", 1, 10**5,
        "End a refit after this many evaluations",
        "refits are slower and more accurate")
    start_limit_distance_share: float = _refit(0.15, "share of the range", 0.0, 0.49,
        "Start a baseline parameter at least this far from its limits",
        "refits start nearer the middle of the range")
    at_limit_range_share: float = _refit(0.001, "share of the range", 0.0, 0.4,
        "Treat a parameter as at its limit if its distance to the limit is less than this",
        "more parameters count as at their limit")
    min_input_noise_chi2_share: float = _refit(0.02, "share of the χ²", 0.0, 1.0,
        "Correct the bias due to input noise if the χ² of the propagated noise exceeds this",
        "fewer fits are corrected")
    max_correction_steps: int = _refit(6, "count", 0, 1000,
        "Limit the Gauss–Newton steps of the correction for input noise to this",
        "the correction can go further")
    min_correction_decrease: float = _refit(1.0, "χ² with priors", 0.0, 1e4,
        "End the correction for input noise when a step decreases χ² by less than this",
        "the correction is faster and less complete")
    min_misfit_mean_square: float = _refit(MIN_MISFIT_MEAN_SQUARE, "noise variances", 1.0, 1e6,
        "Weight the samples for systematic misfit if their mean squared residual exceeds this",
        "fewer models are weighted")
    misfit_weighting_rounds: int = _refit(2, "count", 1, 100,
        "Refit this many times with the weight for systematic misfit",
        "the weight is more consistent with the misfit")
    correlation_sweeps: int = _refit(2, "count", 0, 100,
        "Refine the noise correlation of each channel this many times after the selection",
        "the correlations are more consistent")
    min_correlation_change: float = _refit(0.005, "1", 0.0, 1.0,
        "Refit the model if a noise correlation changes by more than this",
        "fewer refits")

    # Detect: the test of a residual against noise.
    detection_p_value: float = _detect(0.01, "1", 1e-300, 1.0,
        "Report a misfit as detected if its p-value is below this",
        "more detections and more false alarms")
    mean_square_level_share: float = _detect(0.05, "share of the level", 1e-6, 0.999,
        "Assign this part of the significance level to the mean square of the residual",
        "misfit without a tested pattern is detected more often, other misfit less often")
    significance_draws: int = _detect(10000, "count", 10, 10**8,
        "Compute a p-value from this many random draws",
        "p-values are slower and more accurate")
    min_unexplained_rms: float = _detect(0.3, "sd of the noise", 0.0, 1e3,
        "Report a residual as unexplained only if its rms exceeds this",
        "less is reported as unexplained")
    min_unexplained_rms_share: float = _detect(0.15, "share of the baseline's rms", 0.0, 1.0,
        "Report a residual as unexplained only if its rms also exceeds this",
        "less is reported as unexplained")
    ranges_per_axis: int = _detect(5, "count", 2, 100,
        "Test a shift of the mean in this many ranges of pressure and of contraction",
        "smaller subsets are tested; each needs a larger deviation")
    time_ranges: int = _detect(20, "count", 2, 1000,
        "Test a shift of the mean in this many intervals of time",
        "shorter events are detected; each needs a larger deviation")
    min_samples_in_subset: int = _detect(12, "count", 1, 10**6,
        "Test a subset of the rows if it has at least this many samples",
        "small subsets are not tested")
    min_speed_share: float = _detect(0.05, "share of the 95 % quantile of speed", 0.0, 1.0,
        "Treat the muscle as moving only if its speed exceeds this",
        "more samples count as at rest")
    min_speed_noise_sd: float = _detect(4.5, "sd of the rate noise", 0.0, 1e3,
        "Treat the muscle as moving only if its speed also exceeds this",
        "more samples count as at rest")

    # Select: the choice of mechanisms.
    false_inclusion_probability: float = _select(0.0001, "1", 1e-300, 1.0,
        "Limit the probability that noise alone adds a mechanism, over all candidates, to this",
        "weaker mechanisms are identified, and more false ones")
    min_excess_share: float = _select(0.2, "share of the excess χ²", 0.0, 1.0,
        "Add a mechanism only if it explains more than this share of the misfit that remains without it",
        "fewer mechanisms are identified")
    min_rms_share: float = _select(0.1, "share of the baseline's rms", 0.0, 1.0,
        "Add a mechanism only if its own rms exceeds this, or if it makes the explanation complete",
        "more small effects next to a large one are dropped")
    complete_excess_share: float = _select(0.95, "share of the excess χ²", 0.0, 1.0,
        "Treat an explanation as complete, so that effects in it can be small, if it explains more than this",
        "fewer small effects are identified")
    min_small_rms_share: float = _select(0.025, "share of the baseline's rms", 0.0, 1.0,
        "Add a small effect to a complete explanation only if its rms exceeds this",
        "small effects are dropped")
    min_effect_rms: float = _select(0.25, "sd of the noise", 0.0, 1e3,
        "Add an effect only if its rms exceeds this; a smaller residual ends the search",
        "faint effects are not identified")
    min_direction_chi2_share: float = _select(0.5, "share of the χ² of the smallest effect", 0.0, 1.0,
        "Permit the end of the search if the best candidate reduces χ² by less than this",
        "the search ends earlier")
    max_form_share: float = _select(MAX_FORM_SHARE, "share of the effect", 0.0, 1.0,
        "Allow for a difference of at most this (rms) between an effect and its textbook equation",
        "fewer mechanisms are added to another one")
    shortlist_length: int = _select(6, "count", 1, 100,
        "Refit this many mechanisms roughly at each step",
        "slower; fewer mechanisms are missed")
    final_refit_count: int = _select(2, "count", 1, 100,
        "Continue this many rough refits to the minimum",
        "slower; fewer mechanisms are missed")
    rough_evaluations: int = _select(10, "count", 1, 1000,
        "End a rough refit after this many evaluations",
        "slower; the best mechanisms are selected more reliably")
    strained_prior_sd: float = _select(2.5, "sd of the prior", 0.0, 100.0,
        "Start a second refit at the stated values if a parameter is farther than this from its stated value",
        "fewer second starts")
    max_mechanisms: int = _select(4, "count", 0, 20,
        "Limit the number of mechanisms in a model to this",
        "more mechanisms can be identified")
    tie_chi2: float = _select(12.0, "BIC", 0.0, 1e6,
        "Treat two models as indistinguishable if their BIC differs by less than this",
        "more mechanisms count as indistinguishable")
    tie_excess_share: float = _select(0.1, "share of the excess χ²", 0.0, 10.0,
        "Increase the limit `tie_chi2` by this for a model with misfit",
        "more mechanisms count as indistinguishable")
    rivals_refitted: int = _select(5, "count", 1, 100,
        "Refit this many rivals for each identified mechanism",
        "slower; more rivals are compared")
    comparison_excess_chi2: float = _select(8.0, "excess χ²", 1e-6, 1e9,
        "Halve the BIC differences in the comparison of rivals for a model with this excess χ²",
        "probabilities are closer to 0 and 1")
    rough_chi2_margin: float = _select(36.0, "BIC", 0.0, 1e6,
        "Refit a rival to the minimum if its rough refit increases the BIC by less than this",
        "slower; more rivals are refitted")
    unknown_rival_weight: float = _select(0.1, "weight", 0.0, 10.0,
        "Count physics outside the library as one more rival of each mechanism, with this weight",
        "probabilities are smaller")
    established_probability: float = _select(0.5, "1", 0.0, 1.0,
        "Name a mechanism if its probability is at least this",
        "fewer mechanisms are reported")
    pairs_refitted: int = _select(3, "count", 1, 100,
        "Refit this many pairs for each replacement",
        "slower; fewer mechanisms are missed")
    pair_swap_rounds: int = _select(2, "count", 0, 100,
        "Replace mechanisms by pairs in at most this many rounds",
        "slower; fewer mechanisms are missed")
    max_noise_chi2_sd: float = _select(2.0, "sd of the χ² of noise", 0.0, 100.0,
        "Treat an excess χ² below this as noise (also in cross-validation and with a template)",
        "more models count as complete")
    same_pair_chi2_share: float = _select(0.001, "share of the BIC reduction", 0.0, 1.0,
        "Treat two pairs with one common mechanism as the same if they differ by less than this",
        "fewer similar pairs are refitted")
    min_joint_excess_share: float = _select(2 / 3, "share of the excess χ²", 0.0, 1.0,
        "Add small effects only if together they explain more than this share of the misfit",
        "fewer small effects are identified")
    min_single_excess_share: float = _select(0.1, "share of the excess χ²", 0.0, 1.0,
        "Add small effects only if each explains more than this share of the misfit",
        "fewer small effects are identified")
    false_addition_probability: float = _select(0.01, "1", 1e-300, 1.0,
        "Limit the probability that misfit adds a small or masked effect, over the candidates, to this",
        "weaker small effects are identified, and more false ones")
    min_prior_p_value: float = _select(0.01, "1", 0.0, 1.0,
        "Drop small effects if the p-value of the baseline parameters under their priors is below this",
        "fewer small effects are identified")
    min_extreme_amplitude_share: float = _select(0.25, "share of the range", 0.0, 1.0,
        "Drop a small effect if its amplitude is at its limit and exceeds this",
        "fewer small effects are dropped")
    max_starting_candidates: int = _select(9, "count", 1, 1000,
        "Start a refit from each candidate of a mechanism if it has at most this many",
        "slower; mechanisms with many candidates are included")
    alternative_fit_evaluations: int = _select(10, "count", 1, 1000,
        "End a refit from another candidate, or with a rival, after this many evaluations",
        "slower; the minima are more accurate")
    max_alternative_chi2: float = _select(20.0, "χ² with priors", 0.0, 1e6,
        "Include another minimum in the standard deviations if it increases χ² by less than this",
        "slower; standard deviations include more minima")
    min_chi2_improvement: float = _select(0.5, "χ² with priors", 0.0, 1e6,
        "Replace the estimate by another minimum if it decreases χ² by more than this",
        "the first minimum is kept more often")
    distance_chi2_tolerance: float = _select(4.0, "χ² with priors", 0.0, 1e6,
        "Treat a fit as another minimum if its squared distance in sd of the estimate exceeds this",
        "fewer minima contribute to the standard deviations")

    # Cross-validation on whole blocks.
    min_explained_fraction: float = _crossval(5 / 6, "share of the excess χ²", 0.0, 1.0,
        "Report a part as unexplained if the mechanisms explain less than this share of left-out misfit",
        "an unexplained part is reported more often")
    min_blocks_for_cross_validation: int = _crossval(3, "count", 2, 1000,
        "Cross-validate mechanisms if the recording has at least this many blocks",
        "fewer recordings are cross-validated")
    min_information_share: float = _crossval(0.05, "share of the information", 0.0, 1.0,
        "Test a parameter on a block if the other blocks have more than this share of its information",
        "more blocks are skipped")
    doubtful_certainty_share: float = _crossval(0.5, "share of the certainty", 0.0, 1.0,
        "Reduce the certainty of masked effects, or of all if misfit is unexplained, to this share",
        "higher probabilities in these cases")
    max_held_out_error_ratio: float = _crossval(3.0, "expected rms error", 1.0, 1e6,
        "Report an unexplained part if the error on held-out blocks is larger than this",
        "fewer reports of unexplained misfit")
    held_out_interval: int = _crossval(5, "count", 2, 1000,
        "Hold out one block in this many",
        "fewer blocks are held out")
    min_blocks_for_hold_out: int = _crossval(3, "count", 3, 1000,
        "Hold out a block if the recording has at least this many blocks",
        "fewer recordings hold out a block")

    # Report: the regions of a misfit.
    region_low_quantile: float = _report(0.05, "share of the squared misfit", 0.0, 0.5,
        "Begin a region at this quantile of the misfit on each axis",
        "smaller regions")
    region_high_quantile: float = _report(0.95, "share of the squared misfit", 0.5, 1.0,
        "End a region at this quantile of the misfit on each axis",
        "larger regions")
    min_direction_share: float = _report(0.15, "share of the squared misfit", 0.0, 0.5,
        "Include a direction of motion in a region if at least this share of its misfit has that direction",
        "more regions have one direction")
    min_moving_misfit_share: float = _report(0.5, "share of the squared misfit", 0.0, 1.0,
        "Give a region one direction only if at least this share of its misfit occurs during motion",
        "fewer regions have one direction")
    min_region_rms_ratio: float = _report(0.5, "share of the largest channel's rms", 0.0, 1.0,
        "Report a region of an effect on a channel if its rms there is at least this",
        "fewer regions")
    min_region_chi2: float = _report(4.0, "χ² of the effect", 0.0, 1e6,
        "Report a region of an effect that the baseline does not absorb if its χ² is at least this",
        "fewer regions")
    min_channel_excess_share: float = _report(0.2, "share of the largest channel's excess", 0.0, 1.0,
        "Report a region of the unexplained misfit of a channel if that misfit is at least this",
        "fewer regions")
    min_reported_noise_ratio: float = _report(1.15, "1", 1.0, 1e3,
        "Report the noise of a sensor if its ratio to the stated noise, or the inverse, exceeds this",
        "fewer notes on sensors")
    max_regions: int = _report(5, "count", 0, 5,
        "Limit the number of regions to this",
        "more regions")
    smoothing_rows: int = _report(7, "count", 1, 10000,
        "Average squared residuals over this many rows",
        "regions are smoother")
    min_one_sided_ratio: float = _report(0.4, "ratio of mean to rms", 0.0, 1.0,
        "Report one sign of a deviation if its mean is at least this",
        "fewer sentences state one sign")
    min_trend_correlation: float = _report(0.9, "1", 0.0, 1.0,
        "Report a trend if a deviation has at least this correlation with pressure or contraction",
        "fewer sentences state a trend")
    trend_end_share: float = _report(0.1, "share of the samples", 0.001, 0.5,
        "Average this share of the samples at each end of a trend",
        "the ends are averaged over more samples")
    ranges_per_region: int = _report(5, "count", 2, 100,
        "Require a sentence to be true in each of this many ranges of pressure and of contraction",
        "sentences must be true in smaller parts")
    min_part_share: float = _report(0.02, "share of a region's rows", 0.0, 1.0,
        "Require a sentence to be true in a part of a region if the part has at least this share of its rows",
        "sentences need not be true in small parts")
    min_part_distance_share: float = _report(0.2, "share of a region's range", 0.0, 1.0,
        "State the places of two parts in a sentence if they are farther apart than this",
        "fewer sentences state places")

    min_stuck_readings: int = _report(3, "count", 2, 10**6,
        "Compare with a stuck length or force channel if it repeats a reading this often",
        "short stops of the channel are not recognised")
    min_clipped_readings: int = _report(5, "count", 2, 10**6,
        "Compare with a clipped load cell if this many readings are equal to the largest one",
        "fewer recordings are compared with clipping")
    min_likeness: float = _report(0.05, "1", 0.0, 1.0,
        "Describe an unexplained part by an effect outside the library if its probability is at least this",
        "fewer descriptions")
    min_likeness_excess_share: float = _report(0.5, "share of the excess χ²", 0.0, 1.0,
        "Describe an unexplained part by an effect that explains at least this share of this part",
        "fewer descriptions")

    # Next experiment.
    false_alarm_rate: float = _next(0.05, "1", 0.001, 0.5,
        "Accept this probability that a protocol rejects the true one of two mechanisms",
        "higher power at more false alarms")
    sufficient_power: float = _next(0.9, "1", 0.0, 1.0,
        "Propose the shortest protocol with at least this power",
        "longer protocols")
    power_draws: int = _next(4000, "count", 10, 10**7,
        "Compute a power from this many simulated protocols",
        "slower; the power is more accurate")
    rival_candidates_refitted: int = _next(3, "count", 1, 100,
        "Refit this many candidates of a rival",
        "slower; better fits of rivals")
    max_rivals_per_mechanism: int = _next(2, "count", 0, 100,
        "Propose protocols for at most this many rivals of a mechanism",
        "more protocols")
    max_rival_pairs: int = _next(4, "count", 0, 100,
        "Propose protocols for at most this many pairs",
        "more protocols")
    # fmt: on

    def __post_init__(self) -> None:
        for setting in dataclasses.fields(self):
            _check_value(setting, getattr(self, setting.name))


def _check_value(setting: dataclasses.Field, value: Any) -> None:
    """Refuse a value of the wrong type or outside the limits of its setting."""
    low, high = setting.metadata["low"], setting.metadata["high"]
    is_count = setting.metadata["unit"] == "count"
    kind = "an integer" if is_count else "a number"
    is_valid = isinstance(value, int if is_count else (int, float)) and not isinstance(value, bool)
    if not (is_valid and math.isfinite(value) and low <= value <= high):
        raise BadInput.from_rule(
            f"`{setting.name}` of DiagnosisSettings must be {kind} between {low:g} and {high:g}", f"{value!r}"
        )


#: The default settings.
DEFAULT_SETTINGS = DiagnosisSettings()


@dataclass(frozen=True)
class SettingDescription:
    """A setting with its value and description.

    Attributes:
        group: step of the diagnosis.
        name: name of the field.
        value: value in use.
        default: default value.
        unit: unit; "1" for a pure number, "count" for an integer.
        meaning: what the value decides.
        larger: what a larger value does.
    """

    group: str
    name: str
    value: float
    default: float
    unit: str
    meaning: str
    larger: str


def describe_settings(settings: DiagnosisSettings = DEFAULT_SETTINGS) -> Iterator[SettingDescription]:
    """Yield every setting with its value and description, in the order of the steps."""
    for setting in dataclasses.fields(settings):
        texts = {key: setting.metadata[key] for key in ("group", "unit", "meaning", "larger")}
        yield SettingDescription(
            name=setting.name,
            value=getattr(settings, setting.name),
            default=cast(float, setting.default),
            **texts,
        )


def _format_documentation() -> str:
    """Return one line for each setting, as a list for each step."""
    lines, group = [], ""
    for setting in describe_settings():
        if setting.group != group:
            group = setting.group
            lines += ["", f"{group.capitalize()}:", ""]
        lines.append(
            f"- ``{setting.name}`` ({setting.unit}, default {setting.default:.4g}): {setting.meaning}."
            f" Larger: {setting.larger}."
        )
    return "\n".join(lines)


DiagnosisSettings.__doc__ = f"{DiagnosisSettings.__doc__ or ''}\n{_format_documentation()}\n"

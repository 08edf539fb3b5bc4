"""Thresholds of the noise estimate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


class NoiseThresholds(Protocol):
    """The thresholds of the estimate; `NoiseSettings` has them, and so do the settings of a diagnosis."""

    @property
    def max_noise_correlation(self) -> float: ...
    @property
    def min_correlation_se(self) -> float: ...
    @property
    def sensor_variance_sd_share(self) -> float: ...
    @property
    def min_samples_for_correlation(self) -> int: ...
    @property
    def min_near_step_share(self) -> float: ...


@dataclass(frozen=True)
class NoiseSettings:
    """Thresholds of the noise estimate.

    Attributes:
        max_noise_correlation: largest correlation of neighbouring noise samples.
        min_correlation_se: smallest significant correlation, in standard errors.
        sensor_variance_sd_share: relative sd of a stated noise variance.
        min_samples_for_correlation: smallest number of samples of a channel with an estimated correlation.
        min_near_step_share: steps beyond 3.5 robust sd are outliers if at least this share is within.
    """

    max_noise_correlation: float = 0.98
    min_correlation_se: float = 2.0
    sensor_variance_sd_share: float = 0.1
    min_samples_for_correlation: int = 30
    min_near_step_share: float = 0.9


#: The thresholds of `fit`, and the defaults of a diagnosis.
NOISE_SETTINGS = NoiseSettings()

"""Errors on held-out blocks, which neither the fits nor the search for mechanisms use.

If a part is unexplained, they can remove a mechanism (`held_out_ratios.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.crossval.solved_lengths import predict_solved
from pamjax.diagnosis.form_errors.prediction import ModelPrediction
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.diagnosis.settings import DEFAULT_SETTINGS, DiagnosisSettings
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.problem.rms import compute_rms
from pamjax.records.blocks import Blocks


@dataclass(frozen=True, eq=False)
class HeldOutErrors:
    """Errors on held-out blocks, without and with the mechanisms.

    Attributes:
        block_description: the held-out blocks, in words.
        held_out_mask: (n,) whether a row is held out.
        baseline_prediction, model_prediction: (2, n) force (N) and diameter (m) without the mechanisms, and
            with them and their form errors, by fits without the held-out rows.
        equation_prediction: (2, n) the latter without form errors.
        baseline_rmse, model_rmse: by channel, SI, over held-out rows; without channels that have none.
        equation_rmse: by channel, that of `equation_prediction`.
        expected_rmse: by channel, that of a correct model: from the noise, the standard deviations of the
            parameters and the form errors.
    """

    block_description: str
    held_out_mask: np.ndarray
    baseline_prediction: np.ndarray
    model_prediction: np.ndarray
    equation_prediction: np.ndarray
    baseline_rmse: dict[str, float]
    model_rmse: dict[str, float]
    equation_rmse: dict[str, float]
    expected_rmse: dict[str, float]

    @property
    def largest_error_ratio(self) -> float:
        """Return the largest ratio of `model_rmse` to `expected_rmse`; zero without held-out rows."""
        return max(
            (
                self.model_rmse[channel] / expected
                for channel, expected in self.expected_rmse.items()
                if channel in self.model_rmse
            ),
            default=0.0,
        )

    def is_increased(self, settings: DiagnosisSettings) -> bool:
        """Return whether the mechanisms increase the squared error over the expected one, of all channels.

        An increase by chance does not count (setting `max_noise_chi2_sd`).
        """
        increase = self._sum_relative_squares(self.model_rmse) - self._sum_relative_squares(
            self.baseline_rmse
        )
        noise_sd = np.sqrt(2 / max(self.held_out_mask.sum(), 1))
        return bool(increase > settings.max_noise_chi2_sd * noise_sd)

    @property
    def is_larger(self) -> bool:
        """Return whether the squared error over the expected one is larger with the mechanisms."""
        return self._sum_relative_squares(self.model_rmse) > self._sum_relative_squares(self.baseline_rmse)

    def _sum_relative_squares(self, rmse: dict[str, float]) -> float:
        return sum(
            (rmse[channel] / expected) ** 2
            for channel, expected in self.expected_rmse.items()
            if channel in rmse
        )


def build_held_out_mask(blocks: Blocks, settings: DiagnosisSettings = DEFAULT_SETTINGS) -> np.ndarray:
    """Return the mask of the held-out rows, (n,).

    It selects one block in `held_out_interval`, at least one, and never the first or the last. With fewer
    blocks than `min_blocks_for_hold_out` it selects none.
    """
    n_blocks = len(blocks)
    if n_blocks < settings.min_blocks_for_hold_out:
        return np.zeros(blocks.label.size, dtype=bool)
    # A refitted baseline is accurate by construction at the middle of few rows.
    is_short = blocks.kind in ("rows", "parts") and n_blocks <= settings.held_out_interval
    first = 1 if is_short else min(2, n_blocks // 2)
    block_labels = np.arange(n_blocks)[first :: settings.held_out_interval]
    # The first and the last block are not held out: that would be extrapolation.
    block_labels = (
        block_labels[block_labels < n_blocks - 1]
        if n_blocks > settings.min_blocks_for_hold_out
        else np.array([1])
    )
    return np.isin(blocks.label, block_labels)


def compute_held_out_errors(
    problem: LibraryProblem,
    blocks: Blocks,
    held_out_mask: np.ndarray,
    baseline: ModelFit,
    fit: ModelFit,
    prediction: ModelPrediction,
) -> HeldOutErrors:
    """Return the errors of a baseline and a model that were fitted without the held-out rows.

    Args:
        problem: the recording and the library.
        blocks: the blocks of the recording.
        held_out_mask: (n,) whether a row is held out.
        baseline: the fit without mechanisms.
        fit: the fit with mechanisms.
        prediction: its prediction, with form errors.
    """
    baseline_prediction, equation_prediction = (
        predict_solved(problem, each.estimate.values) for each in (baseline, fit)
    )
    # The model of an isotonic test is saved without form errors, and predicts without them.
    is_isotonic = problem.case.recording.measures_length
    model_prediction = equation_prediction if is_isotonic else prediction.values
    names = [blocks.names[k] for k in np.unique(blocks.label[held_out_mask]) if k >= 0]
    description = (
        f"{len(names)} of {len(blocks)} {blocks.kind}: {', '.join(names)}"
        if names
        else "none: too few blocks"
    )
    return HeldOutErrors(
        description,
        held_out_mask,
        baseline_prediction,
        model_prediction,
        equation_prediction,
        compute_rmse(problem, baseline_prediction, held_out_mask),
        compute_rmse(problem, model_prediction, held_out_mask),
        compute_rmse(problem, equation_prediction, held_out_mask),
        _compute_expected_rmse(problem, fit.noise, prediction.sd, held_out_mask),
    )


def _compute_expected_rmse(
    problem: LibraryProblem, noise: NoiseModel, sd: np.ndarray, rows: np.ndarray
) -> dict[str, float]:
    """Return the rms of noise and of the prediction's sd, (2, n), over some rows, by channel, SI."""
    expected = {}
    for c, (channel, channel_noise) in enumerate(zip(problem.channels, noise.by_channel, strict=True)):
        is_compared = rows & np.isfinite(problem.measured[c])
        if channel_noise is not None and is_compared.any():
            expected[channel] = compute_rms(np.hypot(channel_noise.sd, sd[c])[is_compared])
    return expected


def compute_rmse(problem: LibraryProblem, prediction: np.ndarray, rows: np.ndarray) -> dict[str, float]:
    """Return the rmse of a prediction, (2, n), over some rows, by measured channel, SI."""
    rmse_by_channel = {}
    for c, channel in enumerate(problem.channels):
        residual = (problem.measured[c] - prediction[c])[rows]
        if np.isfinite(residual).any():
            rmse_by_channel[channel] = compute_rms(residual)
    return rmse_by_channel

"""Leave-one-block-out cross-validation: what mechanisms explain in blocks that the fit did not use.

Each block is left out once, and the model is refitted with and without the mechanisms. All mechanisms
together explain this fraction of the misfit of the left-out blocks:

    1 − Σ excess with / Σ excess without,        excess = χ² − samples of the left-out block.

Each mechanism alone reduces χ² in the left-out blocks, and in the same blocks after a fit to all of them. The
ratio of both reductions is its predicted fraction. It depends little on misfit that other physics leaves. Its
fraction is small if a wrong mechanism only adapts to the blocks in the fit.

A block is skipped for amplitudes that no other block constrains, because no fit without it can predict them.
Shape parameters that only the left-out block determines stay at their estimates from all blocks. A baseline
parameter that only this block determines (the ruler's error at its length) is fitted to it first. The
parameter errors of a fit cause an expected excess tr(J C Jᵀ) in the left-out block. C is the covariance of
the parameters, and J the Jacobian of the block. This excess is not attributed to the mechanisms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import MapEstimate, evaluate_estimate, fit_parameters
from pamjax.diagnosis.refit.model_fit import (
    ModelFit,
    get_free_indices,
    switch_off_candidate,
)
from pamjax.infer.form_errors.discrepancy import DiscrepancyNoise
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.records.blocks import Blocks


@dataclass(frozen=True, eq=False)
class BlockCrossValidation:
    """Leave-one-block-out cross-validation of a model.

    Attributes:
        problem: the recording and the library.
        fit: the fit to all blocks.
        noise_splits: for each block, the noise model of the other blocks and of the block; empty if there are
            too few blocks.
        fixed_indices: for each block, the shape parameters that the other blocks do not determine.
        block_fits: the results of the fits without one block.
        is_informed: by mechanism id, for each block, whether the other blocks constrain its amplitudes.
    """

    problem: LibraryProblem
    fit: ModelFit
    noise_splits: list[tuple[NoiseModel, NoiseModel]]
    fixed_indices: list[set[int]]
    block_fits: list[_LeftOutBlock]
    is_informed: dict[str, list[bool]]

    @classmethod
    def from_blocks(
        cls, problem: LibraryProblem, blocks: Blocks, training_mask: np.ndarray, fit: ModelFit
    ) -> BlockCrossValidation:
        """Return the cross-validation of a fit on the blocks with measured samples in the training rows."""
        measured_rows = training_mask & np.isfinite(problem.measured).any(axis=0)
        noise_splits = [
            (
                fit.noise.restrict_to_rows(measured_rows & ~blocks.build_mask(k)),
                fit.noise.restrict_to_rows(measured_rows & blocks.build_mask(k)),
            )
            for k in np.unique(blocks.label[measured_rows])
            if k >= 0
        ]
        noise_splits = (
            noise_splits if len(noise_splits) >= problem.settings.min_blocks_for_cross_validation else []
        )
        unknown_indices = [
            _find_uninformed_indices(problem, fit, training_noise) for training_noise, _ in noise_splits
        ]
        is_informed = {
            candidate.id: [
                not {problem.index(name) for name in candidate.amplitudes} <= unknown
                for unknown in unknown_indices
            ]
            for candidate in fit.mechanisms
        }
        amplitudes = {problem.index(name) for candidate in fit.mechanisms for name in candidate.amplitudes}
        fixed_indices = [unknown - amplitudes for unknown in unknown_indices]
        block_fits = _fit_without_blocks(
            problem, fit.mechanisms, fit.estimate.values, noise_splits, fixed_indices
        )
        return cls(problem, fit, noise_splits, fixed_indices, block_fits, is_informed)

    @property
    def fails_out_of_sample(self) -> bool:
        """Return whether left-out blocks have a significant error and the explained fraction is too small."""
        expected_excesses = np.array([block_fit.expected_excess for block_fit in self.block_fits])
        # Skip a block if no other block constrains one of the amplitudes.
        informed_blocks = self._select_informed_blocks(self.fit.mechanisms) & (
            expected_excesses < [left_out_noise.size for _, left_out_noise in self.noise_splits]
        )
        size = np.array([left_out_noise.size for _, left_out_noise in self.noise_splits])[informed_blocks]
        samples = np.array([noise.sample_count for _, noise in self.noise_splits])[informed_blocks].sum()
        excess = np.array([block_fit.unexpected_excess for block_fit in self.block_fits])[informed_blocks]
        expected_excess = expected_excesses[informed_blocks]
        # Upper limit: the whole parameter uncertainty of a block acts in one direction.
        noise_limit = self.problem.settings.max_noise_chi2_sd * np.sqrt(
            2 * np.sum(size + 2 * expected_excess + expected_excess**2)
        )
        return (
            bool(excess.sum() > max(self.problem.settings.min_unexplained_rms**2 * samples, noise_limit))
            and self.explained_fraction < self.problem.settings.min_explained_fraction
        )

    @cached_property
    def explained_fraction(self) -> float:
        """Return the fraction of the misfit of left-out blocks that all mechanisms explain, 0 to 1."""
        if not self.noise_splits:
            return 1.0
        informed_blocks = self._select_informed_blocks(self.fit.mechanisms)
        excess_with, excess_without = (
            np.array([block_fit.excess_chi2 for block_fit in fits])
            for fits in (self.block_fits, self._baseline.block_fits)
        )
        return _compute_explained_fraction(
            excess_with[informed_blocks].sum(),
            excess_without[informed_blocks].sum(),
            excess_without.sum(),
            self.problem.settings.min_information_share,
        )

    @cached_property
    def predicted_fraction_by_mechanism(self) -> dict[str, float]:
        """Return by id the fraction of a mechanism's effect on χ² that left-out blocks confirm, 0 to 1."""
        return {
            candidate.id: self._compute_predicted_fraction(candidate) for candidate in self.fit.mechanisms
        }

    @property
    def left_out_excess_without(self) -> dict[str, float]:
        """Return by id the excess χ² of all left-out blocks without a mechanism."""
        return {
            id: sum(block_fit.excess_chi2 for block_fit in reduced.block_fits)
            for id, reduced in self._reduced_models.items()
        }

    @cached_property
    def _reduced_models(self) -> dict[str, _ReducedModel]:
        """Return by id the model without a mechanism."""
        if len(self.fit.mechanisms) == 1:
            return {self.fit.mechanisms[0].id: self._baseline}
        return {candidate.id: self._remove_mechanisms((candidate,)) for candidate in self.fit.mechanisms}

    def _compute_predicted_fraction(self, candidate: Candidate) -> float:
        if not self.noise_splits:
            return 1.0
        reduced = self._reduced_models[candidate.id]
        fitted_reduction = reduced.compute_fitted_chi2() - self._compute_fitted_chi2()
        informed_blocks = self._select_informed_blocks((candidate,))
        return _compute_predicted_fraction(
            _compute_left_out_reduction(reduced.block_fits, self.block_fits, informed_blocks),
            fitted_reduction[informed_blocks].sum(),
            fitted_reduction.sum(),
            self.problem.settings.min_information_share,
        )

    @cached_property
    def _baseline(self) -> _ReducedModel:
        """Return the model without any of its mechanisms."""
        return self._remove_mechanisms(self.fit.mechanisms)

    def _select_informed_blocks(self, removed_candidates: Sequence[Candidate]) -> np.ndarray:
        """Return the mask of the blocks whose removed amplitudes the other blocks constrain."""
        return np.all([self.is_informed[candidate.id] for candidate in removed_candidates], axis=0)

    def _compute_fitted_chi2(self) -> np.ndarray:
        """Return χ² of each block for the fit to all blocks."""
        return _compute_block_chi2(self.problem, self.noise_splits, self.fit.estimate)

    def _remove_mechanisms(self, removed_candidates: Sequence[Candidate]) -> _ReducedModel:
        """Return the model without some mechanisms and their form errors, which could replace the effects."""
        removed_ids = {candidate.id for candidate in removed_candidates}
        values = self.fit.estimate.values
        for candidate in removed_candidates:
            values = switch_off_candidate(self.problem, values, candidate)
        return _ReducedModel(
            self.problem,
            tuple(candidate for candidate in self.fit.mechanisms if candidate.id not in removed_ids),
            values,
            _remove_form_errors(self.fit.noise, removed_ids),
            [
                (_remove_form_errors(training, removed_ids), _remove_form_errors(left_out, removed_ids))
                for training, left_out in self.noise_splits
            ],
            self.fixed_indices,
        )


@dataclass(frozen=True, eq=False)
class _ReducedModel:
    """A model without one or all of its mechanisms.

    Attributes:
        problem: the recording and the library.
        mechanisms: the remaining mechanisms.
        values: (p,) starting values of a refit, SI.
        noise: noise model of all blocks.
        noise_splits: for each block, the noise model of the other blocks and of the block.
        fixed_indices: for each block, the shape parameters that the other blocks do not determine.
    """

    problem: LibraryProblem
    mechanisms: tuple[Candidate, ...]
    values: np.ndarray
    noise: NoiseModel
    noise_splits: list[tuple[NoiseModel, NoiseModel]]
    fixed_indices: list[set[int]]

    @cached_property
    def block_fits(self) -> list[_LeftOutBlock]:
        """Return the results of the fits without each block."""
        return _fit_without_blocks(
            self.problem, self.mechanisms, self.values, self.noise_splits, self.fixed_indices
        )

    def compute_fitted_chi2(self) -> np.ndarray:
        """Return χ² of each block for a fit to all blocks."""
        free = get_free_indices(self.problem, self.mechanisms)
        estimate = fit_parameters(
            self.problem, self.noise, free, self.values, 2 * self.problem.settings.rough_evaluations
        )
        return _compute_block_chi2(self.problem, self.noise_splits, estimate)


def _compute_block_chi2(
    problem: LibraryProblem, noise_splits: Sequence[tuple[NoiseModel, NoiseModel]], estimate: MapEstimate
) -> np.ndarray:
    """Return χ² of each block at an estimate."""
    return np.array(
        [evaluate_estimate(problem, noise, estimate.free, estimate.values).chi2 for _, noise in noise_splits]
    )


def _remove_form_errors(noise: NoiseModel, ids: set[str]) -> NoiseModel:
    """Return the noise without the form errors of removed mechanisms, which could replace their effects."""
    return noise.remove_columns(ids) if isinstance(noise, DiscrepancyNoise) else noise


def _compute_explained_fraction(
    excess_with: float, excess_without: float, total_excess: float, min_information_share: float
) -> float:
    """Return the explained fraction of an excess; 1 if the excess without mechanisms is too small."""
    if excess_without <= min_information_share * max(total_excess, 0.0):
        return 1.0
    return float(np.clip(1 - max(excess_with, 0.0) / excess_without, 0.0, 1.0))


def _compute_predicted_fraction(
    left_out_reduction: float, fitted_reduction: float, total_reduction: float, min_information_share: float
) -> float:
    """Return the fraction of a reduction of χ² that left-out blocks confirm.

    It is 1 if the blocks that can test it have too little of the reduction, and 0 if there is no reduction.
    """
    if total_reduction > 0 and fitted_reduction <= min_information_share * total_reduction:
        return 1.0
    return float(np.clip(left_out_reduction / fitted_reduction, 0.0, 1.0)) if fitted_reduction > 0 else 0.0


@dataclass(frozen=True, eq=False)
class _LeftOutBlock:
    """Result of a fit without one block.

    Attributes:
        excess_chi2: χ² of the left-out block minus its samples.
        expected_excess: expected part of it due to the parameter errors of the fit.
    """

    excess_chi2: float
    expected_excess: float

    @property
    def unexpected_excess(self) -> float:
        """Return the part of the excess that the parameter errors do not cause."""
        return self.excess_chi2 - self.expected_excess


def _compute_left_out_reduction(
    fits_without: Sequence[_LeftOutBlock], fits: Sequence[_LeftOutBlock], informed_blocks: np.ndarray
) -> float:
    """Return the reduction of χ² in left-out blocks by a mechanism.

    Few blocks determine many parameters badly, which increases χ² with and without the mechanism. The
    reduction is the larger one with and without this expected increase.

    Args:
        fits_without: for each block, the fit without the mechanism.
        fits: for each block, the fit with it.
        informed_blocks: mask of the blocks that test the mechanism.
    """
    raw, unexpected = (
        np.array([size(without) - size(fit) for without, fit in zip(fits_without, fits, strict=True)])
        for size in (lambda fit: fit.excess_chi2, lambda fit: max(fit.unexpected_excess, 0.0))
    )
    return float(max(raw[informed_blocks].sum(), unexpected[informed_blocks].sum()))


def _fit_without_blocks(
    problem: LibraryProblem,
    mechanisms: Sequence[Candidate],
    values: np.ndarray,
    noise_splits: Sequence[tuple[NoiseModel, NoiseModel]],
    fixed_indices: Sequence[set[int]],
) -> list[_LeftOutBlock]:
    """Return the results of the fits without each block."""
    baseline_indices = np.flatnonzero(problem.is_baseline).tolist()
    free = get_free_indices(problem, mechanisms)

    def fit_without_block(split: tuple[tuple[NoiseModel, NoiseModel], set[int]]) -> _LeftOutBlock:
        (training_noise, left_out_noise), fixed = split
        estimate = fit_parameters(
            problem,
            training_noise,
            [k for k in free if k not in fixed],
            values,
            2 * problem.settings.rough_evaluations,
        )
        unknown_indices = [
            k for k in baseline_indices if not estimate.jacobian[:, estimate.free.index(k)].any()
        ]
        corrected_values = (
            fit_parameters(
                problem, left_out_noise, unknown_indices, estimate.values, problem.settings.rough_evaluations
            ).values
            if unknown_indices
            else estimate.values
        )
        shared_positions = [j for j, k in enumerate(estimate.free) if k not in unknown_indices]
        left_out_estimate = evaluate_estimate(
            problem, left_out_noise, [estimate.free[j] for j in shared_positions], corrected_values
        )
        by_value = left_out_estimate.jacobian / np.where(
            left_out_estimate.scale != 0, left_out_estimate.scale, 1.0
        )
        expected_excess = float(
            np.sum(by_value @ estimate.covariance[np.ix_(shared_positions, shared_positions)] * by_value)
        )
        return _LeftOutBlock(left_out_estimate.chi2 - left_out_estimate.residual.size, expected_excess)

    return parallel_map(fit_without_block, list(zip(noise_splits, fixed_indices, strict=True)))


def _find_uninformed_indices(problem: LibraryProblem, fit: ModelFit, training_noise: NoiseModel) -> set[int]:
    """Return the mechanism parameters that the training rows, or all rows, do not determine."""
    training_estimate = evaluate_estimate(problem, training_noise, fit.estimate.free, fit.estimate.values)
    training_information, total_information = (
        np.sum(estimate.jacobian**2, axis=0) for estimate in (training_estimate, fit.estimate)
    )
    is_unknown = (training_information <= problem.settings.min_information_share * total_information) | (
        total_information * fit.estimate.prior_sd**2 < 1
    )
    return {
        k
        for k, unknown in zip(fit.estimate.free, is_unknown, strict=True)
        if unknown and not problem.is_baseline[k]
    }

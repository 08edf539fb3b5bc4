"""What names explain of blocks that they were not fitted to.

Each block is left out once, the model is refitted with names and without them, and

    share = 1 − Σ excess with / Σ excess without,        excess = χ² − samples of the left-out block,

is what they explain of a misfit that they have not seen.

A block that alone knows how much there is of something says nothing of it, as nobody else could foretell it.
When it came, or where it begins, is told beforehand if no other block knows; and an error of the lab's own
that only the left-out block knows of (of the ruler, at that length) is made up for first. What the error of a
fit's numbers is expected to make of a block that it did not see, tr(J C Jᵀ) with their covariance C and the
slopes J of the block, is no fault of the names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.detect.residual_test import MIN_UNEXPLAINED_RMS
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.estimate import NoiseModel
from pamjax.diagnosis.refit.candidate_fit import CandidateFit, get_parameter_indices, switch_off_candidate
from pamjax.diagnosis.refit.least_squares import evaluate_estimate, fit_parameters
from pamjax.diagnosis.select.pair_swap import MAX_NOISE_CHI2_SD
from pamjax.diagnosis.select.search import ROUGH_EVALUATIONS
from pamjax.records.blocks import Blocks

#: Share of a misfit in unseen blocks that all names together must explain.
MIN_EXPLAINED_FRACTION = 5 / 6
#: Blocks below which nothing is tried: a single other setting foretells none.
MIN_BLOCKS_FOR_CROSS_VALIDATION = 3
#: Share of what a recording knows of a number below which the rest of it, without a block, knows nothing.
MIN_INFORMATION_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class BlockCrossValidation:
    """A model held against blocks that it was not fitted to, each left out of a fit once.

    Attributes:
        problem: the recording before the library.
        fit: as all blocks tell it.
        noise_splits: the noise of all but one block, and of that block, for each; none where blocks are too
            few.
        fixed_indices: shapes that stay where all blocks put them, as nothing is known of them without one,
            for each.
        block_fits: the fits without a block.
        is_informed: whether a fit without a block still knows of a form's amplitudes, by id.
    """

    problem: LibraryProblem
    fit: CandidateFit
    noise_splits: list[tuple[NoiseModel, NoiseModel]]
    fixed_indices: list[set[int]]
    block_fits: list[_LeftOutBlock]
    is_informed: dict[str, list[bool]]

    @classmethod
    def from_blocks(
        cls, problem: LibraryProblem, blocks: Blocks, training_rows: np.ndarray, fit: CandidateFit
    ) -> BlockCrossValidation:
        """Held against the blocks that have readings among the rows that may be looked at."""
        measured_rows = training_rows & np.isfinite(problem.measured).any(axis=0)
        noise_splits = [
            (
                fit.noise.restrict_to_rows(measured_rows & ~blocks.build_mask(k)),
                fit.noise.restrict_to_rows(measured_rows & blocks.build_mask(k)),
            )
            for k in np.unique(blocks.label[measured_rows])
            if k >= 0
        ]
        noise_splits = noise_splits if len(noise_splits) >= MIN_BLOCKS_FOR_CROSS_VALIDATION else []
        uninformed = [
            _find_uninformed_indices(problem, fit, training_noise) for training_noise, _ in noise_splits
        ]
        is_informed = {
            candidate.id: [
                not {problem.index(name) for name in candidate.amplitudes} <= unknown
                for unknown in uninformed
            ]
            for candidate in fit.mechanisms
        }
        amplitudes = {problem.index(name) for candidate in fit.mechanisms for name in candidate.amplitudes}
        fixed_indices = [unknown - amplitudes for unknown in uninformed]
        block_fits = _fit_without_blocks(
            problem, fit.mechanisms, fit.estimate.values, noise_splits, fixed_indices
        )
        return cls(problem, fit, noise_splits, fixed_indices, block_fits, is_informed)

    @property
    def fails_out_of_sample(self) -> bool:
        """Whether all names together leave more of unseen blocks than physics does, and than chance."""
        expected_excesses = np.array([block_fit.expected_excess for block_fit in self.block_fits])
        # A block that alone knows of a number says nothing of it.
        informed = self._select_informed_blocks(self.fit.mechanisms) & (
            expected_excesses < [held_out_noise.size for _, held_out_noise in self.noise_splits]
        )
        size = np.array([held_out_noise.size for _, held_out_noise in self.noise_splits])[informed]
        excess = np.array(
            [block_fit.excess_chi2 - block_fit.expected_excess for block_fit in self.block_fits]
        )[informed]
        expected_excess = expected_excesses[informed]
        # As if all doubt of a block were in one direction.
        noise_limit = MAX_NOISE_CHI2_SD * np.sqrt(2 * np.sum(size + 2 * expected_excess + expected_excess**2))
        return (
            bool(excess.sum() > max(MIN_UNEXPLAINED_RMS**2 * size.sum(), noise_limit))
            and self.explained_fraction < MIN_EXPLAINED_FRACTION
        )

    @cached_property
    def explained_fraction(self) -> float:
        """The share of a misfit in blocks left out of a fit that all names explain, 0 to 1."""
        return self._compute_explained_fraction(self.fit.mechanisms)

    @property
    def explained_fraction_by_mechanism(self) -> dict[str, float]:
        """The share that each explains of what is left without it, by id."""
        if len(self.fit.mechanisms) == 1:
            return {self.fit.ids[0]: self.explained_fraction}
        return {
            candidate.id: self._compute_explained_fraction((candidate,)) for candidate in self.fit.mechanisms
        }

    def _select_informed_blocks(self, removed: Sequence[Candidate]) -> np.ndarray:
        """The blocks of which a fit without them can be expected to know."""
        return np.all([self.is_informed[candidate.id] for candidate in removed], axis=0)

    def _compute_explained_fraction(self, removed: Sequence[Candidate]) -> float:
        if not self.noise_splits:
            return 1.0
        fit = self.fit
        remaining, values = (
            tuple(candidate for candidate in fit.mechanisms if candidate not in removed),
            fit.estimate.values,
        )
        for candidate in removed:
            values = switch_off_candidate(self.problem, values, candidate)
        fits_without = _fit_without_blocks(
            self.problem, remaining, values, self.noise_splits, self.fixed_indices
        )
        excess_with, excess_without = (
            np.array([block_fit.excess_chi2 for block_fit in fits])
            for fits in (self.block_fits, fits_without)
        )
        informed = self._select_informed_blocks(removed)
        return _compute_explained_share(
            excess_with[informed].sum(), excess_without[informed].sum(), excess_without.sum()
        )


def _compute_explained_share(excess_with: float, excess_without: float, total_excess: float) -> float:
    """The share of what was left before that is not left now; one where there is nothing to try it on."""
    if excess_without <= MIN_INFORMATION_SHARE * max(total_excess, 0.0):
        return 1.0
    return float(np.clip(1 - max(excess_with, 0.0) / excess_without, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class _LeftOutBlock:
    """A fit without a block.

    Attributes:
        excess_chi2: χ² of the block under it, beyond its samples.
        expected_excess: what of that the error of the fit's own numbers is expected to make.
    """

    excess_chi2: float
    expected_excess: float


def _fit_without_blocks(
    problem: LibraryProblem,
    mechanisms: Sequence[Candidate],
    values: np.ndarray,
    noise_splits: Sequence[tuple[NoiseModel, NoiseModel]],
    fixed_indices: Sequence[set[int]],
) -> list[_LeftOutBlock]:
    """Fits without each block."""
    baseline_indices = np.flatnonzero(problem.is_baseline).tolist()
    free = sorted({*baseline_indices, *get_parameter_indices(problem, mechanisms)})

    def fit_without_block(split: tuple[tuple[NoiseModel, NoiseModel], set[int]]) -> _LeftOutBlock:
        (training_noise, held_out_noise), fixed = split
        estimate = fit_parameters(
            problem, training_noise, [k for k in free if k not in fixed], values, 2 * ROUGH_EVALUATIONS
        )
        alone = [k for k in baseline_indices if not estimate.jacobian[:, estimate.free.index(k)].any()]
        corrected_values = (
            fit_parameters(problem, held_out_noise, alone, estimate.values, ROUGH_EVALUATIONS).values
            if alone
            else estimate.values
        )
        shared = [j for j, k in enumerate(estimate.free) if k not in alone]
        held_out_estimate = evaluate_estimate(
            problem, held_out_noise, [estimate.free[j] for j in shared], corrected_values
        )
        by_value = held_out_estimate.jacobian / np.where(
            held_out_estimate.scale != 0, held_out_estimate.scale, 1.0
        )
        expected_excess = float(np.sum(by_value @ estimate.covariance[np.ix_(shared, shared)] * by_value))
        return _LeftOutBlock(held_out_estimate.chi2 - held_out_estimate.residual.size, expected_excess)

    return parallel_map(fit_without_block, list(zip(noise_splits, fixed_indices, strict=True)))


def _find_uninformed_indices(
    problem: LibraryProblem, fit: CandidateFit, training_noise: NoiseModel
) -> set[int]:
    """The numbers of names of which some rows know nothing, beside what all know, or all of them nothing."""
    training_estimate = evaluate_estimate(problem, training_noise, fit.estimate.free, fit.estimate.values)
    training_information, total_information = (
        np.sum(estimate.jacobian**2, axis=0) for estimate in (training_estimate, fit.estimate)
    )
    uninformed = (training_information <= MIN_INFORMATION_SHARE * total_information) | (
        total_information * fit.estimate.prior_sd**2 < 1
    )
    return {
        k
        for k, unknown in zip(fit.estimate.free, uninformed, strict=True)
        if unknown and not problem.is_baseline[k]
    }

"""Search of the sets of mechanisms with the largest evidence.

It begins with the baseline alone. The sets with the largest evidence are extended by the mechanisms whose
score is largest, and reduced by each of their own. Every trial is refitted with the form errors of its
mechanisms.
The search ends when the best sets have been extended and nothing better appears.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.detect.score_test import ScoreDirection, compute_score_directions
from pamjax.diagnosis.evidence.columns import (
    build_form_columns,
    build_generic_columns,
    compute_effect_of,
    stack_whitened,
    whiten_generic_columns,
)
from pamjax.diagnosis.evidence.coordinates import Coordinates
from pamjax.diagnosis.evidence.discrepancy import DiscrepancyNoise, add_discrepancy
from pamjax.diagnosis.evidence.marginal_likelihood import Evidence, LinearModel, compute_evidence
from pamjax.diagnosis.evidence.settings import EvidenceSettings
from pamjax.diagnosis.library.candidates import Candidate, build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.candidate_fit import get_free_indices, switch_off_candidate, switch_on_candidate
from pamjax.diagnosis.refit.least_squares import (
    MapEstimate,
    compute_priors,
    evaluate_estimate,
    fit_parameters,
    transform_to_coordinates,
)
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.model.registry import EXCLUSIVE_PAIRS
from pamjax.progress import Progress, ignore_progress

#: Sets that are extended side by side, mechanisms tried in each, and sets extended in all.
BEAM_WIDTH, TRIAL_COUNT, MAX_EXTENSIONS = 2, 6, 7
#: Evaluations of a refit, and refits of a trial: a form error changes with its mechanism.
REFIT_EVALUATIONS, REFIT_ROUNDS = 8, 2
#: Reduction of χ² below which a mechanism is not tried.
MIN_SCORE = 6.0
#: Standardised residual of a state without an answer.
FAILED_RESIDUAL = 30.0


@dataclass(frozen=True, eq=False)
class EvidenceFit:
    """A set of mechanisms, refitted with its form errors.

    Attributes:
        mechanisms: the candidates in the set.
        estimate: the estimated parameters.
        noise: noise with the form errors at their most probable sizes.
        evidence: of the set.
        form_ratios: rms of the estimated form error over the rms of the effect, by mechanism.
    """

    mechanisms: tuple[Candidate, ...]
    estimate: MapEstimate
    noise: DiscrepancyNoise
    evidence: Evidence
    form_ratios: dict[str, float]

    @property
    def ids(self) -> frozenset[str]:
        return frozenset(candidate.id for candidate in self.mechanisms)

    @property
    def values(self) -> np.ndarray:
        """(p,) all parameter values, SI."""
        return self.estimate.values


class EvidenceSearch:
    """The search over one recording."""

    def __init__(
        self, problem: LibraryProblem, noise: NoiseModel, values: np.ndarray, settings: EvidenceSettings
    ) -> None:
        """Begin at the baseline.

        Args:
            problem: the recording and the library.
            noise: noise of the recording; the same for all sets.
            values: (p,) estimate of the baseline, SI.
            settings: prior probabilities.
        """
        self.problem, self.noise, self.settings = problem, noise, settings
        self.coordinates = Coordinates.from_problem(problem)
        self.candidates = build_candidates(problem)
        self.generic = whiten_generic_columns(noise, build_generic_columns(problem, self.coordinates))
        self.fits: dict[frozenset[str], EvidenceFit] = {}
        self._register(self.refit((), values))

    def run(self, progress: Progress = ignore_progress) -> list[EvidenceFit]:
        """Return all sets that were tried, largest evidence first."""
        extended: set[frozenset[str]] = set()
        while len(extended) < MAX_EXTENSIONS:
            leading = [fit for fit in self.rank()[:BEAM_WIDTH] if fit.ids not in extended]
            if not leading:
                break
            for fit in leading:
                progress("selecting mechanisms", 0.1 + 0.6 * len(extended) / MAX_EXTENSIONS)
                extended.add(fit.ids)
                self._extend(fit)
                self._reduce(fit)
        return self.rank()

    def rank(self) -> list[EvidenceFit]:
        """Return the sets tried so far, largest evidence first."""
        return sorted(self.fits.values(), key=lambda fit: -fit.evidence.total)

    def refit(
        self, mechanisms: Sequence[Candidate], values: np.ndarray, noise: NoiseModel | None = None
    ) -> EvidenceFit:
        """Return a set refitted from starting values (p,), SI, with the form errors at its estimate."""
        free, fit = get_free_indices(self.problem, mechanisms), None
        for _ in range(REFIT_ROUNDS if mechanisms else 1):
            noise = noise or self.noise
            values = fit_parameters(self.problem, noise, free, values, REFIT_EVALUATIONS).values
            fit = self._evaluate(tuple(mechanisms), free, values)
            noise = fit.noise
        assert fit is not None
        return fit

    def _extend(self, fit: EvidenceFit) -> None:
        if len(fit.mechanisms) >= self.settings.max_mechanisms:
            return
        for direction in self._list_promising(fit):
            starts = [fit.values] if fit.mechanisms else [fit.values, self.problem.neutral]
            for start in starts:
                values = switch_on_candidate(self.problem, start, direction.candidate, direction.amplitudes)
                self._register(self.refit((*fit.mechanisms, direction.candidate), values, fit.noise))

    def _reduce(self, fit: EvidenceFit) -> None:
        if len(fit.mechanisms) < 2:
            return
        for candidate in fit.mechanisms:
            remaining = tuple(other for other in fit.mechanisms if other is not candidate)
            self._register(self.refit(remaining, switch_off_candidate(self.problem, fit.values, candidate)))

    def _register(self, fit: EvidenceFit) -> None:
        known = self.fits.get(fit.ids)
        if known is None or fit.evidence.total > known.evidence.total:
            self.fits[fit.ids] = fit

    def _list_promising(self, fit: EvidenceFit) -> list[ScoreDirection]:
        """Return the best form with each set of free parameters, of the most promising mechanisms."""
        barred = {
            *fit.ids,
            *(id for pair in EXCLUSIVE_PAIRS if pair & fit.ids for id in pair),
        }
        candidates = [candidate for candidate in self.candidates if candidate.id not in barred]
        directions = compute_score_directions(self.problem, fit.noise, fit.estimate, candidates)
        best: dict[tuple[str, ...], ScoreDirection] = {}
        for direction in directions:
            key = direction.candidate.free_parameters
            if key not in best or direction.chi2_reduction > best[key].chi2_reduction:
                best[key] = direction
        score: dict[str, float] = {}
        for direction in best.values():
            id = direction.candidate.id
            score[id] = max(score.get(id, 0.0), direction.chi2_reduction)
        count = TRIAL_COUNT if fit.mechanisms else TRIAL_COUNT + 2
        leading = sorted((id for id in score if score[id] > MIN_SCORE), key=lambda id: -score[id])[:count]
        return [
            direction
            for direction in best.values()
            if direction.candidate.id in leading
            and direction.chi2_reduction > 0.5 * score[direction.candidate.id]
        ]

    def _evaluate(
        self, mechanisms: tuple[Candidate, ...], free: list[int], values: np.ndarray
    ) -> EvidenceFit:
        problem, noise = self.problem, self.noise
        forms = stack_whitened(
            noise, [build_form_columns(problem, self.coordinates, values, m) for m in mechanisms]
        )
        forms = [block if block.shape[1] else np.zeros((0, noise.size)) for block in forms]
        model = self._linearise(free, values, forms)
        evidence = compute_evidence(model, len(mechanisms), self.settings)
        sized = [block * share for block, share in zip(forms, evidence.form_shares, strict=True)]
        with_forms = add_discrepancy(noise, np.concatenate([np.zeros((0, noise.size)), *sized]))
        ratios = {
            candidate.id: _compute_rms(coefficients @ block)
            / max(
                _compute_rms(np.nan_to_num(noise.whiten(compute_effect_of(problem, values, candidate)))),
                1e-12,
            )
            for candidate, block, coefficients in zip(
                mechanisms, forms, evidence.form_coefficients, strict=True
            )
            if len(block)
        }
        estimate = evaluate_estimate(problem, with_forms, free, values)
        return EvidenceFit(mechanisms, estimate, with_forms, evidence, ratios)

    def _linearise(self, free: list[int], values: np.ndarray, forms: list[np.ndarray]) -> LinearModel:
        problem, noise = self.problem, self.noise
        prediction, jacobian = problem.jacobian(values, free)
        log = problem.is_logarithmic[free]
        scale = np.where(log, values[free], 1.0)
        mean, prior_sd = compute_priors(problem, free)
        coordinates = transform_to_coordinates(problem, free, values)
        is_amplitude = problem.is_switch[free] & ~problem.is_baseline[free]
        has_prior = np.isfinite(prior_sd) & ~is_amplitude
        sd = np.where(has_prior, prior_sd, 1.0)
        return LinearModel(
            residual=np.nan_to_num(noise.whiten(problem.measured - prediction), nan=FAILED_RESIDUAL),
            jacobian=np.nan_to_num(noise.whiten(jacobian)) * scale[:, None],
            prior_offset=np.where(has_prior, (mean - coordinates) / sd, 0.0),
            prior_sd=np.where(has_prior, prior_sd, np.inf),
            is_amplitude=is_amplitude,
            amplitude=np.where(is_amplitude, (values - problem.neutral)[free], 0.0),
            forms=forms,
            generic=self.generic,
        )


def _compute_rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0

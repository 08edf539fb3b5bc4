"""Search of the sets of mechanisms with the largest evidence.

It begins with the baseline alone. At the best sets, linear algebra proposes additions of one or two
mechanisms (`proposals.py`). The most promising are refitted in full, with their form errors, and so is each set without
one of its mechanisms. The search ends when no proposal promises more than the best set.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.compile.parallel import parallel_map
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
from pamjax.diagnosis.evidence.proposals import Proposal, propose_additions
from pamjax.diagnosis.evidence.settings import EvidenceSettings
from pamjax.diagnosis.evidence.templates import Template
from pamjax.diagnosis.library.candidates import Candidate, build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.estimate import NoiseModel
from pamjax.diagnosis.refit.candidate_fit import get_free_indices, switch_off_candidate, switch_on_candidate
from pamjax.diagnosis.refit.least_squares import (
    MapEstimate,
    compute_priors,
    evaluate_estimate,
    fit_parameters,
    transform_to_coordinates,
)
from pamjax.progress import Progress, ignore_progress

#: Sets whose additions are proposed, and refits of proposals at each.
MAX_CENTRES, REFITS_PER_CENTRE = 5, 4
#: A proposal is refitted if it promises this share of the best gain, or a total within this of the best set.
MIN_GAIN_SHARE, MAX_SHORTFALL = 0.6, 8.0
#: Evaluations of a refit, and refits of a trial: a form error changes with its mechanism.
REFIT_EVALUATIONS, REFIT_ROUNDS = 8, 2
#: Standardised residual of a state without an answer.
FAILED_RESIDUAL = 30.0
#: Prior sd of a template in a refit, in sizes that one sample determines: free, and finite.
TEMPLATE_SD = 10.0


@dataclass(frozen=True, eq=False)
class EvidenceFit:
    """A set of mechanisms, refitted with its form errors.

    Attributes:
        mechanisms: the candidates in the set.
        estimate: the estimated parameters.
        noise: noise with the form errors at their most probable sizes, and with the best template.
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
        self,
        problem: LibraryProblem,
        noise: NoiseModel,
        values: np.ndarray,
        settings: EvidenceSettings,
        templates: Sequence[Template] = (),
    ) -> None:
        """Begin at the baseline.

        Args:
            problem: the recording and the library.
            noise: noise of the recording; the same for all sets.
            values: (p,) estimate of the baseline, SI.
            settings: prior probabilities.
            templates: effects outside the library that compete with the mechanisms.
        """
        self.problem, self.noise, self.settings = problem, noise, settings
        self.coordinates = Coordinates.from_problem(problem)
        self.candidates = build_candidates(problem)
        self.generic = whiten_generic_columns(noise, build_generic_columns(problem, self.coordinates))
        self.templates = templates
        self.template_columns = stack_whitened(noise, [template.columns for template in templates])
        self.fits: dict[frozenset[str], EvidenceFit] = {}
        self.family_count = len({template.id for template in templates})
        self._register(self.refit((), values))

    def run(self, progress: Progress = ignore_progress) -> list[EvidenceFit]:
        """Return all sets that were tried, largest evidence first."""
        expanded: set[frozenset[str]] = set()
        while len(expanded) < MAX_CENTRES:
            centre = self.rank()[0]
            if centre.ids in expanded:
                break
            progress("selecting mechanisms", 0.1 + 0.7 * len(expanded) / MAX_CENTRES)
            expanded.add(centre.ids)
            self._extend(centre)
            self._reduce(self.rank()[0])
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

    def _extend(self, centre: EvidenceFit) -> None:
        """Refit the most promising additions to a set."""
        proposals = self._list_promising(centre)

        def refit_proposal(proposal: Proposal) -> EvidenceFit:
            values = centre.values
            for candidate, amplitudes in proposal.additions:
                values = switch_on_candidate(self.problem, values, candidate, amplitudes)
            added = tuple(candidate for candidate, _ in proposal.additions)
            return self.refit((*centre.mechanisms, *added), values, centre.noise)

        for fit in parallel_map(refit_proposal, proposals):
            self._register(fit)

    def _list_promising(self, centre: EvidenceFit) -> list[Proposal]:
        """Return the best proposal of each set that has not been refitted, most promising first."""
        proposals = propose_additions(
            self.problem, centre.noise, centre.estimate, centre.ids, self.candidates, self.coordinates,
            self.settings,
        )  # fmt: skip
        shortfall = self.rank()[0].evidence.total - centre.evidence.total
        best_gain = max((proposal.gain for proposal in proposals), default=0.0)
        limit = max(min(MIN_GAIN_SHARE * best_gain, best_gain - MAX_SHORTFALL), shortfall - MAX_SHORTFALL)
        listed: dict[frozenset[str], Proposal] = {}
        for proposal in proposals:
            ids = centre.ids | proposal.ids
            if proposal.gain > limit and ids not in self.fits:
                listed.setdefault(ids, proposal)
        return list(listed.values())[:REFITS_PER_CENTRE]

    def _reduce(self, fit: EvidenceFit) -> None:
        """Refit a set without each of its mechanisms."""
        if len(fit.mechanisms) < 2:
            return

        def refit_without(candidate: Candidate) -> EvidenceFit:
            remaining = tuple(other for other in fit.mechanisms if other is not candidate)
            return self.refit(remaining, switch_off_candidate(self.problem, fit.values, candidate), fit.noise)

        unknown = [candidate for candidate in fit.mechanisms if fit.ids - {candidate.id} not in self.fits]
        for reduced in parallel_map(refit_without, unknown):
            self._register(reduced)

    def _register(self, fit: EvidenceFit) -> None:
        known = self.fits.get(fit.ids)
        if known is None or fit.evidence.total > known.evidence.total:
            self.fits[fit.ids] = fit

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
        if (best := evidence.best_template) is not None:
            sized.append(_free_columns(self.template_columns[best]))
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
            templates=self.template_columns,
            template_shares=[template.share / self.family_count for template in self.templates],
        )


def _free_columns(columns: np.ndarray) -> np.ndarray:
    """Return columns scaled to a prior that leaves them free."""
    information = np.maximum(np.einsum("ij,ij->i", columns, columns), 1e-300)
    return columns * (TEMPLATE_SD * np.sqrt(columns.shape[1] / information))[:, None]


def _compute_rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0

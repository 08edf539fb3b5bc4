"""Search of the sets of mechanisms with the largest evidence.

It begins with the baseline alone. At the best sets, linear algebra proposes additions of one or two
mechanisms (`proposals.py`). The most promising are refitted in full, with their form errors, and so is each
set without one of its mechanisms. There are two searches: the first assumes that nothing outside the library
is present, the second allows for it. Each ends when its best set has been extended.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.evidence.columns import (
    build_form_columns,
    build_generic_families,
    compute_effect_of,
    stack_whitened,
    whiten_generic_families,
)
from pamjax.diagnosis.evidence.coordinates import Coordinates
from pamjax.diagnosis.evidence.discrepancy import DiscrepancyNoise, add_discrepancy
from pamjax.diagnosis.evidence.marginal_likelihood import (
    Evidence,
    LinearModel,
    OutsideColumns,
    compute_evidence,
)
from pamjax.diagnosis.evidence.proposals import Proposal, propose_additions
from pamjax.diagnosis.evidence.settings import EvidenceSettings
from pamjax.diagnosis.evidence.templates import Template
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
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.progress import Progress, ignore_progress

#: Sets whose additions are proposed, without physics outside the library and with it.
MAX_CENTRES = (5, 2)
#: Additions of one and of two mechanisms that are refitted at each set, and how many of them to the end.
SINGLES_PER_CENTRE, PAIRS_PER_CENTRE, COMPLETE_REFITS = 5, 2, 3
#: A proposal is refitted if it promises this share of the best gain, or a total within this of the best set.
MIN_GAIN_SHARE, MAX_SHORTFALL = 0.6, 8.0
#: Evaluations of a first refit, and of each further one: a form error changes with its mechanism.
FIRST_EVALUATIONS, REFIT_EVALUATIONS = (6,), (20, 20)
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
        noise: noise with the form errors at their most probable sizes, and with what is most probable outside
            the library.
        form_noise: the same without physics outside the library.
        evidence: of the set.
        form_ratios: rms of the estimated form error over the rms of the effect, by mechanism.
        form_prediction: (2, n) estimated form errors of all mechanisms, SI.
    """

    mechanisms: tuple[Candidate, ...]
    estimate: MapEstimate
    noise: DiscrepancyNoise
    form_noise: DiscrepancyNoise
    evidence: Evidence
    form_ratios: dict[str, float]
    form_prediction: np.ndarray

    @property
    def ids(self) -> frozenset[str]:
        return frozenset(candidate.id for candidate in self.mechanisms)

    @property
    def prefers_outside(self) -> bool:
        """Whether something outside the library is more probable than its absence."""
        return self.evidence.best_template is not None or self.evidence.prefers_generic

    @property
    def overdispersion(self) -> float:
        """Mean square of the whitened residual, at least 1: differences of ln Z count that much less."""
        return max(self.estimate.chi2 / max(self.estimate.residual.size, 1), 1.0)

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
        self.templates = templates
        families = len({template.id for template in templates})
        self.outside = OutsideColumns(
            *whiten_generic_families(noise, build_generic_families(problem, self.coordinates)),
            templates=stack_whitened(noise, [template.columns for template in templates]),
            template_shares=[template.share / families for template in templates],
        )
        self.fits: dict[frozenset[str], EvidenceFit] = {}
        self.alone: dict[frozenset[str], EvidenceFit] = {}
        self._register(self.refit((), values, outside=False))

    def run(self, progress: Progress = ignore_progress) -> list[EvidenceFit]:
        """Return all sets that were tried, largest evidence first."""
        for k, outside in enumerate((False, True)):
            expanded_ids: set[frozenset[str]] = set()
            for _ in range(MAX_CENTRES[k]):
                centre = self._get_leading(outside)
                if centre.ids in expanded_ids or (outside and not centre.prefers_outside):
                    break
                progress("selecting mechanisms", 0.1 + 0.35 * (k + len(expanded_ids) / MAX_CENTRES[k]))
                expanded_ids.add(centre.ids)
                self._extend(centre, outside)
                self._reduce(self._get_leading(outside), outside)
        return self.rank()

    def _get_leading(self, outside: bool) -> EvidenceFit:
        """Return the best set, with physics outside the library or without."""
        return self.rank()[0] if outside else max(self.alone.values(), key=lambda fit: fit.evidence.alone)

    def rank(self) -> list[EvidenceFit]:
        """Return the sets tried so far, largest evidence first."""
        return sorted(self.fits.values(), key=lambda fit: -fit.evidence.total)

    def refit(
        self,
        mechanisms: Sequence[Candidate],
        values: np.ndarray,
        noise: NoiseModel | None = None,
        outside: bool = True,
        rounds: Sequence[int] = REFIT_EVALUATIONS,
    ) -> EvidenceFit:
        """Return a set refitted from starting values (p,), SI, with the form errors at its estimate.

        Args:
            mechanisms: the candidates in the set.
            values: (p,) starting values, SI.
            noise: noise of the first refit; that of the recording if omitted.
            outside: whether physics outside the library, if it is probable, is part of the noise.
            rounds: evaluations of each refit; the form errors are computed again after each.
        """
        free, fit = get_free_indices(self.problem, mechanisms), None
        for evaluations in rounds if mechanisms else rounds[:1]:
            noise = noise or self.noise
            values = fit_parameters(self.problem, noise, free, values, evaluations).values
            fit = self._evaluate(tuple(mechanisms), free, values)
            noise = fit.noise if outside else fit.form_noise
        assert fit is not None
        return fit

    def _extend(self, centre: EvidenceFit, outside: bool) -> None:
        """Refit the most promising additions to a set."""
        noise = centre.noise if outside else centre.form_noise

        def refit_proposal(proposal: Proposal) -> EvidenceFit:
            values = centre.values
            for candidate, amplitudes in proposal.additions:
                values = switch_on_candidate(self.problem, values, candidate, amplitudes)
            new_candidates = tuple(candidate for candidate, _ in proposal.additions)
            return self.refit(
                (*centre.mechanisms, *new_candidates), values, noise, outside, FIRST_EVALUATIONS
            )

        def complete(fit: EvidenceFit) -> EvidenceFit:
            return self.refit(fit.mechanisms, fit.values, fit.noise if outside else fit.form_noise, outside)

        trials = parallel_map(refit_proposal, self._list_promising(centre, outside))
        trials.sort(key=lambda fit: -(fit.evidence.total if outside else fit.evidence.alone))
        # Far from the minimum the evidence of the linear model is too large: only complete fits are compared.
        for fit in parallel_map(complete, trials[:COMPLETE_REFITS]):
            self._register(fit)

    def _list_promising(self, centre: EvidenceFit, outside: bool) -> list[Proposal]:
        """Return the best proposal of each set that has not been refitted, most promising first."""
        noise = centre.noise if outside else centre.form_noise
        proposals = propose_additions(
            self.problem,
            noise,
            evaluate_estimate(self.problem, noise, centre.estimate.free, centre.values),
            centre.ids,
            self.candidates,
            self.coordinates,
            self.settings,
        )
        best_gain = max((proposal.gain for proposal in proposals), default=0.0)
        limit = max(min(MIN_GAIN_SHARE * best_gain, best_gain - MAX_SHORTFALL), -MAX_SHORTFALL)
        known_fits = self.fits if outside else self.alone
        first_proposals: dict[tuple[str, ...], Proposal] = {}
        for proposal in proposals:
            if proposal.gain > limit and centre.ids | proposal.ids not in known_fits:
                # One shape of each mechanism for each set of free parameters.
                first_proposals.setdefault(proposal.free_parameters, proposal)
        singles = [proposal for proposal in first_proposals.values() if len(proposal.ids) == 1]
        pairs = [proposal for proposal in first_proposals.values() if len(proposal.ids) == 2]
        return singles[:SINGLES_PER_CENTRE] + pairs[:PAIRS_PER_CENTRE]

    def _reduce(self, fit: EvidenceFit, outside: bool) -> None:
        """Refit a set without each of its mechanisms."""
        if len(fit.mechanisms) < 2:
            return
        known_fits = self.fits if outside else self.alone
        untried_candidates = [
            candidate for candidate in fit.mechanisms if fit.ids - {candidate.id} not in known_fits
        ]
        for smaller_fit in parallel_map(
            lambda candidate: self.refit_without(fit, candidate, outside), untried_candidates
        ):
            self._register(smaller_fit)

    def refit_without(self, fit: EvidenceFit, candidate: Candidate, outside: bool = True) -> EvidenceFit:
        """Return a set without one of its mechanisms, refitted."""
        remaining = tuple(other for other in fit.mechanisms if other is not candidate)
        values = switch_off_candidate(self.problem, fit.values, candidate)
        return self.refit(remaining, values, fit.noise if outside else fit.form_noise, outside)

    def _register(self, fit: EvidenceFit) -> None:
        known_fit, known_alone = self.fits.get(fit.ids), self.alone.get(fit.ids)
        if known_fit is None or fit.evidence.total > known_fit.evidence.total:
            self.fits[fit.ids] = fit
        if known_alone is None or fit.evidence.alone > known_alone.evidence.alone:
            self.alone[fit.ids] = fit

    def _evaluate(
        self, mechanisms: tuple[Candidate, ...], free: list[int], values: np.ndarray
    ) -> EvidenceFit:
        problem, noise = self.problem, self.noise
        columns = [build_form_columns(problem, self.coordinates, values, m) for m in mechanisms]
        forms = [
            white if white.shape[1] else np.zeros((0, noise.size)) for white in stack_whitened(noise, columns)
        ]
        evidence = compute_evidence(self._linearise(free, values, forms), len(mechanisms), self.settings)
        form_columns = [np.zeros((0, noise.size))]
        form_columns += [block * share for block, share in zip(forms, evidence.form_shares, strict=True)]
        with_outside = add_discrepancy(noise, np.concatenate([*form_columns, self._size_outside(evidence)]))
        coefficients = evidence.form_coefficients
        predictions = [
            np.einsum("r,rcn->cn", c, block) for c, block in zip(coefficients, columns, strict=True)
        ]
        return EvidenceFit(
            mechanisms=mechanisms,
            estimate=evaluate_estimate(problem, with_outside, free, values),
            noise=with_outside,
            form_noise=add_discrepancy(noise, np.concatenate(form_columns)),
            evidence=evidence,
            form_ratios={
                m.id: self._compute_form_ratio(values, m, c @ white)
                for m, c, white in zip(mechanisms, coefficients, forms, strict=True)
                if len(white)
            },
            form_prediction=np.sum([np.zeros((len(CHANNELS), problem.n)), *predictions], axis=0),
        )

    def _size_outside(self, evidence: Evidence) -> np.ndarray:
        """Return the columns of what is most probable outside the library, times their prior sd."""
        if (template := evidence.best_template) is not None:
            return _free_columns(self.outside.templates[template])
        if not evidence.prefers_generic:
            return np.zeros((0, self.noise.size))
        used = evidence.generic_sd > 0
        return self.outside.generic[used] * evidence.generic_sd[used, None]

    def _compute_form_ratio(self, values: np.ndarray, candidate: Candidate, form: np.ndarray) -> float:
        """Return the rms of the form error over that of the effect, which has what is parallel to it."""
        effect = np.nan_to_num(self.noise.whiten(compute_effect_of(self.problem, values, candidate)))
        square = float(effect @ effect)
        parallel = float(form @ effect) / square if square > 0 else 0.0
        return _compute_rms(form - parallel * effect) / max(_compute_rms((1 + parallel) * effect), 1e-12)

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
            outside=self.outside,
        )


def _free_columns(columns: np.ndarray) -> np.ndarray:
    """Return columns scaled to a prior that leaves them free."""
    information = np.maximum(np.einsum("ij,ij->i", columns, columns), 1e-300)
    return columns * (TEMPLATE_SD * np.sqrt(columns.shape[1] / information))[:, None]


def _compute_rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0

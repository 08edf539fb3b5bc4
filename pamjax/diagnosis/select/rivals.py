"""Rivals of a mechanism: other mechanisms in its place, and the probabilities that follow.

A rival that fits as well is reported as indistinguishable. A rival that fits nearly as well reduces the
probability.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.form_errors.fit import add_form_errors
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import evaluate_estimate
from pamjax.diagnosis.refit.model_fit import ModelFit, switch_off_candidate
from pamjax.diagnosis.select.mechanism_refits import (
    compute_rough_limit,
    fit_replacements,
    fit_without_mechanism,
    refit_fully,
)


@dataclass(frozen=True, eq=False)
class RivalFit:
    """Refit of a model with a rival in the place of one of its mechanisms.

    Attributes:
        probability: probability that the rival is present instead.
        candidate: the rival, with its best starting values.
        values: (p,) refitted parameter values, SI.
    """

    probability: float
    candidate: Candidate
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class NamedMechanism:
    """An identified mechanism: a mechanism of the selected model, with its probability.

    Attributes:
        id: id of the mechanism.
        probability: probability that it, or one indistinguishable from it, is present.
        indistinguishable: ids of the mechanisms that explain this recording as well.
        chi2_increase: increase of χ² without it, after a refit.
        rival_bic_increase: increase of the BIC, with form errors, by each rival in its place.
        form_error: rms of its form error over the rms of its effect; None if its equation has none.
        indistinguishable_fits: the refit with each indistinguishable rival.
    """

    id: str
    probability: float
    indistinguishable: tuple[str, ...]
    chi2_increase: float
    rival_bic_increase: dict[str, float] = field(default_factory=dict)
    form_error: float | None = None
    indistinguishable_fits: tuple[RivalFit, ...] = ()


@dataclass(frozen=True, eq=False)
class _Rival:
    """A model with a rival in the place of a mechanism, compared with the model with this mechanism.

    Attributes:
        fit: the model with the rival.
        bic_increase: increase of the BIC by the rival, with form errors.
        weight: its odds against the mechanism, at most one.
        is_indistinguishable: whether it explains the recording as well.
    """

    fit: ModelFit
    bic_increase: float
    weight: float
    is_indistinguishable: bool

    @property
    def candidate(self) -> Candidate:
        """Return the rival."""
        return self.fit.mechanisms[-1]


def assess_mechanisms(
    problem: LibraryProblem, fit: ModelFit, candidates: Sequence[Candidate]
) -> tuple[NamedMechanism, ...]:
    """Return the mechanisms of a model with their probabilities and rivals.

    Args:
        problem: the recording and the library.
        fit: the fitted model.
        candidates: candidates of the rivals.
    """
    numbers = range(len(fit.mechanisms))
    rivals = parallel_map(lambda k: _find_rivals(problem, fit, k, candidates), numbers)
    return tuple(_assess_mechanism(problem, fit, k, rivals[k]) for k in numbers)


def _assess_mechanism(
    problem: LibraryProblem, fit: ModelFit, k: int, rivals: Sequence[_Rival]
) -> NamedMechanism:
    tied = [rival for rival in rivals if rival.is_indistinguishable]
    tied_weight = sum(rival.weight for rival in tied)
    return NamedMechanism(
        fit.mechanisms[k].id,
        compute_probability(
            sum(rival.weight for rival in rivals), tied_weight, problem.settings.unknown_rival_weight
        ),
        tuple(rival.candidate.id for rival in tied),
        float(fit_without_mechanism(problem, fit, k).corrected_chi2 - fit.corrected_chi2),
        {rival.candidate.id: rival.bic_increase for rival in rivals},
        indistinguishable_fits=tuple(
            RivalFit(rival.weight / (1 + tied_weight), rival.candidate, rival.fit.estimate.values)
            for rival in tied
        ),
    )


def _find_rivals(
    problem: LibraryProblem, fit: ModelFit, k: int, candidates: Sequence[Candidate]
) -> list[_Rival]:
    """Return the rivals of the k-th mechanism of a model."""
    settings, reduced_fit = problem.settings, fit_without_mechanism(problem, fit, k)
    trials = _fit_rivals(problem, fit, reduced_fit, fit.mechanisms[k], candidates)
    # Refit rivals with a low BIC to the minimum; the rough refits of the others are sufficient.
    limit = max(fit.bic + settings.rough_chi2_margin, compute_rough_limit(reduced_fit, fit))
    close_trials = sorted((trial for trial in trials if trial.bic < limit), key=lambda trial: trial.bic)
    close_fits = refit_fully(problem, close_trials[: settings.final_refit_count])
    fit_by_id = {m.mechanisms[-1].id: m for m in [*trials, *close_fits]}
    return _compare(problem, fit, list(fit_by_id.values()))


def _compare(problem: LibraryProblem, fit: ModelFit, rival_fits: Sequence[ModelFit]) -> list[_Rival]:
    """Return rivals, compared with a model.

    Real effects depart from their equations: a rival must explain more than these form errors. The misfit
    beyond form errors widens the scale of the comparison.
    """
    settings, form_fit = problem.settings, add_form_errors(problem, fit)
    tie_limit = settings.tie_chi2 + settings.tie_excess_share * form_fit.excess_chi2
    scale = 1 + form_fit.excess_chi2 / settings.comparison_excess_chi2
    increases = [add_form_errors(problem, m).full_bic - form_fit.full_bic for m in rival_fits]
    return [
        _Rival(m, increase, float(np.exp(-0.5 * max(increase, 0.0) / scale)), increase < tie_limit)
        for m, increase in zip(rival_fits, increases, strict=True)
    ]


def _fit_rivals(
    problem: LibraryProblem,
    fit: ModelFit,
    reduced_fit: ModelFit,
    candidate: Candidate,
    candidates: Sequence[Candidate],
) -> list[ModelFit]:
    """Return models with a rival in the place of a candidate, roughly refitted: the better of two starts.

    The refit without the candidate can be far from the fit: other mechanisms then absorb its effect. The
    values of the fit are the second start.
    """
    values = switch_off_candidate(problem, fit.estimate.values, candidate)
    at_fit = replace(
        reduced_fit, estimate=evaluate_estimate(problem, fit.noise, reduced_fit.estimate.free, values)
    )
    best: dict[str, ModelFit] = {}
    for start in (reduced_fit, at_fit):
        for trial in fit_replacements(problem, start, candidate, candidates):
            id = trial.mechanisms[-1].id
            if id not in best or trial.bic < best[id].bic:
                best[id] = trial
    return list(best.values())


def compute_probability(rival_weight: float, tied_weight: float, unknown_weight: float) -> float:
    """Return the probability that a mechanism, or one indistinguishable from it, is present.

    Args:
        rival_weight: sum of the weights of all rivals, relative to the mechanism.
        tied_weight: sum of the weights of the indistinguishable ones.
        unknown_weight: weight of physics outside the library, relative to the mechanism or one of these.

    >>> round(compute_probability(1.25, 1.0, 0.0), 3), round(compute_probability(0.0, 0.0, 0.1), 3)
    (0.889, 0.909)
    """
    return float(1 / ((1 + rival_weight) / (1 + tied_weight) + unknown_weight))

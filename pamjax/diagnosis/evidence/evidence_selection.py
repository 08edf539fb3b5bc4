"""The choice by evidence as the selection that a diagnosis reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from scipy.special import softmax

from pamjax.diagnosis.crossval.gain import compute_rmse
from pamjax.diagnosis.evidence.evidence_search import EvidenceFit, EvidenceSearch
from pamjax.diagnosis.evidence.settings import EvidenceSettings
from pamjax.diagnosis.evidence.summary import EvidenceName, summarise
from pamjax.diagnosis.evidence.templates import TemplateContext, build_templates
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import COMPLIANCE_PARAMETER, LibraryProblem
from pamjax.diagnosis.noise.estimate import estimate_noise
from pamjax.diagnosis.refit.candidate_fit import (
    CandidateFit,
    get_free_indices,
    predict_fit,
    switch_off_candidate,
)
from pamjax.diagnosis.refit.least_squares import evaluate_estimate, fit_parameters
from pamjax.diagnosis.result import Likeness
from pamjax.diagnosis.select.selection import NamedMechanism, Selection
from pamjax.infer.noise.sensor_noise import compute_sensitivities
from pamjax.progress import Progress, ignore_progress
from pamjax.records.blocks import Blocks

#: Increase of the held-out error by a mechanism from which it is not named.
MAX_HELD_OUT_RATIO = 1.01

#: Probability from which a likeness is reported.
MIN_LIKENESS = 0.05

#: Parameters that describe the stiffness of the threads; each baseline has one of them.
STIFFNESS_PARAMETERS = ("thread.modulus", "thread.stiffness", COMPLIANCE_PARAMETER)


def select_by_evidence(
    problem: LibraryProblem,
    blocks: Blocks,
    training_rows: np.ndarray,
    baseline: CandidateFit,
    progress: Progress = ignore_progress,
    settings: EvidenceSettings | None = None,
) -> tuple[Selection, float, tuple[Likeness, ...]]:
    """Return the mechanisms with the largest evidence, and the probability and likeness of other physics.

    Args:
        problem: the recording and the library.
        blocks: its isobars, holds or cycles.
        training_rows: (n,) mask of the rows in use; the others decide whether a mechanism predicts better.
        baseline: refit of the baseline to these rows.
        progress: called with what is being done and the share done.
        settings: prior probabilities and thresholds.
    """
    settings = settings or EvidenceSettings(established_probability=problem.settings.established_probability)
    templates = build_templates(build_template_context(problem, blocks, baseline))
    excess = max(baseline.estimate.chi2 / max(baseline.noise.size, 1) - 1, 0.0)
    search = EvidenceSearch(
        problem, baseline.noise, baseline.estimate.values, _limit_generic_sizes(settings, excess), templates
    )
    summary = summarise(search.run(progress), settings, excess)
    names = {name.id: name for name in summary.names}
    fit = _restrict(search, summary.best, names)
    while (harmful := _find_most_harmful(search, fit, ~training_rows)) is not None:
        names.pop(harmful)
        fit = _restrict(search, fit, names)
    return (
        Selection(
            baseline,
            to_tested_fit(problem, fit),
            tuple(_describe(search, fit, name) for name in summary.names if name.id in names),
        ),
        summary.unexplained_probability,
        list_likenesses(search, fit),
    )


def _limit_generic_sizes(settings: EvidenceSettings, excess: float) -> EvidenceSettings:
    """Return the settings with sizes of generic physics that do not exceed the misfit of the baseline.

    Larger physics could only cancel a mechanism that is too large.
    """
    limit = max(np.sqrt(excess), min(settings.generic_sizes))
    sizes = tuple(size for size in settings.generic_sizes if size <= limit)
    return replace(settings, generic_sizes=sizes)


def list_likenesses(search: EvidenceSearch, fit: EvidenceFit) -> tuple[Likeness, ...]:
    """Return the families of templates that the part outside the library resembles, most probable first."""
    log_evidence = np.append(fit.evidence.with_templates, fit.evidence.with_generic)
    probabilities = softmax(log_evidence)[:-1]
    best: dict[str, tuple[float, str]] = {}
    for k in np.argsort(-probabilities):
        template = search.templates[k]
        total = sum(
            float(p)
            for p, other in zip(probabilities, search.templates, strict=True)
            if other.id == template.id
        )
        best.setdefault(template.id, (total, template.description))
    likely = [Likeness(id, *pair) for id, pair in best.items() if pair[0] >= MIN_LIKENESS]
    return tuple(sorted(likely, key=lambda likeness: -likeness.probability))


def fit_with_form_errors(
    problem: LibraryProblem, rows: np.ndarray, mechanisms: Sequence[Candidate], values: np.ndarray
) -> CandidateFit:
    """Return the baseline with some mechanisms and their form errors, refitted to some rows (n,)."""
    neutral = values
    for candidate in mechanisms:
        neutral = switch_off_candidate(problem, neutral, candidate)
    baseline = fit_baseline(problem, rows, neutral)
    search = EvidenceSearch(problem, baseline.noise, baseline.estimate.values, EvidenceSettings())
    return to_candidate_fit(search.refit(mechanisms, values))


def fit_baseline(problem: LibraryProblem, rows: np.ndarray, values: np.ndarray) -> CandidateFit:
    """Return the baseline refitted to some rows (n,), with the noise that neighbouring samples show."""
    free = get_free_indices(problem, ())
    for _ in range(2):
        noise = estimate_noise(problem, values, rows, free_scale=True)
        estimate = fit_parameters(problem, noise, free, values)
        values = estimate.values
    return CandidateFit((), noise, estimate)


def build_template_context(
    problem: LibraryProblem, blocks: Blocks, baseline: CandidateFit
) -> TemplateContext:
    """Return what the templates depend on, at the estimate of the baseline."""
    values = baseline.estimate.values
    prediction = problem.predict(values)
    by_pressure, by_length = (
        np.nan_to_num(np.asarray(s)[0, : problem.n])
        for s in compute_sensitivities(problem.dataset, jnp.asarray(values))
    )
    residual = np.nan_to_num(problem.measured[0] - prediction[0])
    stiffness = next(name for name in STIFFNESS_PARAMETERS if name in problem.names)
    by_stiffness = problem.jacobian(values, [problem.index(stiffness)])[1][0]
    return TemplateContext(problem, blocks, prediction, residual, by_pressure, by_length, by_stiffness)


def to_candidate_fit(fit: EvidenceFit) -> CandidateFit:
    """Return a set of mechanisms as the fit that reports take."""
    return CandidateFit(fit.mechanisms, fit.noise, fit.estimate, form_prediction=fit.form_prediction)


def to_tested_fit(problem: LibraryProblem, fit: EvidenceFit) -> CandidateFit:
    """Return a set of mechanisms as the fit whose residual is tested, without physics outside the library."""
    estimate = evaluate_estimate(problem, fit.form_noise, fit.estimate.free, fit.values)
    return CandidateFit(fit.mechanisms, fit.form_noise, estimate, form_prediction=fit.form_prediction)


def _restrict(search: EvidenceSearch, fit: EvidenceFit, names: dict[str, EvidenceName]) -> EvidenceFit:
    """Return the set with the named mechanisms only."""
    kept_candidates = tuple(candidate for candidate in fit.mechanisms if candidate.id in names)
    if len(kept_candidates) == len(fit.mechanisms):
        return fit
    known_fit = search.fits.get(frozenset(names))
    if known_fit is not None:
        return known_fit
    values = fit.values
    for candidate in fit.mechanisms:
        if candidate not in kept_candidates:
            values = switch_off_candidate(search.problem, values, candidate)
    return search.refit(kept_candidates, values)


def _find_most_harmful(search: EvidenceSearch, fit: EvidenceFit, held_out_rows: np.ndarray) -> str | None:
    """Return the mechanism without which held-out rows are predicted best; None if none makes them worse.

    Mechanisms can make the prediction worse alone, or only together: then the baseline predicts better.
    """
    if not held_out_rows.any() or not fit.mechanisms:
        return None
    without = {
        candidate.id: _compute_error(
            search,
            search.fits.get(fit.ids - {candidate.id}) or search.refit_without(fit, candidate),
            held_out_rows,
        )
        for candidate in fit.mechanisms
    }
    baseline = _compute_error(search, search.fits[frozenset()], held_out_rows)
    if _compute_error(search, fit, held_out_rows) <= MAX_HELD_OUT_RATIO * min(baseline, *without.values()):
        return None
    return min(without, key=lambda id: without[id])


def _compute_error(search: EvidenceSearch, fit: EvidenceFit, rows: np.ndarray) -> float:
    """Return the rms error over the noise on some rows, both channels together."""
    rmse = compute_rmse(search.problem, predict_fit(search.problem, to_candidate_fit(fit)), rows)
    sds = [float(np.mean(channel.sd)) if channel is not None else np.inf for channel in search.noise.channels]
    ratios = [rmse[name] / sd for name, sd in zip(("force", "diameter"), sds, strict=True) if name in rmse]
    return float(np.sqrt(np.mean(np.square(ratios)))) if ratios else 0.0


def _describe(search: EvidenceSearch, fit: EvidenceFit, name: EvidenceName) -> NamedMechanism:
    others = fit.ids - {name.id}

    def lose(ids: frozenset[str]) -> float:
        other = search.fits.get(ids)
        return float("inf") if other is None else 2 * (fit.evidence.total - other.evidence.total)

    rivals = {
        next(iter(other.ids - others)): lose(other.ids)
        for other in search.fits.values()
        if other.ids > others and len(other.ids) == len(fit.ids) and name.id not in other.ids
    }
    return NamedMechanism(
        name.id, name.probability, name.indistinguishable, lose(others), rivals, name.form_ratio
    )

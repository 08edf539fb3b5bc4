"""Names, their probabilities and ties, from the evidence of all sets that were tried."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import softmax

from pamjax.diagnosis.evidence.evidence_search import EvidenceFit
from pamjax.diagnosis.evidence.settings import EvidenceSettings


@dataclass(frozen=True)
class EvidenceName:
    """A mechanism of the most probable set.

    Attributes:
        id: the mechanism.
        probability: that it, or one that is indistinguishable from it, is present.
        indistinguishable: ids that explain this recording nearly as well in its place.
        form_ratio: rms of its form error over the rms of its effect; None without form error.
    """

    id: str
    probability: float
    indistinguishable: tuple[str, ...]
    form_ratio: float | None


@dataclass(frozen=True, eq=False)
class EvidenceSummary:
    """The result of a choice by evidence.

    Attributes:
        best: the most probable set.
        names: its established mechanisms, most probable first.
        unexplained_probability: that physics is present which no mechanism describes.
    """

    best: EvidenceFit
    names: tuple[EvidenceName, ...]
    unexplained_probability: float


def summarise(
    fits: Sequence[EvidenceFit], settings: EvidenceSettings, baseline_excess: float = 0.0
) -> EvidenceSummary:
    """Return names and probabilities.

    Args:
        fits: all sets that were tried, largest evidence first.
        settings: thresholds.
        baseline_excess: mean square of the baseline's whitened residual above that of noise.
    """
    best = fits[0]
    log_weights = np.array([fit.evidence.total for fit in fits]) / best.overdispersion
    weights = softmax(log_weights)
    smallest = settings.min_outside_share * baseline_excess
    outside = [
        weight * fit.evidence.outside_probability
        for fit, weight in zip(fits, weights, strict=True)
        if fit.evidence.outside_mean_square > smallest
    ]
    names, rejected_probability = [], 0.0
    for candidate in best.mechanisms:
        ties = _find_ties(fits, best, candidate.id, settings)
        group = {candidate.id, *ties}
        probability = float(sum(w for fit, w in zip(fits, weights, strict=True) if fit.ids & group))
        ratio = best.form_ratios.get(candidate.id)
        if ratio is not None and ratio > settings.max_form_share:
            rejected_probability = max(rejected_probability, probability)
        elif probability >= settings.established_probability:
            names.append(EvidenceName(candidate.id, probability, ties, ratio))
    return EvidenceSummary(
        best=best,
        names=tuple(sorted(names, key=lambda name: -name.probability)),
        unexplained_probability=float(max(sum(outside), rejected_probability)),
    )


def _find_ties(
    fits: Sequence[EvidenceFit], best: EvidenceFit, id: str, settings: EvidenceSettings
) -> tuple[str, ...]:
    """Return the ids that can replace one of the best set at little loss of evidence."""
    limit = best.evidence.total + best.overdispersion * np.log(settings.tie_probability_ratio)
    others = best.ids - {id}
    return tuple(
        next(iter(fit.ids - others))
        for fit in fits
        if fit.ids > others
        and len(fit.ids) == len(best.ids)
        and id not in fit.ids
        and fit.evidence.total > limit
    )

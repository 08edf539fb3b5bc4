"""Errors on held-out rows with each mechanism, relative to those without it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.model_fit import ModelFit, fit_model, switch_off_candidate
from pamjax.diagnosis.select.selection import Selection, restrict_selection
from pamjax.text import join_words


def compute_held_out_ratios(
    problem: LibraryProblem,
    training_mask: np.ndarray,
    mechanisms: Sequence[Candidate],
    values: np.ndarray,
) -> dict[str, float]:
    """Return by id the held-out error with a mechanism over that without it; empty without readings there.

    Both models are refitted to the training rows. The error is the rms over force and diameter in noise
    standard deviations, without form errors. Above one, the mechanism makes the prediction worse.

    Args:
        problem: the recording and the library.
        training_mask: (n,) whether a row is used in the fits; the others are held out.
        mechanisms: all mechanisms of the model.
        values: (p,) starting values of the refits, SI.
    """
    if not mechanisms or not np.isfinite(problem.measured[:, ~training_mask]).any():
        return {}
    full = fit_model(problem, training_mask, mechanisms, values)
    error, ratios = _compute_held_out_error(problem, full, full, ~training_mask), {}
    for candidate in mechanisms:
        others = [other for other in mechanisms if other.id != candidate.id]
        start = switch_off_candidate(problem, full.estimate.values, candidate)
        without = fit_model(problem, training_mask, others, start)
        ratios[candidate.id] = error / max(
            _compute_held_out_error(problem, without, full, ~training_mask), 1e-12
        )
    return ratios


def drop_harmful_mechanisms(
    problem: LibraryProblem, training_mask: np.ndarray, selection: Selection
) -> Selection:
    """Return the selection without the mechanisms that increase the error on held-out rows.

    The most harmful one is dropped first, and the others are tested again.
    """
    while selection.named_mechanisms:
        ratios = compute_held_out_ratios(
            problem, training_mask, selection.model.mechanisms, selection.start_values
        )
        worst = max(ratios, key=lambda id: ratios[id], default=None)
        if worst is None or ratios[worst] <= 1:
            break
        others = [mechanism for mechanism in selection.named_mechanisms if mechanism.id != worst]
        selection = restrict_selection(problem, training_mask, selection, others)
    return selection


def format_harmful_mechanisms(selection: Selection, remaining: Selection) -> list[str]:
    """Return a note on the mechanisms that `drop_harmful_mechanisms` dropped, if there are any."""
    ids = {mechanism.id for mechanism in remaining.named_mechanisms}
    dropped = [f"`{m.id}`" for m in selection.named_mechanisms if m.id not in ids]
    if not dropped:
        return []
    is_not, it_increases = ("is not", "it increases") if len(dropped) == 1 else ("are not", "they increase")
    return [f"{join_words(dropped)} {is_not} reported: {it_increases} the error of the held-out rows."]


def _compute_held_out_error(
    problem: LibraryProblem, fit: ModelFit, reference: ModelFit, rows: np.ndarray
) -> float:
    """Return the rms of a fit over some rows in the noise sd of a reference fit."""
    misfit = problem.measured - problem.predict(fit.estimate.values)
    parts = [
        (misfit[c] / channel.sd)[rows]
        for c, channel in enumerate(reference.noise.by_channel)
        if channel is not None
    ]
    return float(np.sqrt(np.nanmean(np.concatenate(parts) ** 2)))

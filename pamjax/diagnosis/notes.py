"""Notes of a diagnosis: parameters at their limits, mechanisms not tested, parameters not determined.

The refit of the baseline has the Jacobian J of the whitened samples and the priors. A combination of
parameters is not determined by the data if JᵀJ has less information on it than the prior. A change of such a
combination can hide missing physics, or look like it.
"""

from __future__ import annotations

import numpy as np

from pamjax.diagnosis.estimates import build_parameter_estimate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import find_parameters_at_limit
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.infer.fitting.case_summary import EFFECTS_OVER_TIME
from pamjax.infer.fitting.determination import compute_prior_scale, describe_few_rows
from pamjax.infer.fitting.identifiability import (
    find_undetermined_combinations,
    format_combination,
)
from pamjax.infer.fitting.report import MAX_PRIOR_SHIFT_SD, describe_prior, format_contradicted_value
from pamjax.infer.problem.priors import is_length_error
from pamjax.model.parameters import find_meaning
from pamjax.text import join_words

#: By parameter that states a difference between both directions: the sensor error that resembles it, and what
#: tells them apart.
_RESEMBLANCES = {
    "viscous_damping.asymmetry": (
        "force_offset",
        "At a constant speed, an even damper with a zero error of the force (`force_offset`) predicts the"
        " same. Check the zero of the load cell, or repeat a stroke at another speed.",
    ),
    "braid_friction.asymmetry": (
        "length_offset",
        "While the threads slide, even friction with an error of the length (`length_offset`) predicts nearly"
        " the same. Check the length, or record the rows after a reversal at smaller steps.",
    ),
}


def format_notes(problem: LibraryProblem, baseline: ModelFit, fit: ModelFit) -> list[str]:
    """Return all notes: few rows and parameters at their limits first.

    Args:
        problem: the recording and the library.
        baseline: the refitted baseline.
        fit: the refitted baseline with the identified mechanisms; the baseline itself without any.
    """
    return [
        *format_few_rows(problem, fit),
        *format_parameters_at_limit(problem, fit),
        *format_asymmetry(problem, fit),
        *format_untestable_mechanisms(problem),
        *format_unidentified_combinations(problem, baseline, fit),
    ]


def format_few_rows(problem: LibraryProblem, fit: ModelFit) -> list[str]:
    """Return a note if a model with mechanisms has many parameters for the rows of the recording.

    Args:
        problem: the recording and the library.
        fit: the refitted baseline with the identified mechanisms.
    """
    if not fit.mechanisms:
        return []
    row_count = int(np.isfinite(problem.measured).any(axis=0).sum())
    warning = describe_few_rows(row_count, len(fit.estimate.free))
    return [warning] if warning else []


def format_parameters_at_limit(problem: LibraryProblem, fit: ModelFit) -> list[str]:
    """Return a note on the baseline's parameters that are at their limits, if there are any.

    Args:
        problem: the recording and the library.
        fit: the refitted baseline with the identified mechanisms.
    """
    names = [f"`{problem.names[k]}`" for k in _list_stated_at_limit(problem, fit)]
    if not names:
        return []
    sd_text = "its stated sd is" if len(names) == 1 else "their stated sd are"
    limit = f"{problem.settings.max_prior_deviation_sd:g} sd from the stated value"
    if any(name.startswith("`thread.") for name in names):
        limit += f", or a factor of {problem.settings.max_stiffness_factor:g} for the thread stiffness"
    return [
        f"{join_words(names)} reached {'its limit' if len(names) == 1 else 'their limits'} ({limit}): the"
        f" model may lack a mechanism, or {sd_text} too small."
    ]


def describe_contradicted_values(problem: LibraryProblem, fit: ModelFit) -> list[str]:
    """Return a sentence on each stated value of the baseline that the fit contradicts, as for `fit`.

    Args:
        problem: the recording and the library.
        fit: the refitted baseline with the identified mechanisms.
    """
    return [
        format_contradicted_value(
            problem.names[k],
            float(fit.estimate.values[k]),
            (float(problem.start[k]), float(problem.prior_sd[k])),
            problem.meanings[k].show,
            build_parameter_estimate(problem, fit, k).sd,
        )
        for k in _list_contradicted(problem, fit)
    ]


def describe_contradiction(problem: LibraryProblem, fit: ModelFit, name: str) -> str:
    """Return the words of `fit` on a contradicted stated value, after a semicolon; "" for other parameters.

    Args:
        problem: the recording and the library.
        fit: the refitted baseline with the identified mechanisms.
        name: a parameter of the baseline.
    """
    k = problem.index(name)
    if k not in _list_contradicted(problem, fit):
        return ""
    stated = float(problem.start[k]), float(problem.prior_sd[k])
    return f"; {describe_prior(float(fit.estimate.values[k]), stated, problem.meanings[k].show)}"


def _list_contradicted(problem: LibraryProblem, fit: ModelFit) -> list[int]:
    """Return the indices of the baseline's stated parameters at their limits or many sd away.

    An error of a length level has no stated value in muscle.toml.
    """
    at_limit = _list_stated_at_limit(problem, fit)
    return [
        k
        for k in _list_stated(problem, fit)
        if not is_length_error(problem.names[k]) and (k in at_limit or _is_contradicted(problem, fit, k))
    ]


def _is_contradicted(problem: LibraryProblem, fit: ModelFit, k: int) -> bool:
    return abs(_compute_prior_shift(problem, fit, k)) > MAX_PRIOR_SHIFT_SD


def _compute_prior_shift(problem: LibraryProblem, fit: ModelFit, k: int) -> float:
    """Return the shift of a parameter from its stated value, in sd of this; 0 without one."""
    return float((fit.estimate.values[k] - problem.start[k]) / problem.prior_sd[k])


def _list_stated(problem: LibraryProblem, fit: ModelFit) -> list[int]:
    """Return the indices of the free parameters of the baseline with a stated sd."""
    return [k for k in fit.estimate.free if problem.is_baseline[k] and np.isfinite(problem.prior_sd[k])]


def _list_stated_at_limit(problem: LibraryProblem, fit: ModelFit) -> list[int]:
    """Return the indices of the baseline's stated parameters that are at their limits."""
    at_limit = {fit.estimate.free[k] for k in find_parameters_at_limit(problem, fit.estimate)}
    return [k for k in _list_stated(problem, fit) if k in at_limit]


def format_asymmetry(problem: LibraryProblem, fit: ModelFit) -> list[str]:
    """Return a note on each effect that depends on direction, if an error of a sensor resembles it.

    Args:
        problem: the recording and the library.
        fit: the refitted baseline with the identified mechanisms.
    """
    return [
        f"`{name}` is {fit.estimate.values[k]:+.2f}. {explanation}"
        for name, (offset_id, explanation) in _RESEMBLANCES.items()
        if (k := problem.index(name)) in fit.estimate.free and offset_id not in fit.ids
    ]


def format_untestable_mechanisms(problem: LibraryProblem) -> list[str]:
    """Return a note on the mechanisms that were not tested, if the recording is a static table."""
    effects = describe_untested_effects(problem)
    if effects is None:
        return []
    return [
        f"{effects} Each row counts as an equilibrium."
        " If the rows were recorded in sequence, add the column `time`."
    ]


def describe_untested_effects(problem: LibraryProblem) -> str | None:
    """Return a sentence on the effects that a recording without time cannot test; None with time."""
    if problem.case.recording.has_time:
        return None
    return f"Without a column `time`, {EFFECTS_OVER_TIME} were not tested."


def format_unidentified_combinations(
    problem: LibraryProblem, baseline: ModelFit, fit: ModelFit | None = None
) -> list[str]:
    """Return one note for each combination of the baseline's parameters that the data do not determine.

    A single parameter that either fit shifts by more than its stated sd does not depend mostly on its prior.

    Args:
        problem: the recording and the library.
        baseline: the refitted baseline; its noise model weights the samples.
        fit: the refitted baseline with the identified mechanisms; None if there is no other fit.
    """
    estimate = baseline.estimate
    free = list(estimate.free)
    if not free:
        return []
    scale = np.array(
        [
            compute_prior_scale(
                float(problem.prior_sd[k]), float(problem.start[k]), find_meaning(problem.names[k])
            )
            for k in free
        ]
    )
    # From the coordinates of the refit (logarithms for some parameters) to SI.
    by_value = estimate.jacobian / np.where(estimate.scale != 0, estimate.scale, 1.0)
    information = by_value.T @ by_value
    shifted = {
        problem.names[k]
        for k in free
        if any(abs(_compute_prior_shift(problem, each, k)) > 1 for each in (baseline, fit or baseline))
    }
    names = [problem.names[k] for k in free]
    combinations = find_undetermined_combinations(names, information, scale)
    return [format_combination(c) for c in combinations if len(c) > 1 or not shifted & c.keys()]

"""Form errors of a diagnosis that predict other recordings: a part of model.json."""

from __future__ import annotations

import numpy as np

from pamjax.diagnosis.form_errors.columns import build_problem_form_source
from pamjax.diagnosis.form_errors.fit import FormErrorFit
from pamjax.diagnosis.form_errors.prediction import compute_joint_whitening
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.diagnosis.saved_model import collect_free_parameters, collect_muscle
from pamjax.infer.form_errors.discrepancy import DiscrepancyNoise
from pamjax.infer.form_errors.form_model import FormErrorModel, build_form_error_model, is_transferable
from pamjax.infer.form_errors.parts import compute_joint_covariance


def build_saved_form_errors(problem: LibraryProblem, fit: ModelFit) -> FormErrorModel | None:
    """Return the form errors of a fit for other recordings; None if there are none.

    Form errors of a measured length are left out: they are no forces, and `validate` predicts forces.

    Args:
        problem: the recording and the library.
        fit: the fit with form errors.
    """
    if not isinstance(fit, FormErrorFit) or problem.case.recording.measures_length:
        return None
    noise, estimate = fit.noise, fit.estimate
    assert isinstance(noise, DiscrepancyNoise)
    textbook, derivatives = problem.predict_with_jacobian(estimate.values, estimate.free)
    law, ids, numbers = collect_muscle(problem, fit, estimate.values)
    names, _, slope = collect_free_parameters(problem, estimate)
    # A ruler error belongs to one recording.
    saved = np.flatnonzero([name in numbers for name in names])
    count = len(names)
    kept = np.concatenate([saved, np.arange(count, count + len(noise.columns))]).astype(int)
    unit = np.concatenate([estimate.scale * slope, np.ones(len(noise.columns))])[kept]
    covariance = compute_joint_covariance(*compute_joint_whitening(fit, derivatives)[1:])
    return build_form_error_model(
        law,
        ids,
        numbers,
        collect_muscle(problem, fit, fit.column_values)[2],
        [names[k] for k in saved],
        {
            candidate.id: build_problem_form_source(
                problem, fit.column_values, candidate, fit.shares[candidate.id]
            )
            for candidate in fit.mechanisms
            if is_transferable(candidate.id, fit.shares.get(candidate.id, 0.0))
        },
        noise.owners,
        noise.estimate_coefficients(problem.measured - textbook),
        covariance[np.ix_(kept, kept)] * np.outer(unit, unit),
    )

"""model.json: the selected model as a file for `simulate`, `validate` and Python."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import numpy as np

from pamjax.diagnosis.estimates import build_parameter_estimate
from pamjax.diagnosis.library.library_parameters import COMPLIANCE_PARAMETER
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import MapEstimate
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.infer.fitting.io import FIT_SCHEMA
from pamjax.infer.form_errors.form_model import FormErrorModel
from pamjax.infer.form_errors.form_model_file import FORM_MODEL_KEY, build_form_model_entry
from pamjax.model.parameters import find_meaning
from pamjax.units import compute_si_factor


def build_model_document(
    problem: LibraryProblem, fit: ModelFit, form_error_model: FormErrorModel | None = None
) -> dict[str, Any]:
    """Return the selected model as a document in the schema of fit.json.

    Args:
        problem: the recording and the library.
        fit: the refitted baseline with the identified mechanisms.
        form_error_model: the same with form errors, for other recordings; None if there are none.
    """
    case, recording = problem.case, problem.case.recording
    law, ids, numbers = collect_muscle(problem, fit, fit.estimate.values)
    usable = recording.usable
    ranges = {
        name: {"low": float(np.min(values[usable])), "high": float(np.max(values[usable]))}
        for name, values in (("pressure", recording.pressure), ("length", recording.length))
    }
    return {
        "schema": FIT_SCHEMA,
        "versions": {"pamjax": version("pamjax")},
        **_serialise_covariance(problem, fit),
        "cases": {
            case.name: {
                "checksum": case.checksum,
                "recording_checksum": case.recording_checksum,
                "calibrated": ranges,
                "memory": {"gaps": case.gaps, "before": case.before},
                "muscle": {"law": law, "mechanisms": ids, "numbers": numbers},
                "muscle_toml": problem.case.text,
                **(
                    {}
                    if form_error_model is None
                    else {FORM_MODEL_KEY: build_form_model_entry(form_error_model)}
                ),
            }
        },
    }


def collect_muscle(
    problem: LibraryProblem, fit: ModelFit, values: np.ndarray
) -> tuple[str, list[str], dict[str, float]]:
    """Return thread law, mechanisms and parameters, SI, of the muscle of a fit.

    Args:
        problem: the recording and the library.
        fit: the fit.
        values: (p,) parameter values, SI.
    """
    law, ids = problem.law, [candidate.id for candidate in fit.mechanisms]
    numbers = {
        name: float(value)
        for name, value in zip(problem.names, values, strict=True)
        if name.partition(".")[0] in ("muscle", "thread", *ids)
    }
    if COMPLIANCE_PARAMETER in numbers:
        # An inelastic braid with a thread compliance is an elastic braid.
        law, ids = "elastic", [id for id in ids if id != "braid_elasticity"]
        numbers["thread.stiffness"] = 1 / max(numbers.pop(COMPLIANCE_PARAMETER), 1e-12)
        numbers.pop("thread.modulus", None)
    return law, ids, numbers


def _serialise_covariance(problem: LibraryProblem, fit: ModelFit) -> dict[str, Any]:
    """Return the fitted parameters with standard deviations and correlations, as in fit.json."""
    names, values, slope = collect_free_parameters(problem, fit.estimate)
    # Covariance within this model: the difference to other models does not change its predictions.
    covariance = fit.within_model_covariance * np.outer(slope, slope)
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    unit = np.where(sd > 0, sd, 1.0)
    at_limit = [build_parameter_estimate(problem, fit, k).at_limit for k in fit.estimate.free]
    parameters = {
        n: _serialise_parameter(n, v, s) | {"at_limit": limit}
        for n, v, s, limit in zip(names, values, sd, at_limit, strict=True)
    }
    matrix = np.round(covariance / np.outer(unit, unit), 6).tolist()
    return {"parameters": parameters, "correlation": {"names": names, "matrix": matrix}}


def collect_free_parameters(
    problem: LibraryProblem, estimate: MapEstimate
) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Return names and values of the free parameters as saved, and their derivatives by the fitted ones.

    The values are in SI. A thread compliance is saved as the thread stiffness.
    """
    names, values = [problem.names[k] for k in estimate.free], estimate.values[list(estimate.free)]
    slope = np.ones(values.size)
    if COMPLIANCE_PARAMETER in names:
        k = names.index(COMPLIANCE_PARAMETER)
        compliance = max(values[k], 1e-12)
        names[k], values[k], slope[k] = "thread.stiffness", 1 / compliance, -1 / compliance**2
    return names, values, slope


def _serialise_parameter(name: str, value: float, sd: float) -> dict[str, Any]:
    unit = find_meaning(name).show
    scale = compute_si_factor(unit)
    return {"value": float(value) / scale, "sd": float(sd) / scale, "unit": unit}

"""Keep the improved model: a file from which `simulate`, `validate` and Python load it again."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import numpy as np

from pamjax.diagnosis.library.library_problem import COMPLIANCE, Problem
from pamjax.diagnosis.refit.candidate_fit import Model
from pamjax.infer.fitting.io import SCHEMA
from pamjax.model.parameters import meaning
from pamjax.units import in_unit


def improved(found: Problem, model: Model) -> dict[str, Any]:
    """The named model as a document of the same schema as fit.json.

    Args:
        found: the recording before the library.
        model: its baseline with names, refitted.
    """
    case, recording = found.case, found.case.recording
    ids = [form.id for form in model.chosen]
    numbers = {
        name: float(value)
        for name, value in zip(found.names, model.at.values, strict=True)
        if name.partition(".")[0] in ("muscle", "thread", *ids)
    }
    law = found.law
    if COMPLIANCE in numbers:
        # An inelastic braid that was found to stretch is an elastic one.
        law, ids = "elastic", [id for id in ids if id != "braid_elasticity"]
        numbers["thread.stiffness"] = 1 / max(numbers.pop(COMPLIANCE), 1e-12)
        numbers.pop("thread.modulus", None)
    good = recording.usable
    ends = {
        name: {"low": float(np.min(values[good])), "high": float(np.max(values[good]))}
        for name, values in (("pressure", recording.pressure), ("length", recording.length))
    }
    return {
        "schema": SCHEMA,
        "versions": {"pamjax": version("pamjax")},
        **_known(found, model),
        "cases": {
            case.name: {
                "checksum": case.checksum,
                "calibrated": ends,
                "memory": {"gaps": case.gaps, "before": case.before},
                "muscle": {"law": law, "mechanisms": ids, "numbers": numbers},
                "muscle_toml": _toml(found),
            }
        },
    }


def _known(found: Problem, model: Model) -> dict[str, Any]:
    """How surely the numbers that moved are known, and how they move together, as a fit.json has it."""
    at = model.at
    names, values = [found.names[k] for k in at.moved], at.values[list(at.moved)]
    slope = np.ones(values.size)
    if COMPLIANCE in names:
        k = names.index(COMPLIANCE)
        softness = max(values[k], 1e-12)
        names[k], values[k], slope[k] = "thread.stiffness", 1 / softness, -1 / softness**2
    # Of this one model: what others as good disagree about moves its numbers, not what it predicts.
    covariance = model.own_covariance * np.outer(slope, slope)
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    unit = np.where(sd > 0, sd, 1.0)
    told = {n: _parameter(n, v, s) for n, v, s in zip(names, values, sd, strict=True)}
    matrix = np.round(covariance / np.outer(unit, unit), 6).tolist()
    return {"parameters": told, "correlation": {"names": names, "matrix": matrix}}


def _parameter(name: str, value: float, sd: float) -> dict[str, Any]:
    unit = meaning(name).show
    scale = in_unit(unit)
    return {"value": float(value) / scale, "sd": float(sd) / scale, "unit": unit}


def _toml(found: Problem) -> str:
    file = found.case.folder / "muscle.toml"
    return file.read_text(encoding="utf-8-sig") if file.exists() else ""

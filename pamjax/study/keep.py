"""Keep the improved model: a file from which `simulate`, `validate` and Python load it again."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import numpy as np

from pamjax.infer.save import SCHEMA
from pamjax.study.naming import Model
from pamjax.study.problem import COMPLIANCE, Problem


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


def _toml(found: Problem) -> str:
    file = found.case.folder / "muscle.toml"
    return file.read_text(encoding="utf-8-sig") if file.exists() else ""

"""Standard deviation of a calibrated muscle's force, from the covariance of its parameters.

sd_F² = gᵀ C g with g = ∂F/∂θ at a pressure and length, and the covariance C of the fit. A commanded pressure
has the standard deviation sd_F / F_P, a commanded length sd_F / F_L. The force error on held-out blocks
beyond noise is added to sd_F in quadrature. A sized muscle has no fit: C is the scatter of its materials and
of its manufacture.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from pamjax.compile.programs import run_compiled
from pamjax.control.inverse import compute_static_force
from pamjax.errors import BadInput, suggest_word
from pamjax.infer.fitting.report import MIN_EXCESS
from pamjax.model.assembly import assemble, assemble_bench
from pamjax.records.files import read_bytes
from pamjax.text import join_words
from pamjax.units import compute_si_factor, format_number

#: Standard deviation of the force at rest, N, at pressures, Pa, and lengths, m, each (n,).
ForceUncertainty = Callable[[np.ndarray, np.ndarray], np.ndarray]


def combine_force_sd(
    file: Path, case: str | None = None, posterior_sd: ForceUncertainty | None = None
) -> ForceUncertainty | None:
    """Return the function for the force's sd, with the unexplained force error; None for a stated muscle.

    Args:
        file: a fit.json or model.json.
        case: name of one of several cases. Default: the first.
        posterior_sd: sd of the force over posterior draws, used instead of the file's covariance.
    """
    if file.suffix != ".json":
        return posterior_sd
    unexplained_force = read_unexplained_force(file, case) or 0.0
    return lambda p, l: np.hypot(
        posterior_sd(p, l) if posterior_sd else compute_force_sd(file, p, l, case), unexplained_force
    )


def compute_force_sd(
    file: Path, pressure: np.ndarray, length: np.ndarray, case: str | None = None
) -> np.ndarray:
    """Return the standard deviation of the force at rest, N, (n,); NaN if the file has no covariance.

    Args:
        file: a fit.json or model.json; that of a sized muscle has the scatter of the design.
        pressure, length: (n,) Pa and m.
        case: name of one of several cases. Default: the first.
    """
    document = json.loads(read_bytes(file))
    if "correlation" not in document:
        return np.full(np.shape(pressure), np.nan)
    name = case or next(iter(document["cases"]))
    if name not in document["cases"]:
        raise BadInput.from_rule(
            f"unknown case {name!r} in {file.name}", remedy=suggest_word(name, document["cases"])
        )
    muscle = document["cases"][name]["muscle"]
    own_names = {n: n.removeprefix(f"{name}/") for n in document["correlation"]["names"]}
    free_names = {n: short for n, short in own_names.items() if short in muscle["numbers"]}
    indices = [k for k, n in enumerate(own_names) if n in free_names]
    parameters = [document["parameters"][n] for n in free_names]
    sd = np.array(
        [
            np.nan if parameter["sd"] is None else parameter["sd"] * compute_si_factor(parameter["unit"])
            for parameter in parameters
        ]
    )
    correlation = np.array(document["correlation"]["matrix"])[np.ix_(indices, indices)]
    numbers = {n: jnp.asarray(v) for n, v in muscle["numbers"].items()}
    start = jnp.array([numbers[short] for short in free_names.values()])
    model = _ModelKey(muscle["law"], tuple(muscle["mechanisms"]), tuple(free_names.values()))
    force_slopes = run_compiled(
        _compute_force_slopes, model, numbers, start, jnp.asarray(pressure, float), jnp.asarray(length, float)
    )
    scaled_slopes = np.asarray(force_slopes) * sd
    return np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", scaled_slopes, correlation, scaled_slopes), 0.0))


def read_unexplained_force(file: Path, case: str | None = None) -> float | None:
    """Return the force error on held-out blocks beyond noise, N, √(rmse² − sd²); None if it is unknown.

    The diagnosis.json next to a model.json has the held-out error and the noise. A fit.json has its own. A
    command neglects form errors, so that they are part of the error.

    Args:
        file: a fit.json or model.json.
        case: name of one of several cases. Default: the first.
    """
    diagnosis_file = file.parent / "diagnosis.json"
    try:
        if file.name == "model.json":
            diagnosis = json.loads(read_bytes(diagnosis_file)) if diagnosis_file.exists() else {}
            rmse = float(diagnosis["improvement"]["held_out"]["force"]["rmse_equations"])
            noise = float(diagnosis["noise"]["force"]["sd"])
        else:
            cases = json.loads(read_bytes(file))["cases"]
            entry = cases[case or next(iter(cases))]
            rmse = float(entry["held_out"]["rmse"]["force"]["value"])
            sizes = [form["rms"] for form in entry.get("form_errors", {}).values()]
            rmse = math.hypot(rmse, *(float(size["force"]["value"]) for size in sizes if "force" in size))
            noise = float(entry["noise"]["force"]["sd"])
    except (KeyError, TypeError, ValueError):
        return None
    return math.sqrt(max(rmse**2 - noise**2, 0.0))


def find_uncertainty_source(file: Path | None, has_draws: bool = False) -> str:
    """Return the source of the standard deviation of a muscle, a key of `standalone.UNCERTAINTY_TEXTS`.

    Args:
        file: a fit.json or model.json; None for a muscle with stated values.
        has_draws: whether posterior draws are used.
    """
    if has_draws:
        return "posterior"
    if file is None or file.suffix != ".json":
        return "unknown"
    document = json.loads(read_bytes(file))
    if "correlation" not in document:
        return "unknown"
    return "design" if document.get("uncertainty") == "design" else "calibration"


def list_parameters_at_limit(file: Path | None, case: str | None = None) -> list[str]:
    """Return the names of the fitted parameters that are at their limits, which have no sd.

    Args:
        file: a fit.json or model.json; None for a muscle with stated values.
        case: name of one of several cases. Default: the first.
    """
    if file is None or file.suffix != ".json":
        return []
    document = json.loads(read_bytes(file))
    prefix = f"{case or next(iter(document['cases']))}/"
    return [
        name.removeprefix(prefix)
        for name, parameter in document.get("parameters", {}).items()
        if parameter.get("at_limit") and ("/" not in name or name.startswith(prefix))
    ]


def describe_fit_problems(file: Path | None, case: str | None = None) -> str | None:
    """Return a sentence on parameters at their limits and on a misfit above the noise, or None.

    Args:
        file: a fit.json or model.json; None for a muscle with stated values.
        case: name of one of several cases. Default: the first.
    """
    at_limit, misfits = list_parameters_at_limit(file, case), _read_misfit_ratios(file, case)
    problems = [f"its rmse of {c} is {format_number(ratio, 2)} times the noise" for c, ratio in misfits]
    if at_limit:
        verb = "is at its limit" if len(at_limit) == 1 else "are at their limits"
        problems.append(f"{join_words(at_limit)} {verb}")
    if not problems or file is None:
        return None
    advice = "; run `pamjax diagnose`" if file.name != "model.json" else ""
    return f"check the fit first: {' and '.join(problems)}{advice}"


def _read_misfit_ratios(file: Path | None, case: str | None) -> list[tuple[str, float]]:
    """Return each channel with a misfit in a fit.json, and its ratio of rmse and noise."""
    if file is None or file.suffix != ".json":
        return []
    cases = json.loads(read_bytes(file))["cases"]
    entry = cases[case or next(iter(cases))]
    return [
        (channel, entry["rmse"][channel]["value"] / noise["sd"])
        for channel, noise in entry.get("noise", {}).items()
        if noise["excess"] > MIN_EXCESS
    ]


class _ModelKey(eqx.Module):
    """The kind of a muscle: thread law, mechanisms and names of the free parameters."""

    law: str = eqx.field(static=True)
    ids: tuple[str, ...] = eqx.field(static=True)
    free_names: tuple[str, ...] = eqx.field(static=True)


@jax.jit
def _compute_force_slopes(
    model: _ModelKey, numbers: dict[str, Array], start: Array, pressure: Array, length: Array
) -> Array:
    def force(values, p, l):
        all_numbers = numbers | dict(zip(model.free_names, values, strict=True))
        muscle = (
            assemble_bench(model.law, model.ids, all_numbers)
            if model.ids
            else assemble(model.law, all_numbers)
        )
        return compute_static_force(muscle, p, l)[0]

    return jax.vmap(jax.jacfwd(force), in_axes=(None, 0, 0))(start, pressure, length)

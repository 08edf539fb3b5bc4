"""Doubt: how far the force of a calibrated muscle may be off, from the covariance of its numbers.

sd_F² = gᵀ C g with g = ∂F/∂θ at a pressure and length and C the covariance that the fit found. A pressure
that is commanded for a force is off by sd_F / F_P, a length by sd_F / F_L. What a diagnosis could not explain
of the force adds to sd_F.
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

from pamjax.control.inverse import static_force
from pamjax.errors import refuse
from pamjax.model.assembly import assemble, assemble_bench
from pamjax.records.files import read_bytes
from pamjax.units import in_unit

#: Standard deviation of the force at rest, N, at pressures, Pa, and lengths, m, each (n,).
Doubt = Callable[[np.ndarray, np.ndarray], np.ndarray]


def doubt_of(file: Path, case: str | None = None, known: Doubt | None = None) -> Doubt | None:
    """How surely a muscle's force is known, with what its diagnosis left over; None where it is as stated.

    Args:
        file: a fit.json or model.json.
        case: which case of several.
        known: what a posterior says instead of the file's covariance.
    """
    if file.suffix != ".json":
        return known
    missed = left_over(file) or 0.0
    return lambda p, l: np.hypot(known(p, l) if known else force_sd(file, p, l, case), missed)


def force_sd(file: Path, pressure: np.ndarray, length: np.ndarray, case: str | None = None) -> np.ndarray:
    """Standard deviation of the force at rest, N, (n,); NaN where the file knows no covariance.

    Args:
        file: a fit.json, or a model.json; that of a muscle that was designed keeps no covariance.
        pressure, length: (n,) Pa and m.
        case: which case of several.
    """
    document = json.loads(read_bytes(file))
    if "correlation" not in document:
        return np.full(np.shape(pressure), np.nan)
    name = case or next(iter(document["cases"]))
    if name not in document["cases"]:
        raise refuse(f"{name!r} is no case of {file.name}")
    muscle = document["cases"][name]["muscle"]
    own = {n: n.removeprefix(f"{name}/") for n in document["correlation"]["names"]}
    moving = {n: short for n, short in own.items() if short in muscle["numbers"]}
    places = [k for k, n in enumerate(own) if n in moving]
    told = [document["parameters"][n] for n in moving]
    sd = np.array([np.nan if t["sd"] is None else t["sd"] * in_unit(t["unit"]) for t in told])
    correlation = np.array(document["correlation"]["matrix"])[np.ix_(places, places)]
    numbers = {n: jnp.asarray(v) for n, v in muscle["numbers"].items()}
    start = jnp.array([numbers[short] for short in moving.values()])
    slopes = _slopes(
        (muscle["law"], tuple(muscle["mechanisms"]), tuple(moving.values())), numbers, start,
        jnp.asarray(pressure, float), jnp.asarray(length, float),
    )  # fmt: skip
    by = np.asarray(slopes) * sd
    return np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", by, correlation, by), 0.0))


def left_over(file: Path) -> float | None:
    """Force that a diagnosed muscle misses on held-out blocks beyond noise, N, as the diagnosis.json beside
    its model.json says; None where there is none."""
    beside = file.parent / "diagnosis.json"
    if file.name != "model.json" or not beside.exists():
        return None
    try:
        told = json.loads(read_bytes(beside))
        rmse = float(told["improvement"]["held_out"]["force"]["rmse_after"])
        noise = float(told["noise"]["force"]["sd"])
    except (KeyError, TypeError, ValueError):
        return None
    return math.sqrt(max(rmse**2 - noise**2, 0.0))


@eqx.filter_jit
def _slopes(what, numbers: dict[str, Array], start: Array, pressure: Array, length: Array) -> Array:
    law, ids, moving = what

    def force(values, p, l):
        every = numbers | dict(zip(moving, values, strict=True))
        muscle = assemble_bench(law, ids, every) if ids else assemble(law, every)
        return static_force(muscle, p, l)[0]

    return jax.vmap(jax.jacfwd(force), in_axes=(None, 0, 0))(start, pressure, length)

"""Uncertainty of a command from posterior draws.

Linear error propagation fails for a large uncertainty. Therefore each draw of the muscle is inverted
separately. The result is the central 90 % interval and the standard deviation over the draws that can produce
the force.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from pamjax.control.inverse import CommandLimit, Inverse, compute_static_force, solve_lengths, solve_pressures
from pamjax.errors import BadInput
from pamjax.infer.fitting.load import LoadedMuscle, build_muscle
from pamjax.jit import compile_on_call

#: Number of inverted draws; the relative error of a standard deviation from them is 3.5 %.
DRAW_COUNT = 400

#: Probability of the reported central interval.
INTERVAL_SHARE = 0.9


@dataclass(frozen=True)
class CommandDistribution:
    """Distribution of a command over posterior draws, SI.

    Attributes:
        sd: standard deviation over the draws that can produce the force.
        low, high: ends of their central interval with probability `INTERVAL_SHARE`.
        feasible_share: share of draws that can produce the force.
    """

    sd: float
    low: float
    high: float
    feasible_share: float


@dataclass(frozen=True, eq=False)
class PosteriorDraws:
    """Posterior draws of a muscle's parameters.

    Attributes:
        mean_muscle: the muscle at the posterior means.
        samples: draws (`DRAW_COUNT`,) of each parameter, SI, by its name.
        neglected_form_errors: mechanisms whose form error the posterior includes; commands neglect it.
    """

    mean_muscle: LoadedMuscle
    samples: Mapping[str, Array]
    neglected_form_errors: tuple[str, ...] = ()

    def compute_force_sd(self, pressure: np.ndarray, length: np.ndarray) -> np.ndarray:
        """Return the standard deviation of the force at rest over the draws, N, (n,)."""
        model_key, numbers = (
            (self.mean_muscle.law, self.mean_muscle.mechanisms),
            dict(self.mean_muscle.numbers),
        )
        forces = _compute_draw_forces(
            model_key, numbers, dict(self.samples), jnp.asarray(pressure), jnp.asarray(length)
        )
        return np.asarray(forces).std(axis=0, ddof=1)

    def compute_distribution(
        self, inverse: Inverse, force: float, *, length: float | None = None, pressure: float | None = None
    ) -> CommandDistribution:
        """Return the distribution of a command over the draws.

        Args:
            inverse: the inverse model; only its range is used.
            force: wanted force, N.
            length: given length, m, for a commanded pressure; or
            pressure: given pressure, Pa, for a commanded length.
        """
        model_key = self.mean_muscle.law, self.mean_muscle.mechanisms, length is not None
        numbers = dict(self.mean_muscle.numbers)
        given_value = length if length is not None else pressure
        ranges = jnp.array(inverse.pressures), jnp.array(inverse.lengths)
        value, status = (
            np.asarray(x)
            for x in _compute_draw_commands(
                model_key, numbers, dict(self.samples), ranges, force, given_value
            )
        )
        feasible = value[status == CommandLimit.OK]
        if feasible.size < 2:
            return CommandDistribution(np.nan, np.nan, np.nan, feasible.size / value.size)
        tail = (1 - INTERVAL_SHARE) / 2
        low, high = np.quantile(feasible, [tail, 1 - tail])
        return CommandDistribution(
            float(feasible.std(ddof=1)), float(low), float(high), feasible.size / value.size
        )


@compile_on_call
def _compute_draw_forces(model_key, numbers: dict[str, Array], samples: dict[str, Array], pressure, length):
    """Return the force at rest of every draw, (k, n)."""
    law, ids = model_key

    def compute_one_draw(draw):
        muscle = build_muscle(law, ids, numbers | draw)
        return jax.vmap(lambda p, l: compute_static_force(muscle, p, l)[0])(pressure, length)

    return jax.vmap(compute_one_draw)(samples)


@compile_on_call
def _compute_draw_commands(
    model_key, numbers: dict[str, Array], samples: dict[str, Array], ranges, force, given
):
    """Return value and status of one command for every draw, each (k,)."""
    (law, ids, by_length), (pressures, lengths) = model_key, ranges
    command = solve_pressures if by_length else solve_lengths
    wanted_force, given_value = (jnp.reshape(jnp.asarray(x, float), 1) for x in (force, given))

    def compute_one_draw(draw):
        muscle = build_muscle(law, ids, numbers | draw)
        result = command(muscle, pressures, lengths, wanted_force, given_value)
        return result.value[0], result.status[0]

    return jax.vmap(compute_one_draw)(samples)


def load_draws(file: Path, loaded: LoadedMuscle) -> PosteriorDraws:
    """Return the posterior draws of a muscle.

    Args:
        file: a posterior.nc of `pamjax sample`.
        loaded: the muscle, from the same case or from a fit of it.

    Raises:
        BadInput: if the file is no posterior, or has another recording, thread law or set of mechanisms.
    """
    all_samples, attributes = _read_posterior(file)
    case = _match_case(attributes, loaded, file)
    case_samples = {name.removeprefix(f"{case}."): values for name, values in all_samples.items()}
    samples = {name: values for name, values in case_samples.items() if name in loaded.numbers}
    if not samples:
        raise BadInput.from_rule(
            "a posterior must have a parameter of this muscle",
            ", ".join(all_samples),
            file.name,
            "Name the posterior of this muscle.",
        )
    size = next(iter(samples.values())).size
    rows = np.linspace(0, size - 1, DRAW_COUNT).round().astype(int)
    means = {name: jnp.asarray(values.mean()) for name, values in samples.items()}
    numbers = dict(loaded.numbers) | means
    mean_muscle = replace(
        loaded,
        numbers=numbers,
        muscle=build_muscle(loaded.law, loaded.mechanisms, numbers),
    )
    return PosteriorDraws(
        mean_muscle,
        {name: jnp.asarray(values[rows]) for name, values in samples.items()},
        list_form_errors(attributes),
    )


def list_form_errors(attributes: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the mechanisms whose form error a posterior.nc includes, from its attributes."""
    shares = json.loads(attributes.get("form_errors", "{}"))
    return tuple(dict.fromkeys(id for of in shares.values() for id, share in of.items() if share > 0))


def _read_posterior(file: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the draws by name, SI, and the file's attributes."""
    import xarray as xr

    if not file.exists():
        raise BadInput.from_rule(
            f"the file {file} does not exist", remedy="`pamjax sample` writes posterior.nc."
        )
    try:
        with xr.open_dataset(file, engine="h5netcdf") as dataset:
            attributes = dict(dataset.attrs)
        with xr.open_dataset(file, group="posterior", engine="h5netcdf") as posterior:
            return {
                str(name): np.asarray(posterior[name]).ravel() for name in posterior.data_vars
            }, attributes
    except (OSError, ValueError, KeyError) as error:
        rule, remedy = "a posterior must be a readable posterior.nc", "`pamjax sample` writes it."
        raise BadInput.from_rule(rule, f"{file.name}", remedy=remedy) from error


def _match_case(attributes: dict[str, Any], loaded: LoadedMuscle, file: Path) -> str:
    """Return the name of the posterior's case for this muscle."""
    law, ids = attributes.get("law"), tuple(json.loads(attributes.get("mechanisms", "[]")))
    if (law, sorted(ids)) != (loaded.law, sorted(loaded.mechanisms)):
        own_model = _format_model(loaded.law, loaded.mechanisms)
        rule = f"the posterior must have the model of the muscle ({own_model})"
        raise BadInput.from_rule(
            rule, _format_model(str(law), ids), file.name, "Use the fit.json of the same model."
        )
    checksums = json.loads(attributes.get("checksum", "{}"))
    for name, checksum in checksums.items():
        if checksum == loaded.checksum:
            return name
    rule = "the posterior must come from the recording of the muscle"
    raise BadInput.from_rule(
        rule,
        ", ".join(checksums) or "none",
        file.name,
        "Use the case folder of the posterior, or a fit of this case.",
    )


def _format_model(law: str, ids: tuple[str, ...]) -> str:
    return " + ".join([law, *ids])

"""Draws: a muscle as often as its posterior was drawn, commanded all at once.

Where doubt is not small the spread of a command is not that of a straight line: each draw is inverted by
itself, and what is told is the middle 90 % and the standard deviation of those that can meet the wish.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from pamjax.control.inverse import Inverse, Limit, lengths_of, pressures_of, static_force
from pamjax.errors import refuse
from pamjax.infer.fitting.load import Loaded, build

#: Draws that are inverted: a standard deviation is known from them to 3.5 %.
MANY = 400

#: The middle share that is told.
MIDDLE = 0.9


@dataclass(frozen=True)
class Spread:
    """What draws make of a command, SI.

    Attributes:
        sd, low, high: standard deviation and ends of the middle `MIDDLE`, of the draws that meet the wish.
        met: share of draws that do.
    """

    sd: float
    low: float
    high: float
    met: float


@dataclass(frozen=True, eq=False)
class Draws:
    """A muscle as it may be.

    Attributes:
        loaded: the muscle at the means of its draws.
        moving: (`MANY`,) SI, by name of the number.
    """

    loaded: Loaded
    moving: Mapping[str, Array]

    def force_sd(self, pressure: np.ndarray, length: np.ndarray) -> np.ndarray:
        """Standard deviation of the force at rest over the draws, N, (n,)."""
        what, numbers = (self.loaded.law, self.loaded.mechanisms), dict(self.loaded.numbers)
        drawn = _forces(what, numbers, dict(self.moving), jnp.asarray(pressure), jnp.asarray(length))
        return np.asarray(drawn).std(axis=0, ddof=1)

    def spread(
        self, of: Inverse, force: float, *, length: float | None = None, pressure: float | None = None
    ) -> Spread:
        """How far a command may be off.

        Args:
            of: the inverse that commands, for its range.
            force: wanted, N.
            length: at which the pressure is sought, m; or
            pressure: at which the length is sought, Pa.
        """
        what = self.loaded.law, self.loaded.mechanisms, length is not None
        numbers = dict(self.loaded.numbers)
        given = length if length is not None else pressure
        ends = jnp.array(of.pressures), jnp.array(of.lengths)
        value, status = (
            np.asarray(x) for x in _commands(what, numbers, dict(self.moving), ends, force, given)
        )
        there = value[status == Limit.OK]
        if there.size < 2:
            return Spread(np.nan, np.nan, np.nan, there.size / value.size)
        tail = (1 - MIDDLE) / 2
        low, high = np.quantile(there, [tail, 1 - tail])
        return Spread(float(there.std(ddof=1)), float(low), float(high), there.size / value.size)


@eqx.filter_jit
def _forces(what, numbers: dict[str, Array], moving: dict[str, Array], pressure, length):
    """Force at rest of every draw, (k, n)."""
    law, ids = what

    def one(drawn):
        muscle = build(law, ids, numbers | drawn)
        return jax.vmap(lambda p, l: static_force(muscle, p, l)[0])(pressure, length)

    return jax.vmap(one)(moving)


@eqx.filter_jit
def _commands(what, numbers: dict[str, Array], moving: dict[str, Array], ends, force, given):
    """Value and status of one wish for every draw, each (k,)."""
    (law, ids, by_length), (pressures, lengths) = what, ends
    command = pressures_of if by_length else lengths_of
    wanted, at = (jnp.reshape(jnp.asarray(x, float), 1) for x in (force, given))

    def one(drawn):
        muscle = build(law, ids, numbers | drawn)
        found = command(muscle, pressures, lengths, wanted, at)
        return found.value[0], found.status[0]

    return jax.vmap(one)(moving)


def draws_of(file: Path, loaded: Loaded) -> Draws:
    """What a posterior.nc knows of a muscle.

    Args:
        file: as `pamjax sample` writes it.
        loaded: the muscle, from the same case or from a fit of it.

    Raises:
        BadInput: if the file is none, or belongs to another recording, thread law or set of mechanisms.
    """
    drawn, about = _read(file)
    case = _same(about, loaded, file)
    own = {name.removeprefix(f"{case}."): values for name, values in drawn.items()}
    moving = {name: values for name, values in own.items() if name in loaded.numbers}
    if not moving:
        raise refuse("a posterior must hold a number of this muscle", ", ".join(drawn), file.name)
    size = next(iter(moving.values())).size
    rows = np.linspace(0, size - 1, MANY).round().astype(int)
    means = {name: jnp.asarray(values.mean()) for name, values in moving.items()}
    numbers = dict(loaded.numbers) | means
    middle = replace(loaded, numbers=numbers, muscle=build(loaded.law, loaded.mechanisms, numbers))
    return Draws(middle, {name: jnp.asarray(values[rows]) for name, values in moving.items()})


def _read(file: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Draws by name, SI, and what the file says it belongs to."""
    import xarray as xr

    if not file.exists():
        raise refuse(f"there is no file {file}", remedy="`pamjax sample` writes posterior.nc.")
    try:
        with xr.open_dataset(file, engine="h5netcdf") as head:
            about = dict(head.attrs)
        with xr.open_dataset(file, group="posterior", engine="h5netcdf") as held:
            return {str(name): np.asarray(held[name]).ravel() for name in held.data_vars}, about
    except (OSError, ValueError, KeyError) as error:
        rule, remedy = "a posterior is a posterior.nc", "`pamjax sample` writes one."
        raise refuse(rule, f"{file.name}, which is none", remedy=remedy) from error


def _same(about: dict[str, Any], loaded: Loaded, file: Path) -> str:
    """Name of the posterior's case that is this muscle's."""
    law, ids = about.get("law"), tuple(json.loads(about.get("mechanisms", "[]")))
    if (law, sorted(ids)) != (loaded.law, sorted(loaded.mechanisms)):
        rule = f"a posterior belongs to its own model ({_model(loaded.law, loaded.mechanisms)} here)"
        raise refuse(rule, _model(str(law), ids), file.name, "Name the fit.json of the same model.")
    sums = json.loads(about.get("checksum", "{}"))
    for name, checksum in sums.items():
        if checksum == loaded.checksum:
            return name
    rule = "a posterior belongs to the recording that it was drawn for"
    raise refuse(rule, ", ".join(sums) or "none", file.name, "Name its case folder, or a fit of it.")


def _model(law: str, ids: tuple[str, ...]) -> str:
    return " + ".join([law, *ids])

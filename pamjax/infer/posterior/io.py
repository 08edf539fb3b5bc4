"""A posterior on disk: posterior.nc, which ArviZ reads, and posterior.json for programs.

| group                  | holds                                                                            |
|------------------------|----------------------------------------------------------------------------------|
| `posterior`            | every number, (chain, draw), in SI, with its unit                                 |
| `sample_stats`         | lp, acceptance; for nuts divergences and steps                                    |
| `log_likelihood`       | of every block, (chain, draw, block), at thinned draws                            |
| `prior`                | draws of what was believed                                                        |
| `posterior_predictive` | rows with their noise at some draws; `prior_predictive` alike                     |
| `observed_data`        | what was measured                                                                 |

A number that belongs to one case of several is named case.number. Read it with `arviz.from_netcdf`, or
with `xarray.open_datatree`.
"""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.channels import SI_UNIT
from pamjax.infer.posterior.log_density import Density
from pamjax.infer.posterior.predictive import by_block, predictions, prior_draws, with_noise
from pamjax.infer.posterior.result import Posterior
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.records.files import write_beside
from pamjax.units import in_unit

SCHEMA = "pamjax.posterior/1"

#: Draws in the groups that hold a number a row, and draws whose blocks are scored.
ROWS, SCORED = 100, 1000
#: Draws of the prior.
PRIOR = 1000


def as_groups(post: Posterior) -> dict[str, Any]:
    """Every group as an xarray Dataset, by name."""
    import xarray as xr

    at = post.density.at
    about = {"created_by": f"pamjax {version('pamjax')}", "sampler": post.sampler}
    names = [file_name(name) for name in at.names]
    draws = {
        n: (("chain", "draw"), post.draws[:, :, k].T, _unit(post, at.names[k])) for k, n in enumerate(names)
    }
    before = prior_draws(post.density, PRIOR, post.seed)
    believed = {
        n: (("chain", "draw"), before[None, :, k], _unit(post, at.names[k])) for k, n in enumerate(names)
    }
    stats = {"lp": (("chain", "draw"), post.log_density.T)}
    stats |= {_STATS[k]: (("chain", "draw"), v.T) for k, v in post.stats.items()}
    groups = {
        "posterior": draws,
        "sample_stats": stats,
        "log_likelihood": _likelihood(post),
        "prior": believed,
        "posterior_predictive": _predictive(post, post.draw(ROWS)),
        "prior_predictive": _predictive(post, before[:ROWS]),
        "observed_data": _observed(post),
    }
    return {name: xr.Dataset(data, attrs=about) for name, data in groups.items()}


_STATS = {"accepted": "acceptance_rate", "diverging": "diverging", "steps": "n_steps"}


def file_name(name: str) -> str:
    """A number's name in the file: netCDF keeps the slash for groups."""
    return name.replace("/", ".")


def attributes(post: Posterior) -> dict[str, Any]:
    """What the file belongs to."""
    cases = [one.case for one in post.fit.cases]
    return {
        "schema": SCHEMA,
        "versions": json.dumps({p: version(p) for p in ("pamjax", "jax", "emcee", "numpy")}),
        "checksum": json.dumps({case.name: case.checksum for case in cases}),
        "law": post.fit.law,
        "mechanisms": json.dumps(list(post.fit.mechanisms)),
        "sampler": post.sampler,
        "memory": json.dumps({case.name: [case.gaps, case.before] for case in cases}),
        "seed": post.seed,
        "reached": int(post.reached),
        "beliefs": json.dumps(post.beliefs),
        "blocks": json.dumps(
            {one.case.name: one.held_out.kind if one.held_out else "" for one in post.fit.cases}
        ),
        "note": str(post),
    }


def _unit(post: Posterior, name: str) -> dict[str, str]:
    unit, _ = post.units(name)
    if name in post.fit.estimates:
        return {"units": unit, "long_name": post.fit.estimates[name].meaning.about}
    return {
        "units": unit,
        "long_name": "noise: " + ("sd of a sample" if unit != "1" else "lag-one correlation"),
    }


def _likelihood(post: Posterior) -> dict[str, Any]:
    n, chains, size = post.draws.shape
    every = max(1, n * chains // SCORED)
    values = post.draws[::every]
    u = points(post.density, values.reshape(-1, size))
    found: dict[str, Any] = {"draw": ("draw", np.arange(n)[::every])}
    for one, (names, sums) in zip(post.fit.cases, by_block(post.density, u, post.fit.cases), strict=True):
        block = f"{_head(post, one)}block"
        found[f"{_head(post, one)}blocks"] = (
            ("chain", "draw", block),
            np.moveaxis(sums.reshape(len(values), chains, -1), 0, 1),
        )
        found[block] = (block, np.array(names, dtype=object).astype(str))
    return found


def points(density: Density, values: np.ndarray) -> np.ndarray:
    """(n, p) plain coordinates of values, SI."""
    import jax
    import jax.numpy as jnp

    at = density.at
    return np.asarray(jax.vmap(lambda v: at.point(dict(zip(at.names, v, strict=True))))(jnp.asarray(values)))


def _predictive(post: Posterior, values: np.ndarray) -> dict[str, Any]:
    found = {}
    for k, (one, streams) in enumerate(zip(post.fit.cases, post.density.streams, strict=True)):
        smooth = predictions(post.density, values, k)
        for stream in streams:
            channel = CHANNELS[stream.channel]
            rows = with_noise(one, stream, smooth[channel], values, post.seed)
            dims = ("chain", "draw", f"{_head(post, one)}row")
            found[f"{_head(post, one)}{channel}"] = (dims, rows[None], _channel(channel))
    return found


def _observed(post: Posterior) -> dict[str, Any]:
    found = {}
    for one in post.fit.cases:
        recording, row = one.case.recording, f"{_head(post, one)}row"
        found[row] = (row, recording.row)
        for name in ("pressure", "length", *recording.channels):
            found[f"{_head(post, one)}{name}"] = (row, getattr(recording, name), _channel(name))
        found[f"{_head(post, one)}row_block"] = (row, np.array(one.block, dtype=object).astype(str))
    return found


def _head(post: Posterior, one) -> str:
    return "" if len(post.fit.cases) == 1 else f"{one.case.name}."


def _channel(name: str) -> dict[str, str]:
    return {"units": SI_UNIT[name]}


def posterior_dict(post: Posterior) -> dict[str, Any]:
    """The posterior as plain numbers, in the units a person reads."""
    health = post.health
    at = post.density.at
    numbers = {}
    for k, name in enumerate(post.names):
        _, unit = post.units(name)
        m = {key: value / in_unit(unit) for key, value in vars(post.marginals[name]).items()}
        trust = {"ess": float(health.ess[k]), "rhat": float(health.rhat[k])}
        known = bool(np.isfinite(at.sd[k]))
        prior = {"low": float(at.low[k]) / in_unit(unit), "high": float(at.high[k]) / in_unit(unit)}
        if known:
            prior |= {"value": float(at.mean[k]) / in_unit(unit), "sd": float(at.sd[k]) / in_unit(unit)}
        numbers[name] = m | {"unit": unit, "prior": prior} | trust
        if name in post.verdicts:
            numbers[name] |= {"verdict": post.verdicts[name].kind, "says": post.verdicts[name].says}
    return {
        "schema": SCHEMA,
        "reached": post.reached,
        "wanted": {"ess": post.wanted[0], "rhat": post.wanted[1]},
        "sampler": post.sampler,
        "seed": post.seed,
        "law": post.fit.law,
        "mechanisms": list(post.fit.mechanisms),
        "parameters": numbers,
        "correlation": {"names": list(post.names), "matrix": np.round(post.correlation, 6).tolist()},
    }


def save_posterior(post: Posterior, folder: str | Path) -> list[Path]:
    """Write posterior.json and posterior.nc, each whole or not at all.

    Args:
        post: the posterior.
        folder: where to; made if it is not there.

    Returns:
        the files written.
    """
    import xarray as xr

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    document, groups = folder / "posterior.json", folder / "posterior.nc"
    with write_beside(document) as path:
        path.write_text(json.dumps(posterior_dict(post), indent=2, allow_nan=False) + "\n", encoding="utf-8")
    tree = xr.DataTree.from_dict(as_groups(post))
    tree.attrs = attributes(post)
    with write_beside(groups) as path:
        tree.to_netcdf(path, engine="h5netcdf")
    return [document, groups]

"""Files of a posterior: posterior.nc for ArviZ, and posterior.json for programs.

| group                  | content                                                                          |
|------------------------|----------------------------------------------------------------------------------|
| `posterior`            | every parameter, (chain, draw), in SI, with its unit                              |
| `sample_stats`         | lp, acceptance; for nuts divergences and steps                                    |
| `log_likelihood`       | of every block, (chain, draw, block), at thinned draws                            |
| `prior`                | draws of the prior                                                                |
| `posterior_predictive` | rows with noise at some draws; `prior_predictive` alike                           |
| `observed_data`        | measurements                                                                      |
| `form_errors`          | only with form errors: `coefficients` (chain, draw, form), at thinned draws, and  |
|                        | the `force_form` and `diameter_form` (form, row) that they multiply, in SI        |

With several cases, a parameter of one case has the name case.parameter. Read the file with
`arviz.from_netcdf` or `xarray.open_datatree`.
"""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.channels import DISPLAY_UNIT, SI_UNIT, to_display
from pamjax.infer.fitting.result import CaseFit
from pamjax.infer.posterior.form_sizes import FormErrorSize
from pamjax.infer.posterior.log_density import PosteriorDensity
from pamjax.infer.posterior.predictive import (
    add_noise,
    compute_block_log_likelihoods,
    draw_prior_coefficients,
    predict_channels,
    sample_prior,
)
from pamjax.infer.posterior.result import Posterior, summarise_draws
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.records.files import write_atomically
from pamjax.units import compute_si_factor

POSTERIOR_SCHEMA = "pamjax.posterior/1"

#: Draws in the predictive groups, and draws in `log_likelihood`.
_PREDICTIVE_DRAWS, _SCORED_DRAWS = 100, 1000
#: Draws in the prior's group.
_PRIOR_DRAWS = 1000


def _build_groups(post: Posterior) -> dict[str, Any]:
    """Return every group as an xarray Dataset, by name."""
    import xarray as xr

    space = post.density.space
    attributes = {"created_by": f"pamjax {version('pamjax')}", "sampler": post.sampler}
    names = [_format_variable_name(name) for name in space.names]
    draws = {
        n: (("chain", "draw"), post.draws[:, :, k].T, _build_unit_attributes(post, space.names[k]))
        for k, n in enumerate(names)
    }
    prior_values = sample_prior(post.density, _PRIOR_DRAWS, post.seed)
    prior_variables = {
        n: (("chain", "draw"), prior_values[None, :, k], _build_unit_attributes(post, space.names[k]))
        for k, n in enumerate(names)
    }
    stats = {"lp": (("chain", "draw"), post.log_density.T)}
    stats |= {_STATISTIC_NAMES[k]: (("chain", "draw"), v.T) for k, v in post.stats.items()}
    scored_values = post.draws[:: _compute_scored_step(post)]
    coefficients = post.draw_coefficients(scored_values.reshape(-1, space.size))
    shown_values = post.thin_draws(_PREDICTIVE_DRAWS)
    groups = {
        "posterior": draws,
        "sample_stats": stats,
        "log_likelihood": _build_likelihood_group(post, scored_values, coefficients),
        "prior": prior_variables,
        "posterior_predictive": _build_predictive_group(
            post, shown_values, post.draw_coefficients(shown_values)
        ),
        "prior_predictive": _build_predictive_group(
            post,
            prior_values[:_PREDICTIVE_DRAWS],
            [
                draw_prior_coefficients(post.density, _PREDICTIVE_DRAWS, k, post.seed)
                for k in range(len(post.fit.cases))
            ],
        ),
        "observed_data": _build_observed_group(post),
    }
    if post.density.has_form_errors:
        groups["form_errors"] = _build_form_group(post, coefficients)
    return {name: xr.Dataset(data, attrs=attributes) for name, data in groups.items()}


_STATISTIC_NAMES = {"accepted": "acceptance_rate", "diverging": "diverging", "steps": "n_steps"}


def _format_variable_name(name: str) -> str:
    """Return a parameter's name in the file, without slashes: netCDF uses them for groups."""
    return name.replace("/", ".")


def _build_attributes(post: Posterior) -> dict[str, Any]:
    """Return the attributes of the file: versions, data, model, sampler and report."""
    cases = [case_fit.case for case_fit in post.fit.cases]
    return {
        "schema": POSTERIOR_SCHEMA,
        "versions": json.dumps({p: version(p) for p in ("pamjax", "jax", "emcee", "numpy")}),
        "checksum": json.dumps({case.name: case.checksum for case in cases}),
        "law": post.fit.law,
        "mechanisms": json.dumps(list(post.fit.mechanisms)),
        "form_errors": json.dumps(post.fit.form_shares),
        "sampler": post.sampler,
        "memory": json.dumps({case.name: [case.gaps, case.before] for case in cases}),
        "seed": post.seed,
        "converged": int(post.converged),
        "priors": json.dumps(post.priors),
        "blocks": json.dumps(
            {
                case_fit.case.name: case_fit.held_out_score.kind if case_fit.held_out_score else ""
                for case_fit in post.fit.cases
            }
        ),
        "note": str(post),
    }


def _build_unit_attributes(post: Posterior, name: str) -> dict[str, str]:
    unit, _ = post.find_units(name)
    if name in post.fit.estimates:
        return {"units": unit, "long_name": post.fit.estimates[name].meaning.about}
    return {
        "units": unit,
        "long_name": "noise: " + ("standard deviation" if unit != "1" else "correlation of neighbours"),
    }


def _compute_scored_step(post: Posterior) -> int:
    """Return the distance of the draws in `log_likelihood` and `form_errors`."""
    n, chains, _ = post.draws.shape
    return max(1, n * chains // _SCORED_DRAWS)


def _build_draw_variable(post: Posterior) -> tuple[str, np.ndarray]:
    """Return the numbers of the thinned draws, as a coordinate."""
    return "draw", np.arange(len(post.draws))[:: _compute_scored_step(post)]


def _build_likelihood_group(
    post: Posterior, values: np.ndarray, coefficients: list[np.ndarray]
) -> dict[str, Any]:
    """Return the log-likelihood of every block at thinned draws.

    Args:
        post: the posterior.
        values: (draws, chains, p) parameters, SI.
        coefficients: (draws × chains, r) coefficients of the form errors, by case.
    """
    _, chains, size = values.shape
    u = _compute_points(post.density, values.reshape(-1, size))
    variables: dict[str, Any] = {"draw": _build_draw_variable(post)}
    sums_of_cases = compute_block_log_likelihoods(post.density, u, coefficients, post.fit.cases)
    for case_fit, (names, sums) in zip(post.fit.cases, sums_of_cases, strict=True):
        block = f"{_format_prefix(post, case_fit)}block"
        variables[f"{_format_prefix(post, case_fit)}blocks"] = (
            ("chain", "draw", block),
            np.moveaxis(sums.reshape(len(values), chains, -1), 0, 1),
        )
        variables[block] = (block, np.array(names, dtype=object).astype(str))
    return variables


def _compute_points(density: PosteriorDensity, values: np.ndarray) -> np.ndarray:
    """Return the unbounded coordinates of values, (n, p).

    Args:
        density: the posterior density.
        values: (n, p) parameters, SI.
    """
    import jax
    import jax.numpy as jnp

    space = density.space
    return np.asarray(
        jax.vmap(lambda v: space.to_point(dict(zip(space.names, v, strict=True))))(jnp.asarray(values))
    )


def _build_form_group(post: Posterior, coefficients: list[np.ndarray]) -> dict[str, Any]:
    """Return the coefficients of the form errors at thinned draws, and the shapes that they multiply.

    Args:
        post: the posterior.
        coefficients: (draws × chains, r) coefficients, by case.
    """
    variables: dict[str, Any] = {"draw": _build_draw_variable(post)}
    for k, (case_fit, form) in enumerate(zip(post.fit.cases, post.density.forms, strict=True)):
        if not form.count:
            continue
        prefix, n = _format_prefix(post, case_fit), case_fit.case.recording.n
        by_chain = np.moveaxis(coefficients[k].reshape(-1, post.draws.shape[1], form.count), 0, 1)
        attributes = {"units": "1", "long_name": "coefficient of a form error; prior N(0, 1)"}
        variables[f"{prefix}coefficients"] = (("chain", "draw", f"{prefix}form"), by_chain, attributes)
        variables[f"{prefix}mechanism"] = (f"{prefix}form", np.array(form.owners, dtype=object).astype(str))
        for likelihood in post.density.likelihoods[k]:
            channel = CHANNELS[likelihood.channel]
            shapes = np.asarray(form.columns)[:, likelihood.channel, :n]
            dims = (f"{prefix}form", f"{prefix}row")
            variables[f"{prefix}{channel}_form"] = (dims, shapes, _build_channel_attributes(channel))
    return variables


def _build_predictive_group(
    post: Posterior, values: np.ndarray, coefficients: list[np.ndarray]
) -> dict[str, Any]:
    variables = {}
    for k, (case_fit, likelihoods) in enumerate(zip(post.fit.cases, post.density.likelihoods, strict=True)):
        smooth = predict_channels(post.density, values, coefficients[k], k)
        for likelihood in likelihoods:
            channel = CHANNELS[likelihood.channel]
            rows = add_noise(case_fit, likelihood, smooth[channel], values, post.seed)
            dims = ("chain", "draw", f"{_format_prefix(post, case_fit)}row")
            variables[f"{_format_prefix(post, case_fit)}{channel}"] = (
                dims,
                rows[None],
                _build_channel_attributes(channel),
            )
    return variables


def _build_observed_group(post: Posterior) -> dict[str, Any]:
    variables = {}
    for case_fit in post.fit.cases:
        recording, row = case_fit.case.recording, f"{_format_prefix(post, case_fit)}row"
        variables[row] = (row, recording.row)
        for name in ("pressure", "length", *recording.channels):
            variables[f"{_format_prefix(post, case_fit)}{name}"] = (
                row,
                getattr(recording, name),
                _build_channel_attributes(name),
            )
        variables[f"{_format_prefix(post, case_fit)}row_block"] = (
            row,
            np.array(case_fit.block, dtype=object).astype(str),
        )
    return variables


def _format_prefix(post: Posterior, case_fit) -> str:
    return "" if len(post.fit.cases) == 1 else f"{case_fit.case.name}."


def _build_channel_attributes(name: str) -> dict[str, str]:
    return {"units": SI_UNIT[name]}


def build_posterior_document(post: Posterior) -> dict[str, Any]:
    """Return the posterior as a JSON document, in display units."""
    convergence = post.convergence
    space = post.density.space
    parameters = {}
    for k, name in enumerate(post.names):
        _, unit = post.find_units(name)
        m = {key: value / compute_si_factor(unit) for key, value in vars(post.marginals[name]).items()}
        diagnostics = {"ess": float(convergence.ess[k]), "rhat": float(convergence.rhat[k])}
        has_gaussian_prior = bool(np.isfinite(space.sd[k]))
        prior = {
            "low": float(space.low[k]) / compute_si_factor(unit),
            "high": float(space.high[k]) / compute_si_factor(unit),
        }
        if has_gaussian_prior:
            prior |= {
                "value": float(space.mean[k]) / compute_si_factor(unit),
                "sd": float(space.sd[k]) / compute_si_factor(unit),
            }
        parameters[name] = m | {"unit": unit, "prior": prior} | diagnostics
        if name in post.verdicts:
            parameters[name] |= {"verdict": post.verdicts[name].kind, "says": post.verdicts[name].detail}
    return {
        "schema": POSTERIOR_SCHEMA,
        "converged": post.converged,
        "targets": {"ess": post.targets[0], "rhat": post.targets[1]},
        "sampler": post.sampler,
        "seed": post.seed,
        "law": post.fit.law,
        "mechanisms": list(post.fit.mechanisms),
        "form_errors": {
            case_fit.case.name: {id: _build_form_entry(case_fit, size) for id, size in sizes.items()}
            for case_fit, sizes in zip(post.fit.cases, post.form_errors, strict=True)
        },
        "parameters": parameters,
        "correlation": {"names": list(post.names), "matrix": np.round(post.correlation, 6).tolist()},
    }


def _build_form_entry(case_fit: CaseFit, size: FormErrorSize) -> dict[str, Any]:
    """Return the form error of a mechanism; its ratio is null for an exact equation."""
    channels = case_fit.case.recording.model_channels
    return {
        "share": size.share,
        "ratio": vars(summarise_draws(size.ratio)) if size.share else None,
        "textbook_rms": {
            channel: {"value": to_display(channel, float(rms)), "unit": DISPLAY_UNIT[channel]}
            for channel, rms in zip(channels, size.effect_rms, strict=True)
            if rms > 0
        },
    }


def save_posterior(post: Posterior, folder: str | Path) -> list[Path]:
    """Write posterior.json and posterior.nc atomically, and return their paths.

    Args:
        post: the posterior.
        folder: the folder; it is created if necessary.

    Returns:
        the files written.

    Raises:
        OSError: if the folder cannot be written.

    Example:
        posterior = pamjax.sample("mine", ess=200)
        pamjax.save_posterior(posterior, "out")
    """
    import xarray as xr

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    document, groups = folder / "posterior.json", folder / "posterior.nc"
    with write_atomically(document) as path:
        path.write_text(
            json.dumps(build_posterior_document(post), indent=2, allow_nan=False) + "\n", encoding="utf-8"
        )
    tree = xr.DataTree.from_dict(_build_groups(post))
    tree.attrs = _build_attributes(post)
    with write_atomically(groups) as path:
        tree.to_netcdf(path, engine="h5netcdf")
    return [document, groups]

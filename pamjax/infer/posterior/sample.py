"""Sampling of the posterior of a fit: `sample` returns a `Posterior`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.errors import BadInput, suggest_word
from pamjax.infer.fitting.fit import fit as calibrate
from pamjax.infer.fitting.result import Fit
from pamjax.infer.posterior.checkpoint import Arrays, Checkpoint, build_identity
from pamjax.infer.posterior.convergence import discard_burn_in
from pamjax.infer.posterior.ensemble import EnsembleSampler
from pamjax.infer.posterior.laplace import GaussianApproximation, fit_laplace
from pamjax.infer.posterior.log_density import PosteriorDensity, apply_autocorrelation_powers, build_density
from pamjax.infer.posterior.nuts import NutsSampler
from pamjax.infer.posterior.result import Posterior
from pamjax.infer.posterior.sampler import Sampler, concatenate_chunks, run_sampler
from pamjax.progress import Progress, ignore_progress
from pamjax.records.case import Case

SamplerName = Literal["emcee", "nuts"]
_SAMPLERS: dict[str, type[Sampler]] = {"emcee": EnsembleSampler, "nuts": NutsSampler}

#: Steps of the pilot run that refines the Gaussian approximation.
PILOT_STEPS = 400


def sample(
    source: Fit | Case | str | Path | Sequence[Case | str | Path],
    law: str | None = None,
    share: Sequence[str] = (),
    mechanisms: Sequence[str] = (),
    *,
    form_error: bool = False,
    priors: Mapping[str, Mapping[str, Any]] | None = None,
    sampler: SamplerName = "emcee",
    ess: float = 1000.0,
    rhat: float = 1.01,
    max_draws: int = 20_000,
    seed: int = 0,
    checkpoint: Path | None = None,
    progress: Progress = ignore_progress,
) -> Posterior:
    """Return draws of the joint posterior of the muscle's and the noise's parameters.

    Form errors of the fit are part of the posterior and of its predictions.
    Sampling stops when every parameter meets `ess` and `rhat`. If `max_draws` is reached first, the result
    has `converged` false.

    Args:
        source: a fit; or one or several cases, or their folders, which are fitted first.
        law: thread law, as in `fit`; only for cases.
        share: parameters that all cases have in common, as in `fit`; only for cases.
        mechanisms: mechanisms in addition to the threads, as in `fit`; only for cases.
        form_error: whether real effects may differ from the equations of `mechanisms`, as in `fit`.
        priors: by name, priors that replace those of muscle.toml: "value", "sd", "low" and "high", SI.
        sampler: "emcee" (an ensemble), or "nuts" (needs blackjax).
        ess: smallest effective sample size of a parameter.
        rhat: largest split-R̂ of a parameter.
        max_draws: maximum draws of one walker or chain.
        seed: seed of the sampler, and of the fit.
        checkpoint: folder in which the chain is saved and from which it is resumed; None for none.
        progress: called with the current step and the completed fraction.

    Returns:
        the `Posterior`; `print` shows its summary, `plot` draws it.

    Raises:
        BadInput: as `fit`; for an unknown sampler or prior; if `checkpoint` contains another chain; for
            `form_error` with a fit without form errors.

    Example:
        posterior = pamjax.sample("mine", ess=200)
        modulus = posterior.marginals["thread.modulus"]
        print(modulus.low, modulus.high)  # 90 % credible interval, Pa
        posterior.plot("corner").savefig("corner.png")
    """
    _check_settings(sampler, ess, rhat, max_draws, seed)
    fit = _fit_source(source, law, share, mechanisms, form_error, seed, progress)
    cases = [case_fit.case for case_fit in fit.cases]
    chain_identity = build_identity(
        cases, fit.space, fit.law, fit.mechanisms, priors or {}, sampler, seed, fit.form_shares
    )
    chain_store = Checkpoint(checkpoint, chain_identity)
    density, start = build_density(fit, priors)
    density, gaussian, state = _start_chain(chain_store, density, start, fit, sampler, seed)
    draws, convergence = run_sampler(
        _SAMPLERS[sampler](density, gaussian), chain_store, state, (ess, rhat, max_draws), progress
    )
    progress("done", 1.0)
    return Posterior(
        fit=fit,
        density=density,
        gaussian=gaussian,
        draws=_convert_draws(density, gaussian, discard_burn_in(concatenate_chunks(draws, "x"))),
        log_density=discard_burn_in(concatenate_chunks(draws, "logp")),
        stats={k: discard_burn_in(concatenate_chunks(draws, k)) for k in draws[0] if k not in ("x", "logp")},
        convergence=convergence,
        converged=convergence.is_converged(ess, rhat, _SAMPLERS[sampler].needs_long_chain),
        targets=(ess, rhat),
        sampler=sampler,
        seed=seed,
        priors={name: dict(prior) for name, prior in (priors or {}).items()},
    )


def _convert_draws(density: PosteriorDensity, gaussian: GaussianApproximation, x: np.ndarray) -> np.ndarray:
    """Return draws as values, SI, (n, chains, p)."""
    return np.asarray(density.space.to_values(gaussian(jnp.asarray(x))))


def _fit_source(source, law, share, mechanisms, form_error: bool, seed: int, progress: Progress) -> Fit:
    if isinstance(source, Fit):
        if form_error and not source.has_form_errors:
            rule, got = "`form_error` needs a fit with form errors", "a fit without"
            raise BadInput.from_rule(rule, got, "", "Use `pamjax.fit(..., form_error=True)`.")
        return source
    return calibrate(
        source, law, share, mechanisms, form_error=form_error, fold_count=2, seed=seed,
        progress=lambda step, fraction: progress(step, 0.25 * fraction),
    )  # fmt: skip


def _start_chain(
    chain_store: Checkpoint, density: PosteriorDensity, start, fit: Fit, sampler: str, seed: int
) -> tuple[PosteriorDensity, GaussianApproximation, Arrays]:
    """Return the density, its Gaussian approximation and the sampler's initial state; save them if new."""
    saved_start = chain_store.read_start()
    if saved_start is not None:
        gaussian = GaussianApproximation(
            jnp.asarray(saved_start.pop("centre")), jnp.asarray(saved_start.pop("root"))
        )
        density = _set_powers(density, saved_start.pop("powers"))
        return _set_form_columns(density, saved_start), gaussian, saved_start
    gaussian = fit_laplace(density, start)
    density = apply_autocorrelation_powers(density, gaussian.centre, fit)
    powers = np.array([float(p) for ps in density.powers for p in ps])
    if (powers < 1).any():
        gaussian = fit_laplace(density, gaussian.centre)
    gaussian = refine_gaussian(EnsembleSampler(density, gaussian, PILOT_STEPS), seed)
    state = _SAMPLERS[sampler](density, gaussian).draw_start(seed)
    chain_store.write_start(
        {
            "centre": np.asarray(gaussian.centre),
            "root": np.asarray(gaussian.covariance_root),
            "powers": powers,
            **{_format_columns_key(k): np.asarray(form.columns) for k, form in enumerate(density.forms)},
            **state,
        }
    )
    return density, gaussian, state


def refine_gaussian(sampler: Sampler, seed: int) -> GaussianApproximation:
    """Return the Gaussian with mean and covariance of a pilot run; in a skewed posterior the mode differs."""
    gaussian = sampler.gaussian
    x = sampler.advance(sampler.draw_start(seed))[0]["x"][sampler.chunk // 2 :].reshape(
        -1, gaussian.centre.size
    )
    return GaussianApproximation(
        gaussian(jnp.asarray(x.mean(0))),
        gaussian.covariance_root @ jnp.linalg.cholesky(jnp.asarray(np.cov(x, rowvar=False))),
    )


def _set_powers(density: PosteriorDensity, powers: np.ndarray) -> PosteriorDensity:
    remaining = iter(jnp.asarray(powers))
    new = tuple(tuple(next(remaining) for _ in channels) for channels in density.powers)
    return eqx.tree_at(lambda d: d.powers, density, new)


def _set_form_columns(density: PosteriorDensity, saved_start: Arrays) -> PosteriorDensity:
    """Return the density with the saved form errors, which are removed from the start.

    A repeated fit has other rounding errors. With the saved columns, a resumed chain has the same density.
    """
    columns = tuple(jnp.asarray(saved_start.pop(_format_columns_key(k))) for k in range(len(density.forms)))
    return eqx.tree_at(lambda d: tuple(form.columns for form in d.forms), density, columns)


def _format_columns_key(k: int) -> str:
    return f"form_columns_{k}"


def _check_settings(sampler: str, ess: float, rhat: float, max_draws: int, seed: int) -> None:
    if sampler not in _SAMPLERS:
        raise BadInput.from_rule(f"unknown sampler {sampler!r}", remedy=suggest_word(sampler, _SAMPLERS))
    minimums = {"ess": (ess, 1), "rhat": (rhat, 1), "max_draws": (max_draws, 100), "seed": (seed, 0)}
    for name, (value, low) in minimums.items():
        if not value >= low:
            raise BadInput.from_rule(f"`{name}` must be at least {low}", f"{value}")

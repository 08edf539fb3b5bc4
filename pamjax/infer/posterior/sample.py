"""From a fit to a posterior: `sample` is the verb, `posterior.Posterior` what it returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.errors import nearest, refuse
from pamjax.infer.fitting.fit import fit as calibrate
from pamjax.infer.fitting.result import Fit
from pamjax.infer.posterior.checkpoint import Arrays, Checkpoint, identity
from pamjax.infer.posterior.convergence import kept
from pamjax.infer.posterior.ensemble import Ensemble
from pamjax.infer.posterior.laplace import Ball, laplace
from pamjax.infer.posterior.log_density import Density, density_of, tempered
from pamjax.infer.posterior.nuts import Nuts
from pamjax.infer.posterior.result import Posterior
from pamjax.infer.posterior.sampler import Walk, together, walk_on
from pamjax.progress import Progress, silent
from pamjax.records.case import Case

Sampler = Literal["emcee", "nuts"]
SAMPLERS: dict[str, type[Walk]] = {"emcee": Ensemble, "nuts": Nuts}

#: Steps of the walk that shapes the ball.
PILOT = 400


def sample(
    source: Fit | Case | str | Path | Sequence[Case | str | Path],
    law: str | None = None,
    share: Sequence[str] = (),
    mechanisms: Sequence[str] = (),
    *,
    beliefs: Mapping[str, Mapping[str, Any]] | None = None,
    sampler: Sampler = "emcee",
    ess: float = 1000.0,
    rhat: float = 1.01,
    max_draws: int = 20_000,
    seed: int = 0,
    checkpoint: Path | None = None,
    progress: Progress = silent,
) -> Posterior:
    """How sure the numbers are: draws of the muscle's numbers and of the noise's together.

    Runs until every number has enough effective samples and the chains agree, not for a number of
    steps. Where `max_draws` does not suffice, the result says so and holds what there is.

    Args:
        source: a fit, or what to fit first: one case or several, or their folders.
        law: thread law, as in `fit`; only for cases.
        share: numbers that all cases have in common, as in `fit`; only for cases.
        mechanisms: what acts beside the threads, as in `fit`; only for cases.
        beliefs: by name what is believed instead of muscle.toml: "value", "sd", "low" and "high", SI.
        sampler: "emcee" (an ensemble), or "nuts" (needs blackjax).
        ess: effective samples that every number is to have.
        rhat: split-R̂ that no number is to exceed.
        max_draws: of one walker or chain.
        seed: of the sampler, and of a fit made here.
        checkpoint: folder in which the chain is kept and resumed; None for none.
        progress: called with what is being done and the share done.

    Raises:
        BadInput: as `fit`; for an unknown sampler or belief; if another chain lies in `checkpoint`.
    """
    _sensible(sampler, ess, rhat, max_draws, seed)
    fit = _fitted(source, law, share, mechanisms, seed, progress)
    cases = [one.case for one in fit.cases]
    belongs = identity(cases, fit.space, fit.law, fit.mechanisms, beliefs or {}, sampler, seed)
    store = Checkpoint(checkpoint, belongs)
    density, start = density_of(fit, beliefs)
    density, ball, state = _begun(store, density, start, fit, sampler, seed)
    draws, found = walk_on(SAMPLERS[sampler](density, ball), store, state, (ess, rhat, max_draws), progress)
    progress("done", 1.0)
    return Posterior(
        fit=fit,
        density=density,
        ball=ball,
        draws=_values(density, ball, kept(together(draws, "x"))),
        log_density=kept(together(draws, "logp")),
        stats={k: kept(together(draws, k)) for k in draws[0] if k not in ("x", "logp")},
        health=found,
        reached=found.good(ess, rhat, SAMPLERS[sampler].long),
        wanted=(ess, rhat),
        sampler=sampler,
        seed=seed,
        beliefs={name: dict(belief) for name, belief in (beliefs or {}).items()},
    )


def _values(density: Density, ball: Ball, x: np.ndarray) -> np.ndarray:
    """Draws as values, SI, (n, chains, p)."""
    return np.asarray(density.at.values(ball(jnp.asarray(x))))


def _fitted(source, law, share, mechanisms, seed: int, progress: Progress) -> Fit:
    if isinstance(source, Fit):
        return source
    return calibrate(
        source, law, share, mechanisms, fold_count=2, seed=seed,
        progress=lambda doing, share: progress(doing, 0.25 * share),
    )  # fmt: skip


def _begun(
    store: Checkpoint, density: Density, start, fit: Fit, sampler: str, seed: int
) -> tuple[Density, Ball, Arrays]:
    """The density, its ball and the sampler's first state: as saved, or found and saved."""
    saved = store.start()
    if saved is not None:
        ball = Ball(jnp.asarray(saved.pop("centre")), jnp.asarray(saved.pop("root")))
        return _powered(density, saved.pop("powers")), ball, saved
    ball = laplace(density, start)
    density = tempered(density, ball.centre, fit)
    powers = np.array([float(p) for ps in density.powers for p in ps])
    if (powers < 1).any():
        ball = laplace(density, ball.centre)
    ball = shaped(Ensemble(density, ball, PILOT), seed)
    state = SAMPLERS[sampler](density, ball).begin(seed)
    store.begin({"centre": np.asarray(ball.centre), "root": np.asarray(ball.root), "powers": powers, **state})
    return density, ball, state


def shaped(walk: Walk, seed: int) -> Ball:
    """The ball of one chunk of a first walk: where the posterior is skew, its middle is not its top."""
    ball = walk.ball
    x = walk.advance(walk.begin(seed))[0]["x"][walk.chunk // 2 :].reshape(-1, ball.centre.size)
    return Ball(
        ball(jnp.asarray(x.mean(0))), ball.root @ jnp.linalg.cholesky(jnp.asarray(np.cov(x, rowvar=False)))
    )


def _powered(density: Density, powers: np.ndarray) -> Density:
    left = iter(jnp.asarray(powers))
    new = tuple(tuple(next(left) for _ in channels) for channels in density.powers)
    return eqx.tree_at(lambda d: d.powers, density, new)


def _sensible(sampler: str, ess: float, rhat: float, max_draws: int, seed: int) -> None:
    if sampler not in SAMPLERS:
        raise refuse(f"{sampler!r} is no sampler", remedy=nearest(sampler, SAMPLERS))
    least = {"ess": (ess, 1), "rhat": (rhat, 1), "max_draws": (max_draws, 100), "seed": (seed, 0)}
    for name, (value, low) in least.items():
        if not value >= low:
            raise refuse(f"`{name}` must be at least {low}", f"{value}")

"""Weigh every sample by the noise that a solution shows."""

from __future__ import annotations

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.infer.fitting.least_squares import Loss, Solution
from pamjax.infer.noise.sensor_noise import Noise, correlation_time, effective_sd, inflation
from pamjax.infer.problem.dataset import CHANNELS, Member, starting_sd
from pamjax.infer.problem.parameter_space import Space
from pamjax.records.case import Case

#: Robust standard deviations beyond which a soft loss hardly looks: one of 400 good samples is there.
FAR = 3.0


def weigh(
    case: Case,
    one: Member,
    at: Space,
    solution: Solution,
    loss: Loss = "square",
    trusting: bool = False,
) -> tuple[Member, dict[str, Noise]]:
    """The member with its samples weighed by their noise, and that noise by channel.

    A sensor is taken to be no better than stated. Where the residual is larger than its noise, the
    rest is misfit, and counts as noise: a model that misses something is not to be sure of itself.
    With a soft loss samples that are far off count as little here as they do in the fit.
    `trusting` takes the sensors at their word instead and the samples as independent, for asking
    what a recording could determine before anything was fitted.
    """
    sensors, n = case.entry.sensors, case.recording.n
    sd = effective_sd(one, at.values(solution.u), sensors, starting_sd(case))
    misfit = misfit_of(one, at.values(solution.u))
    weights, trust, noise = np.zeros_like(misfit), np.ones(2), {}
    learned = _learned(solution)
    for k, (channel, given) in enumerate(zip(CHANNELS, (sensors.force, sensors.diameter), strict=True)):
        there = np.isfinite(misfit[k])
        if not there.any():
            continue
        weights[k, there] = 1 / sd[k, there]
        standard = (misfit[k] / sd[k])[:n]
        standard = standard if loss == "square" else _within(standard)
        absorbed = learned * there.sum() / np.isfinite(misfit).sum()
        worth = inflation(standard, case.recording.starts, absorbed)
        excess = math.sqrt(np.nansum(standard**2) / _freedom(there.sum(), absorbed, worth))
        trust[k] = 1.0 if trusting else 1 / (math.sqrt(worth) * max(excess, 1.0 if given else 1e-12))
        noise[channel] = Noise(
            sd=float(np.sqrt(np.mean(sd[k, there] ** 2))) * (1.0 if given else excess),
            given=given is not None,
            excess=excess if given else 1.0,
            inflation=worth,
            time=correlation_time(worth, case.recording, there[:n]),
            samples=int(there.sum()),
        )
    return _with_weights(one, weights, trust), noise


@eqx.filter_jit
def _misfit(one: Member, values):
    return jnp.stack(one.misfit(values)), jnp.stack([one.rows.force_weight, one.rows.diameter_weight])


def misfit_of(one: Member, values: jnp.ndarray) -> np.ndarray:
    """Measured − model, SI, (2, n); NaN where not measured."""
    misfit, weight = (np.asarray(a) for a in _misfit(one, values))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(weight > 0, misfit / weight, np.nan)


def _within(standard: np.ndarray) -> np.ndarray:
    """The misfit with samples beyond `FAR` robust standard deviations drawn in to there."""
    # Half of a normal variable lies within 0.6745 standard deviations.
    far = FAR * float(np.nanmedian(np.abs(standard))) / 0.6745
    return np.clip(standard, -far, far)


def _learned(solution: Solution) -> float:
    """How many numbers the data, not the priors, determine."""
    both = np.asarray(solution.information + solution.prior)
    return float(np.trace(np.linalg.pinv(both) @ np.asarray(solution.information)))


def _freedom(samples: int, absorbed: float, worth: float) -> float:
    """Samples of a channel less what the numbers taken from it absorb of its noise.

    Of noise in which `worth` samples are one, a number absorbs as much as of so many independent ones;
    at most three quarters, so that a short recording does not divide by nothing.
    """
    return max(samples - absorbed * worth, (samples - absorbed) / 4, 1.0)


def _with_weights(one: Member, weights: np.ndarray, trust: np.ndarray) -> Member:
    new = (jnp.asarray(weights[0]), jnp.asarray(weights[1]), jnp.asarray(trust))
    return eqx.tree_at(lambda m: (m.rows.force_weight, m.rows.diameter_weight, m.trust), one, new)

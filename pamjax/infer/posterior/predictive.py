"""Predictions of posterior draws: form errors, rows with noise, and the log-likelihood of every block."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import ndtr, ndtri

from pamjax.infer.fitting.result import CaseFit
from pamjax.infer.posterior.ar1_likelihood import Ar1Likelihood
from pamjax.infer.posterior.log_density import PosteriorDensity
from pamjax.infer.problem.dataset import CHANNELS, Dataset
from pamjax.jit import compile_on_call

#: Draws that the model evaluates together.
_DRAWS_PER_BATCH = 16
#: Name of the block for all rows without a block, such as transitions between settings.
_UNASSIGNED_BLOCK_NAME = "between blocks"


def draw_coefficients(density: PosteriorDensity, values: np.ndarray, index: int, seed: int) -> np.ndarray:
    """Return a draw of the form errors' coefficients at each draw of the parameters, (draws, r).

    Args:
        density: the posterior density.
        values: (draws, p) parameters, SI.
        index: index of the dataset.
        seed: seed of the coefficients.
    """
    normal = np.random.default_rng([seed, 13, index]).standard_normal(
        (len(values), density.forms[index].count)
    )
    if not density.forms[index].count:
        return normal
    pairs = zip(_split_batches(values), _split_batches(normal), strict=True)
    parts = [_draw_batch(density, index, jnp.asarray(v), jnp.asarray(z)) for v, z in pairs]
    return np.concatenate([np.asarray(p) for p in parts])[: len(values)]


def draw_prior_coefficients(density: PosteriorDensity, count: int, index: int, seed: int) -> np.ndarray:
    """Return draws of the prior of the form errors' coefficients, (count, r)."""
    return np.random.default_rng([seed, 17, index]).standard_normal((count, density.forms[index].count))


def predict_channels(
    density: PosteriorDensity, values: np.ndarray, coefficients: np.ndarray, index: int
) -> dict[str, np.ndarray]:
    """Return force and diameter of one dataset at draws, without noise, (draws, rows) each, SI.

    Args:
        density: the posterior density.
        values: (draws, p) parameters, SI.
        coefficients: (draws, r) coefficients of the form errors, which the prediction includes.
        index: index of the dataset.
    """
    array = predict_equations(density.datasets[index], values)
    if density.forms[index].count:
        array = array + np.einsum("dr,rcn->dcn", coefficients, np.asarray(density.forms[index].columns))
    return dict(zip(CHANNELS, np.moveaxis(array, 1, 0), strict=True))


def predict_equations(dataset: Dataset, values: np.ndarray) -> np.ndarray:
    """Return both channels at draws, (draws, p), without form errors and noise, (draws, 2, rows), SI."""
    parts = [_predict_batch(dataset, jnp.asarray(batch)) for batch in _split_batches(values)]
    return np.concatenate([np.asarray(p) for p in parts])[: len(values)]


def add_noise(
    case_fit: CaseFit, likelihood: Ar1Likelihood, prediction: np.ndarray, values: np.ndarray, seed: int
) -> np.ndarray:
    """Return predictions with simulated sensor noise, (draws, rows), SI; NaN where nothing was measured."""
    n = case_fit.case.recording.n
    measured = np.asarray(likelihood.measured)[:n] > 0
    sensor, propagated = np.random.default_rng([seed, 7, likelihood.channel]).standard_normal(
        (2, n, len(values))
    )
    if likelihood.correlation_index >= 0:
        correlation = values[:, likelihood.correlation_index]
        pairs = zip(np.asarray(likelihood.order), np.asarray(likelihood.position), strict=True)
        previous = 0
        for row, position in pairs:
            if position > 0:
                sensor[row] = correlation * sensor[previous] + np.sqrt(1 - correlation**2) * sensor[row]
            previous = row
    propagated *= np.asarray(likelihood.propagated_sd)[:n, None]
    noise = sensor * values[:, likelihood.sd_index] + propagated
    return np.where(measured, prediction[:, :n] + noise.T, np.nan)


def compute_block_log_likelihoods(
    density: PosteriorDensity, u: np.ndarray, coefficients: list[np.ndarray], cases: tuple[CaseFit, ...]
) -> list[tuple[list[str], np.ndarray]]:
    """Return for each case the names of its blocks and their log-likelihoods at draws, (draws, blocks).

    A sample's density is conditional on the earlier ones and on the coefficients of the form errors. So the
    blocks sum to the log-likelihood.

    Args:
        density: the posterior density.
        u: (draws, p) unbounded coordinates of the parameters.
        coefficients: (draws, r) coefficients of the form errors, by dataset.
        cases: the fitted cases.
    """
    labels = []
    for case_fit, likelihoods in zip(cases, density.likelihoods, strict=True):
        measured = np.any(
            [np.asarray(s.measured)[: case_fit.case.recording.n] > 0 for s in likelihoods], axis=0
        )
        block = np.where(np.array(case_fit.block) == "", _UNASSIGNED_BLOCK_NAME, np.array(case_fit.block))
        names = list(dict.fromkeys(block[measured].tolist()))
        label = np.full(likelihoods[0].measured.size, len(names))
        label[: len(block)] = [names.index(b) if b in names else len(names) for b in block]
        labels.append((names, jnp.asarray(label)))
    row_labels = [label for _, label in labels]
    parts = [
        _sum_blocks(density, jnp.asarray(batch), [jnp.asarray(form) for form in forms], row_labels)
        for batch, *forms in zip(*map(_split_batches, [u, *coefficients]), strict=True)
    ]
    return [
        (names, np.concatenate([np.asarray(p[k]) for p in parts])[: len(u), : len(names)])
        for k, (names, _) in enumerate(labels)
    ]


def sample_prior(density: PosteriorDensity, count: int, seed: int) -> np.ndarray:
    """Return (count, p) draws of the prior, SI: Gaussians truncated at the bounds, or uniform."""
    space = density.space
    random = np.random.default_rng([seed, 11])
    position = random.uniform(size=(count, space.size))
    low, high, mean, sd = (np.asarray(a) for a in (space.low, space.high, space.mean, space.sd))
    is_gaussian = np.isfinite(sd)
    safe = np.where(is_gaussian, sd, 1.0)
    below, above = (ndtr((end - mean) / safe) for end in (low, high))
    gaussian = mean + safe * ndtri(below + position * (above - below))
    uniform_draws = np.where(
        space.log_scale,
        np.abs(low) ** (1 - position) * np.abs(high) ** position,
        low + position * (high - low),
    )
    return np.where(is_gaussian, np.clip(gaussian, low, high), uniform_draws)


def _split_batches(draws: np.ndarray):
    """Return draws in batches of equal size; the first draw of the last batch fills it up."""
    for first in range(0, len(draws), _DRAWS_PER_BATCH):
        batch = draws[first : first + _DRAWS_PER_BATCH]
        yield np.concatenate([batch, np.repeat(batch[:1], _DRAWS_PER_BATCH - len(batch), axis=0)])


@compile_on_call
def _draw_batch(
    density: PosteriorDensity, index: int, values: Float[Array, "w p"], normal: Float[Array, "w r"]
) -> Float[Array, "w r"]:
    return jax.vmap(lambda v, z: density.compute_coefficients(index, v).draw(z))(values, normal)


@compile_on_call
def _predict_batch(dataset: Dataset, values: Float[Array, "w p"]) -> Float[Array, "w 2 n"]:
    return jax.vmap(dataset.predict_channels)(values)


@compile_on_call
def _sum_blocks(
    density: PosteriorDensity,
    u: Float[Array, "w p"],
    coefficients: list[Float[Array, "w r"]],
    labels: list[Array],
) -> list[Array]:
    def sum_draw(v, c):
        pairs = zip(density.compute_sample_log_densities(v, c), labels, strict=True)
        # The additional segment collects rows without a block.
        return [jax.ops.segment_sum(sum(parts), label, label.size + 1) for parts, label in pairs]

    return jax.vmap(sum_draw)(u, coefficients)

"""Simulated recordings with known injected effects: the ground truth of the simulation study.

They use the equations of the fit. The study therefore tests the method if its equations are valid, not the
equations themselves. Shape parameters (times, distances, shares) are drawn around the starting values of the
candidates. With a form error, each effect also deviates from its equation by a smooth random share over
pressure and length.
"""

from __future__ import annotations

import dataclasses
import math
import zlib
from dataclasses import dataclass
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.benchmark.setups import Setup, build_reference_setup
from pamjax.diagnosis.library.candidates import Candidate, build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem, build_library_problem
from pamjax.diagnosis.noise.estimate import estimate_noise
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.model.mechanism import AbstractSensor
from pamjax.model.registry import EXCLUSIVE_PAIRS, MECHANISMS
from pamjax.records.case import Case
from pamjax.records.recording import Recording
from pamjax.records.simulate import draw_ar1_noise

#: Effects outside the library: an obstacle, a load cell that clips, a ripple on the force.
_UNMODELLED_EFFECTS = ("obstacle", "clipping", "ripple")

#: Mechanisms of sensors.
_SENSOR_MECHANISMS = {kind.id for kind in MECHANISMS if issubclass(kind, AbstractSensor)}

#: Iterations to scale an amplitude to the target size of its effect.
_AMPLITUDE_ROUNDS = 4

#: Standard deviation of ln(shape parameter) around its starting value.
_LOG_SHAPE_SD = 0.3

#: Smallest effect over its target size, at the limits of its parameters. Below it another mechanism is drawn.
_MIN_EFFECT_SHARE = 0.7


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """A simulated recording and its injected effects.

    Attributes:
        case: the recording and stated values, as the diagnosis reads them.
        effect_ids: ids of the injected mechanisms, or one of `_UNMODELLED_EFFECTS`.
        effect_sizes: rms of each effect over effective noise, on the channel with the largest value. The
            baseline is refitted, and all other effects are present.
        true_values: true value of every parameter by name, SI.
        candidates: candidate of each injected mechanism; empty for an effect outside the library.
        noise_free: (2, n) force (N) and diameter (m) without noise.
        effects: (k, 2, n) each effect that a refit of the baseline does not absorb, SI.
    """

    case: Case
    effect_ids: tuple[str, ...]
    effect_sizes: tuple[float, ...]
    true_values: dict[str, float]
    candidates: tuple[Candidate, ...]
    noise_free: np.ndarray
    effects: np.ndarray


class _Generators:
    """Random generators by purpose: a new form of one mechanism changes the draws of no other."""

    def __init__(self, rng: np.random.Generator):
        self._seed = int(rng.integers(2**63))

    def __getitem__(self, purpose: str) -> np.random.Generator:
        """Return a generator at its start, for a purpose such as "noise", an id or a parameter name."""
        return np.random.default_rng([self._seed, zlib.crc32(purpose.encode())])


def inject_effects(
    effect_count: int, rng: np.random.Generator, *, setup: Setup | None = None,
    unmodelled: bool = False, only: str | None = None, correlation: float = 0.0,
    smallest: float = 3.0, largest: float = 10.0, form_error: float = 0.0, number: int = 0,
) -> GroundTruth:  # fmt: skip
    """Simulate a recording with effects that its baseline does not include.

    Args:
        effect_count: number of mechanisms to inject.
        rng: random generator for parameters, mechanisms, effect sizes and noise.
        setup: the muscle and its bench; None uses the reference setup.
        unmodelled: whether to inject an effect outside the library instead.
        only: id of the only mechanism to inject; None for all.
        correlation: noise correlation of neighbouring samples of force and of diameter.
        smallest, largest: range of effect sizes, rms in noise standard deviations.
        form_error: rms share by which each effect of muscle or rig deviates from its equation.
        number: number of the recording, for its name.
    """
    setup = setup or build_reference_setup()
    name = f"concealed-{number:04d}"
    bare = Case(
        name=name,
        folder=Path(name),
        muscle_toml=setup.muscle_toml,
        recording=setup.plan,
        checksum="simulated",
    )
    problem = _allow_slack(build_library_problem(bare))
    generators = _Generators(rng)
    values = _draw_muscle(problem, generators["muscle"])
    size_rng = generators["size"]
    mechanisms: list[Candidate] = []
    for candidate in [] if unmodelled else _draw_candidates(problem, generators, only):
        if len(mechanisms) == effect_count:
            break
        if any(frozenset({candidate.id, other.id}) in EXCLUSIVE_PAIRS for other in mechanisms):
            continue
        target_size = math.exp(size_rng.uniform(math.log(smallest), math.log(largest)))
        trial, effect, noise_sd = _scale_to_size(problem, values, candidate, target_size, generators)
        if _compute_largest_rms(effect, noise_sd) > _MIN_EFFECT_SHARE * target_size:
            values = trial
            mechanisms.append(candidate)
    prediction = problem.predict(values)
    prediction = prediction + _draw_form_error(problem, values, mechanisms, form_error, generators)
    effects, sizes = _compute_separate_effects(problem, values, mechanisms)
    ids = tuple(candidate.id for candidate in mechanisms)
    if unmodelled:
        outside_rng = generators["outside"]
        ids = (str(outside_rng.choice(_UNMODELLED_EFFECTS)),)
        target_size = math.exp(size_rng.uniform(math.log(smallest), math.log(largest)))
        effects, sizes = _add_unmodelled_effect(problem, values, ids[0], target_size, outside_rng)
        prediction += effects[0]
    recording = _add_noise(setup, prediction, generators["noise"], correlation)
    case = dataclasses.replace(bare, recording=recording)
    true = dict(zip(problem.names, values.tolist(), strict=True))
    return GroundTruth(case, ids, tuple(sizes), true, tuple(mechanisms), prediction, effects)


def _allow_slack(problem: LibraryProblem) -> LibraryProblem:
    """Return the problem with slack allowed in all rows: the muscle never pushes."""
    is_slack = jnp.ones_like(problem.dataset.rows.is_slack)
    dataset = eqx.tree_at(lambda m: m.rows.is_slack, problem.dataset, is_slack)
    return dataclasses.replace(problem, dataset=dataset)


def _draw_muscle(problem: LibraryProblem, rng: np.random.Generator) -> np.ndarray:
    """Draw the true parameters of the baseline from their priors, within two standard deviations."""
    values = problem.neutral.copy()
    for k in np.flatnonzero(problem.is_baseline).tolist():
        values[k] = _draw_from_prior(problem, k, rng)
    return values


def _draw_from_prior(problem: LibraryProblem, k: int, rng: np.random.Generator) -> float:
    """Draw a parameter from its prior, within two standard deviations."""
    value = problem.start[k] + problem.prior_sd[k] * np.clip(rng.standard_normal(), -2, 2)
    return float(np.clip(value, problem.low[k], problem.high[k]))


def _draw_candidates(problem: LibraryProblem, generators: _Generators, only: str | None) -> list[Candidate]:
    """Return one random candidate of every mechanism, in random order."""
    options: dict[str, list[Candidate]] = {}
    for candidate in build_candidates(problem):
        # An elastic baseline already includes thread stretch.
        is_included = candidate.id == "braid_elasticity" and problem.law != "inelastic"
        if only in (None, candidate.id) and not is_included:
            options.setdefault(candidate.id, []).append(candidate)
    order = sorted(options, key=lambda id: generators[f"{id} order"].random())
    return [options[id][generators[f"{id} form"].integers(len(options[id]))] for id in order]


def _scale_to_size(
    problem: LibraryProblem,
    values: np.ndarray,
    candidate: Candidate,
    target_size: float,
    generators: _Generators,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scale a candidate's amplitude to a target effect size, within its limits.

    An amplitude with a stated value is drawn from its prior instead.

    Returns:
        (p,) parameter values, the effect and the noise of every sample, (2, n) each, SI.
    """
    indices = [problem.index(name) for name in candidate.amplitudes]
    start_values = _draw_shape(problem, values, candidate, generators)
    rng = generators[candidate.id]
    sign = np.array(
        [rng.choice([-1.0, 1.0]) if problem.low[k] < problem.neutral[k] else 1.0 for k in indices]
    )
    span = np.array([problem.high[k] - problem.neutral[k] for k in indices])
    amplitudes = sign * span * rng.dirichlet(np.ones(len(indices)))
    prior_draws = {
        k: _draw_from_prior(problem, k, rng) for k in indices if math.isfinite(problem.prior_sd[k])
    }
    scale = 0.002
    trial, effect, noise_sd = start_values, np.full((2, problem.n), np.nan), np.ones((2, problem.n))
    for _ in range(_AMPLITUDE_ROUNDS):
        trial = start_values.copy()
        for k, amplitude in zip(indices, scale * amplitudes, strict=True):
            inside = 0.02 * (problem.high[k] - problem.low[k])
            value = np.clip(problem.neutral[k] + amplitude, problem.low[k], problem.high[k] - inside)
            trial[k] = prior_draws.get(k, value)
        effect, noise_sd = _compute_effect(problem, values, trial)
        size_ratio = target_size / max(_compute_largest_rms(effect, noise_sd), 1e-9)
        if abs(math.log(size_ratio)) < 0.05:
            break
        scale *= float(np.clip(size_ratio, 0.02, 50.0))
    return trial, effect, noise_sd


def _draw_shape(
    problem: LibraryProblem, values: np.ndarray, candidate: Candidate, generators: _Generators
) -> np.ndarray:
    """Return values with a candidate's shape parameters drawn around their starting values."""
    out = values.copy()
    for name, value in candidate.shape.items():
        k = problem.index(name)
        low, high = problem.low[k], problem.high[k]
        if name.endswith(".when"):
            assert problem.case.recording.time is not None
            low, high = problem.case.recording.time[[0, -1]]
        edge = 0.02 * (high - low) if problem.meanings[k].scale != "log" else 0.0
        deviate = np.clip(generators[name].standard_normal(), -2, 2)
        drawn_value = (
            value + problem.prior_sd[k] * deviate
            if math.isfinite(problem.prior_sd[k])
            else value * math.exp(_LOG_SHAPE_SD * deviate)
        )
        out[k] = np.clip(drawn_value, low + edge, high - edge)
    return out


def _compute_effect(
    problem: LibraryProblem, without: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the effect that a baseline refit does not absorb, and the noise sd, (2, n) each, SI."""
    prediction = problem.predict(values)
    as_measured = dataclasses.replace(
        problem, measured=np.where(np.isnan(problem.measured), np.nan, prediction)
    )
    noise = estimate_noise(as_measured, values, np.ones(problem.n, dtype=bool))
    baseline_indices = np.flatnonzero(problem.is_baseline).tolist()
    effect = prediction - problem.predict(
        fit_parameters(as_measured, noise, baseline_indices, without).values
    )
    sd = [
        np.broadcast_to(channel.sd, problem.n) if channel else np.ones(problem.n)
        for channel in noise.by_channel
    ]
    return np.where(np.isnan(problem.measured), np.nan, effect), np.array(sd)


def _compute_largest_rms(effect: np.ndarray, noise_sd: np.ndarray) -> float:
    """Return the larger of the two channels' rms, in noise standard deviations; NaN is ignored.

    The largest 1 % of the squares is removed, because a few samples next to slack rows are no effect.
    """
    squares = [
        np.sort(channel_effect[np.isfinite(channel_effect)] ** 2) for channel_effect in effect / noise_sd
    ]
    trimmed_squares = [square[: square.size - square.size // 100] for square in squares]
    return max(float(np.sqrt(np.mean(square))) if square.size else 0.0 for square in trimmed_squares)


def _compute_separate_effects(
    problem: LibraryProblem, values: np.ndarray, mechanisms: list[Candidate]
) -> tuple[np.ndarray, list[float]]:
    """Return the effect of each candidate with all others present, and its size."""
    effects, sizes = np.zeros((len(mechanisms), 2, problem.n)), []
    for i, candidate in enumerate(mechanisms):
        effects[i], noise_sd = _compute_effect(problem, remove_amplitudes(problem, values, candidate), values)
        sizes.append(_compute_largest_rms(effects[i], noise_sd))
    return effects, sizes


def _draw_form_error(
    problem: LibraryProblem,
    values: np.ndarray,
    mechanisms: list[Candidate],
    share: float,
    generators: _Generators,
) -> np.ndarray:
    """Draw the deviation of the effects from their equations, SI, (2, n).

    Sensor mechanisms have no form error.
    """
    out = np.zeros((2, problem.n))
    for candidate in mechanisms if share else []:
        if candidate.id not in _SENSOR_MECHANISMS:
            effect = problem.predict(values) - problem.predict(remove_amplitudes(problem, values, candidate))
            surface = _draw_smooth_surface(problem.case.recording, generators[f"{candidate.id} form error"])
            out += share * surface * effect
    return out


def _draw_smooth_surface(recording: Recording, rng: np.random.Generator) -> np.ndarray:
    """Draw a quadratic function of pressure and length, (n,), with rms one."""
    p, x = (
        2 * (channel - channel.min()) / max(np.ptp(channel), 1e-12) - 1
        for channel in (recording.pressure, recording.length)
    )
    surface = rng.standard_normal(5) @ np.stack([p, x, p * x, p**2 - 1 / 3, x**2 - 1 / 3])
    return surface / np.sqrt(np.mean(surface**2))


def remove_amplitudes(problem: LibraryProblem, values: np.ndarray, candidate: Candidate) -> np.ndarray:
    """Return values with a candidate's amplitudes at their neutral values."""
    out = values.copy()
    for name in candidate.amplitudes:
        out[problem.index(name)] = problem.neutral[problem.index(name)]
    return out


def _add_unmodelled_effect(
    problem: LibraryProblem, values: np.ndarray, kind: str, target_size: float, rng: np.random.Generator
) -> tuple[np.ndarray, list[float]]:
    """Return an effect outside the library, (1, 2, n), SI, scaled to the target size, and its size."""
    plain = problem.predict(values)
    pattern = np.zeros((2, problem.n))
    pattern[0] = _draw_unmodelled_pattern(kind, problem.case, plain[0], rng)
    is_measured = np.isfinite(problem.measured)
    scale, size = (problem.case.muscle_toml.sensors.force or 1.0) / max(float(np.std(pattern[0])), 1e-12), 0.0
    for _ in range(_AMPLITUDE_ROUNDS):
        prediction = np.where(is_measured, plain + scale * pattern, np.nan)
        as_measured = dataclasses.replace(problem, measured=prediction)
        noise = estimate_noise(as_measured, values, np.ones(problem.n, dtype=bool))
        baseline_indices = np.flatnonzero(problem.is_baseline).tolist()
        effect = prediction - problem.predict(
            fit_parameters(as_measured, noise, baseline_indices, values).values
        )
        channel = noise.by_channel[0]
        assert channel is not None
        size = float(np.sqrt(np.nanmean((effect[0] / channel.sd) ** 2)))
        if abs(math.log(target_size / max(size, 1e-9))) < 0.05:
            break
        scale *= float(np.clip(target_size / max(size, 1e-9), 0.02, 50.0))
    return (scale * pattern)[None], [size]


def _draw_unmodelled_pattern(
    kind: str, case: Case, force: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Draw a force pattern of an effect outside the library, arbitrary units, (n,)."""
    recording, rest_length = case.recording, case.muscle_toml.rest_length.value
    contraction = 1 - recording.length / rest_length
    if kind == "obstacle":
        start = rng.uniform(0.4, 0.7) * contraction.max()
        return np.maximum(contraction - start, 0.0)
    if kind == "clipping":
        return -np.maximum(force - rng.uniform(0.55, 0.8) * force.max(), 0.0)
    return (
        np.sin(2 * np.pi * recording.length / (rest_length * rng.uniform(0.01, 0.02))) * force / force.max()
    )


def _add_noise(
    setup: Setup, prediction: np.ndarray, rng: np.random.Generator, correlation: float
) -> Recording:
    sensors, plan = setup.muscle_toml.sensors, setup.plan
    n = plan.n
    return dataclasses.replace(
        plan,
        pressure=plan.pressure + (sensors.pressure or 0.0) * rng.standard_normal(n),
        length=plan.length + (sensors.length or 0.0) * rng.standard_normal(n),
        force=prediction[0] + (sensors.force or 0.0) * draw_ar1_noise(rng, n, correlation),
        diameter=np.where(
            np.isfinite(plan.diameter),
            prediction[1] + (sensors.diameter or 0.0) * draw_ar1_noise(rng, n, correlation),
            np.nan,
        ),
    )

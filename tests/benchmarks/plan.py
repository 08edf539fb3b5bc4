"""Test of planned uncertainties: simulated muscles are measured as planned and fitted.

    python -m tests.benchmarks.plan [muscles] [minutes] [--json FILE]
    python -m tests.benchmarks.plan muscles minutes alike [--json FILE]

Length, slenderness, angle, threads, priors and rig differ between muscles. The true parameters, including
offsets, gains and compliance of the rig, are drawn from the priors. The planned runs, and ten isobars of the
same duration, are simulated with noise. A least-squares fit with the same priors, without the approximations
of the plan, estimates the parameters. Reported:

predicted    mean of (fitted sd / planned sd)², and rms of (estimate − truth) / planned sd: both 1 if correct
alike       without a plan: every muscle makes the same three runs, which tests the sd of the fit alone
isobars     rms error after ten isobars / rms error after the plan, both relative to the planned sd
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from pamjax.compile.jax_cache import keep_compiled
from pamjax.model import braid
from pamjax.model.assembly import assemble
from pamjax.planning.information import PriorInformation
from pamjax.planning.plan import Plan, plan
from pamjax.planning.prior_information import build_prior_information
from pamjax.planning.rig_capabilities import DEFAULT_ERROR_SDS, RigCapabilities
from pamjax.planning.runs import PlannedRun, list_isobars, list_runs
from pamjax.records.reading.muscle_toml import MuscleToml, Sensors
from pamjax.records.reading.quantity import MeasuredValue
from tests.benchmarks.keep import arguments, keep

GOAL = "thread.modulus"


def a_muscle(rng: np.random.Generator, minutes: float) -> tuple[MuscleToml, RigCapabilities]:
    """Return a muscle with stated uncertainties, and a rig."""
    rest, angle = math.exp(rng.uniform(math.log(0.1), math.log(0.4))), math.radians(rng.uniform(62, 72))
    thread = rest / math.sin(angle)
    width = rest * rng.uniform(0.07, 0.14)
    turns = thread * math.cos(angle) / (math.pi * width)
    pressure, modulus, threads = rng.uniform(400e3, 800e3), rng.uniform(20e9, 110e9), 144
    pull = float(braid.hoop_pull(pressure, rest, thread, turns))
    area = pull / (modulus * threads * rng.uniform(0.004, 0.012))
    force = pressure * (3 * rest**2 - thread**2) / (4 * math.pi * turns**2)
    sensors = Sensors(
        force=force * rng.uniform(5e-4, 2e-3), diameter=rng.uniform(0.05e-3, 0.15e-3),
        pressure=1e-3 * pressure, length=2e-5,
    )  # fmt: skip
    muscle_toml = MuscleToml(
        name="a muscle", rest_length=MeasuredValue(rest), thread_length=MeasuredValue(thread, 0.003 * thread),
        turns=MeasuredValue(turns, 0.005 * turns), threads=threads, thread_area=MeasuredValue(area),
        modulus=MeasuredValue(modulus, 0.2 * modulus), sensors=sensors, baseline="elastic",
    )  # fmt: skip
    off = {
        "force_offset.offset": 2e-3 * force, "force_gain.gain": 0.01,
        "pressure_offset.offset": 5e-3 * pressure,
        "pressure_gain.gain": 0.01, "length_offset.offset": 1e-3 * rest, "diameter_offset.offset": 2e-4,
        "rig_compliance.compliance": rng.uniform(0.05e-3, 0.2e-3) / force,
    }  # fmt: skip
    stated_sds = {
        "force_sd": sensors.force, "diameter_sd": sensors.diameter, "pressure_sd": sensors.pressure
    }  # fmt: skip
    stated_sds = {name: sd for name, sd in stated_sds.items() if sd}
    means = RigCapabilities(
        max_pressure=pressure, max_contraction=0.25, minutes=minutes, error_sds=off, **stated_sds
    )
    return muscle_toml, means


@dataclass(frozen=True)
class Outcome:
    """The result for one parameter: estimate, sd of the fit and true value, SI."""

    value: float
    sd: float
    true: float


#: Iterations for the length of a muscle on a compliant rig; each reduces the error to some thousandths.
ROUNDS = 6

#: Number of rows of all padded recordings, for one compiled program.
ROWS = 4096


@partial(jax.jit, static_argnames=("law", "names"))
def shown(law: str, names: tuple[str, ...], fixed, values, pressure, length):
    """Return force and diameter on a rig, (2, n), with its exact offsets, gains and compliance."""
    number = dict(zip(names, values, strict=True)) | fixed
    muscle = assemble(law, number)
    off = {name: number.get(name, 0.0) for name in DEFAULT_ERROR_SDS}
    pressure = (pressure - off["pressure_offset.offset"]) / (1 + off["pressure_gain.gain"])
    recorded = at = length - off["length_offset.offset"]
    for _ in range(ROUNDS):
        at = recorded - off["rig_compliance.compliance"] * jax.vmap(muscle)(pressure, at).force
    reading = jax.vmap(muscle)(pressure, at)
    force = reading.force * (1 + off["force_gain.gain"]) + off["force_offset.offset"]
    return jnp.stack([force, reading.diameter + off["diameter_offset.offset"]])


slopes = jax.jit(jax.jacfwd(shown, argnums=3), static_argnames=("law", "names"))


def outcome(
    known: PriorInformation, runs: list[PlannedRun], true: np.ndarray, rng: np.random.Generator
) -> Outcome:
    """Simulate the runs of a muscle and fit them."""
    mean, sd, names = known.mean.copy(), known.scale.copy(), known.space.names
    for run in runs:
        for name, reading in run.direct_sds.items():
            if name in names:
                k = names.index(name)
                weight = sd[k] ** -2 + reading**-2
                seen = true[k] + reading * rng.standard_normal()
                mean[k], sd[k] = (mean[k] * sd[k] ** -2 + seen * reading**-2) / weight, weight**-0.5
    moving = [run for run in runs if run.pressure.size]
    pressure, length = (np.concatenate([getattr(r, c) for r in moving]) for c in ("pressure", "length"))
    n, means, muscle_toml = pressure.size, known.capabilities, known.muscle_toml
    assert n <= ROWS
    fixed = {
        "muscle.rest_length": muscle_toml.rest_length.value,
        "muscle.threads": float(muscle_toml.threads or 0),
    }
    fixed |= {"muscle.thread_area": muscle_toml.thread_area.value} if muscle_toml.thread_area else {}

    def padded(values):
        return np.concatenate([values, np.full(ROWS - n, values[-1])])

    truth = np.asarray(shown(known.law, names, fixed, true, padded(pressure), padded(length)))[:, :n]
    noise = rng.standard_normal((4, n))
    measured = truth + np.array([[means.force_sd], [means.diameter_sd]]) * noise[:2]
    pressure, length = (
        padded(pressure + means.pressure_sd * noise[2]),
        padded(length + means.length_sd * noise[3]),
    )
    at = known.law, names, fixed
    step = np.array([1e-3 * pressure.max(), 1e-4 * length.max()])
    by_set = [
        (shown(*at, mean, pressure + step[0], length) - shown(*at, mean, pressure, length)) / step[0],
        (shown(*at, mean, pressure, length + step[1]) - shown(*at, mean, pressure, length)) / step[1],
    ]
    carried = (means.pressure_sd * by_set[0]) ** 2 + (means.length_sd * by_set[1]) ** 2
    noise_sd = np.sqrt(np.array([[means.force_sd], [means.diameter_sd]]) ** 2 + np.asarray(carried)[:, :n])
    used = np.broadcast_to(truth[0] > 0, (2, n)).ravel()

    def residual(u):
        misfit = (np.asarray(shown(*at, mean + sd * u, pressure, length))[:, :n] - measured) / noise_sd
        return np.concatenate([misfit.ravel()[used], u])

    def jacobian(u):
        by = np.asarray(slopes(*at, mean + sd * u, pressure, length))[:, :n] / noise_sd[..., None] * sd
        return np.concatenate([by.reshape(-1, u.size)[used], np.eye(u.size)])

    end = least_squares(residual, np.zeros(mean.size), jac=cast(Any, jacobian), xtol=1e-10)
    k = known.find_index(GOAL)
    after = np.sqrt(np.linalg.inv(end.jac.T @ end.jac)[k, k]) * sd[k]
    return Outcome(float(mean[k] + sd[k] * end.x[k]), float(after), float(true[k]))


def in_minutes(known: PriorInformation, minutes: float) -> list[PlannedRun]:
    """Return ten isobars with the number of samples of the available minutes."""
    usual = list_isobars(known.capabilities, known.muscle_toml.rest_length.value)
    share = minutes / sum(run.minutes for run in usual)
    pressure, length = (np.concatenate([getattr(r, c) for r in usual]) for c in ("pressure", "length"))
    picked = np.linspace(0, pressure.size - 1, round(share * pressure.size)).round().astype(int)
    return [PlannedRun("ten isobars", pressure[picked], length[picked], minutes, {})]


def a_truth(known: PriorInformation, rng: np.random.Generator) -> np.ndarray:
    """Return true parameters of a muscle and its rig, within two standard deviations of the priors."""
    drawn = known.mean + known.scale * np.clip(rng.standard_normal(known.mean.size), -2, 2)
    return np.clip(drawn, np.asarray(known.space.low) + 1e-9 * known.scale, np.asarray(known.space.high))


def alike(seed: int, minutes: float) -> Outcome:
    """Return the result of one muscle with three fixed runs: a ramp, a hold and a rigid bar."""
    rng = np.random.default_rng([20, 1000 + seed])
    known = build_prior_information(*a_muscle(rng, minutes))
    offered = list_runs(known.capabilities, known.muscle_toml.rest_length.value)
    kinds = "ramp", "hold", "steel bar"
    runs = [next(run for run in offered if kind in run.description) for kind in kinds]
    return outcome(known, runs, a_truth(known, rng), rng)


def trial(seed: int, minutes: float) -> tuple[Plan, Outcome, Outcome]:
    """Return the plan of one muscle, its result, and the result of ten isobars."""
    rng = np.random.default_rng([20, seed])
    muscle_toml, means = a_muscle(rng, minutes)
    result = plan(muscle_toml, means, GOAL, to="5 %")
    known = build_prior_information(muscle_toml, means)
    true = a_truth(known, rng)
    planned = [run for count, run in result.chosen_runs for _ in range(count)]
    return (
        result,
        outcome(known, planned, true, rng),
        outcome(known, in_minutes(known, result.minutes), true, rng),
    )


class Interval(NamedTuple):
    """A statistic with its 95 % interval."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.3f} ({self.low:.3f} to {self.high:.3f})"


def interval(values: np.ndarray, function, rng=None) -> Interval:
    """Return a statistic with its 95 % interval, by bootstrap."""
    rng = rng or np.random.default_rng(0)
    again = [function(values[rng.integers(len(values), size=len(values))]) for _ in range(1000)]
    low, high = np.quantile(again, [0.025, 0.975])
    return Interval(float(function(values)), float(low), float(high))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def statistics(trials: list[tuple[Plan, Outcome, Outcome]]) -> dict[str, Any]:
    """Return the statistics of the plans, by label."""
    predicted = np.array([result.sd for result, _, _ in trials])
    true = np.array([p.true for _, p, _ in trials])
    by_plan = np.array([(p.value - p.true) for _, p, _ in trials]) / predicted
    by_isobars = np.array([(i.value - i.true) for _, _, i in trials]) / predicted
    fitted = np.array([p.sd for _, p, _ in trials]) / predicted
    both = np.stack([by_plan, by_isobars], axis=1)
    planned = np.array([result.usual_sd / result.sd for result, _, _ in trials])
    figures = {
        "expected to reach the goal [%]": 100 * float(np.mean([f.reaches_goal for f, _, _ in trials])),
        "minutes of a plan, median": float(np.median([f.minutes for f, _, _ in trials])),
        "fitted sd over predicted sd, rms": interval(fitted, rms),
        "error over predicted sd, rms": interval(by_plan, rms),
        "error over the true value, rms": interval(by_plan * predicted / true, rms),
        "error of ten isobars over plan's, rms": interval(both, lambda b: rms(b[:, 1]) / rms(b[:, 0])),
        "the same as predicted, median": float(np.median(planned)),
    }
    for channel in ("force", "diameter"):
        alone = np.mean([f.single_channel[channel][0] <= f.target_sd * (1 + 1e-9) for f, _, _ in trials])
        figures[f"{channel} alone is predicted to be enough [%]"] = 100 * float(alone)
    return figures


def report(trials: list[tuple[Plan, Outcome, Outcome]]) -> str:
    """Return the statistics as text lines."""
    figures = statistics(trials)
    lines = [
        f"  {name}: {value if isinstance(value, Interval) else f'{value:.3g}'}"
        for name, value in figures.items()
    ]
    return "\n".join([f"{len(trials)} muscles, goal {GOAL} to 5 %", *lines])


def main(muscles: int, minutes: float, how: str, file: Path | None = None) -> None:
    keep_compiled()
    if how == "alike":
        ends = [alike(seed, minutes) for seed in range(muscles)]
        errors = np.array([(estimate.value - estimate.true) / estimate.sd for estimate in ends])
        off = interval(errors, rms)
        print(f"{muscles} muscles, the same runs: error over fitted sd, rms {off}")
        keep(file, {"muscles": muscles, "error over fitted sd, rms": off})
        return
    trials = []
    for seed in range(muscles):
        trials.append(trial(seed, minutes))
        result, planned, usual = trials[-1]
        print(
            f"{seed:4d} {result.minutes:5.1f} min, GPa: predicted {result.sd / 1e9:6.2f}, "
            f"fitted {planned.sd / 1e9:6.2f}, error {(planned.value - planned.true) / 1e9:+7.2f}, "
            f"of isobars {(usual.value - usual.true) / 1e9:+7.2f}",
            flush=True,
        )
    print(report(trials))
    keep(file, {"muscles": muscles} | statistics(trials))


if __name__ == "__main__":
    given, file = arguments()
    words = [*given, *("200", "60", "planned")[len(given) :]]
    main(int(words[0]), float(words[1]), words[2], file)

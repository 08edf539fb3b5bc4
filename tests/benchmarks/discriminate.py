"""Test of predicted power: recommended protocols are simulated, and both candidate mechanisms are refitted.

    python -m tests.benchmarks.discriminate [muscles] [repeats] [--json FILE]

Muscle, bench and noise differ between trials. Each conceals one weak mechanism: an effect of 0.25 to 1 sd of
the noise. The rival is the mechanism that fits the recording best in its place. Muscles whose recording
already separates the two (by the χ² of a tie) are drawn again. The recommended protocol, and one of medium
predicted power, are simulated with the true muscle, `repeats` times with new noise of all four channels.
Both models are then refitted to recording and protocol together, without the approximations of the
prediction. A model is rejected if its χ² increases by more than the predicted limit.

power        fraction of protocols after which the true model is preferred, and the predicted fraction
false alarm  fraction after which the wrong model is preferred; 1 in 20 is predicted

End tapers are excluded, because they take the most time. Each completed muscle is a line of
out/discriminate.jsonl.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from pamjax.benchmark.inject_effect import GroundTruth, inject_effects
from pamjax.benchmark.setups import draw_setup
from pamjax.compile.jax_cache import keep_compiled
from pamjax.diagnosis.detect.score_test import compute_score_directions
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import (
    LibraryProblem,
    build_library_problem,
)
from pamjax.diagnosis.next_experiment.experiment import (
    Experiment,
    choose_experiment,
    evaluate_protocols,
    fit_rival,
)
from pamjax.diagnosis.next_experiment.power import compute_power_and_limit
from pamjax.diagnosis.next_experiment.protocols import PROTOCOL_MENU
from pamjax.diagnosis.next_experiment.testbed import (
    SimulatedTestbed,
    get_direct_readings,
    linearise_difference,
)
from pamjax.diagnosis.refit.least_squares import MapEstimate, fit_parameters
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.diagnosis.select.mechanism_refits import shortlist_candidates
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.planning.compare_pair import fit_baseline, fit_mechanism
from pamjax.records.protocol import Schedule
from tests.benchmarks.keep import arguments, keep
from tests.benchmarks.plan import Interval

#: Sizes of the concealed effects, rms in noise sd, and number of rivals that are tried.
SMALLEST, LARGEST, RIVALS = 0.25, 1.0, 2

#: The most expensive mechanism, which is left out to save time.
COSTLY = "end_taper"

#: Range of predicted powers that are tested, away from 0 and 1, and the most informative value.
MIDDLING, BEST = (0.15, 0.9), 0.6


@dataclass(frozen=True, eq=False)
class Joint:
    """A recording, a later protocol, and direct readings of parameters.

    Attributes:
        first: the recording; source of all other attributes.
        second: the protocol; None if the muscle is not moved.
        places, read, within: indices, values and sd of parameters that are read directly, SI.
        white: noise models of recording and protocol.
    """

    first: LibraryProblem
    second: LibraryProblem | None
    places: tuple[int, ...]
    read: np.ndarray
    within: np.ndarray
    white: tuple[NoiseModel, NoiseModel | None]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.first, name)

    @property
    def measured(self) -> np.ndarray:
        measured = [self.first.measured] + ([self.second.measured] if self.second else [])
        return np.concatenate([*measured, np.tile(self.read, (2, 1))], axis=1)

    def predict_with_jacobian(self, values: np.ndarray, places) -> tuple[np.ndarray, np.ndarray]:
        """Return the outputs and readings, (2, n), and their derivatives, (k, 2, n)."""
        places = list(places)
        outputs = [
            problem.predict_with_jacobian(values, places) for problem in (self.first, self.second) if problem
        ]
        own = np.equal.outer(places, self.places).astype(float)
        values_and_readings = [s for s, _ in outputs] + [np.tile(values[list(self.places)], (2, 1))]
        by = [by for _, by in outputs] + [np.stack([own, own], axis=1)]
        return np.concatenate(values_and_readings, axis=1), np.concatenate(by, axis=2)

    def whiten(self, values: np.ndarray) -> np.ndarray:
        """Return whitened residuals or derivatives of recording, protocol and readings."""
        n, (first, second) = self.first.n, self.white
        more = self.second.n if self.second else 0
        parts = [first.whiten(values[..., :n])]
        if second is not None and second.size:
            parts.append(second.whiten(values[..., n : n + more]))
        return np.concatenate([*parts, values[..., 0, n + more :] / self.within], axis=-1)

    def refit(self, model: ModelFit) -> MapEstimate:
        """Return a model refitted to all data, from its current parameters."""
        white = cast(NoiseModel, self)
        return fit_parameters(cast(LibraryProblem, self), white, model.estimate.free, model.estimate.values)


def simulate_joint(
    stage: SimulatedTestbed,
    id: str,
    a: ModelFit,
    b: ModelFit,
    true: np.ndarray,
    rng: np.random.Generator,
) -> Joint:
    """Return a protocol that is simulated with the true muscle."""
    (protocol,) = (p for p in PROTOCOL_MENU if p.id == id)
    problem, schedule = stage.problem, protocol.build_schedule(stage.rig, stage.start_time)
    sds = get_direct_readings(stage, protocol, a, b)
    places, sd = tuple(sds), np.array(list(sds.values()))
    read = true[list(places)] + sd * rng.standard_normal(len(places))
    second = white = None
    if schedule is not None:
        second, white = simulate_protocol(stage, schedule, a, true, rng)
    return Joint(problem, second, places, read, sd, (a.noise, white))


def simulate_protocol(
    stage: SimulatedTestbed, schedule: Schedule, a: ModelFit, true, rng
) -> tuple[LibraryProblem, NoiseModel]:
    """Return a simulated recording of the moved muscle, with noise of all four channels."""
    n, sensors = schedule.time.size, stage.problem.case.muscle_toml.sensors
    true_outputs = stage.simulate(schedule).predict(true)
    noisy_schedule = dataclasses.replace(
        schedule,
        pressure=schedule.pressure + (sensors.pressure or 0.0) * rng.standard_normal(n),
        length=schedule.length + (sensors.length or 0.0) * rng.standard_normal(n),
    )
    # A slack muscle has no force: a lab omits these rows.
    is_measured = np.isfinite(true_outputs) & (true_outputs[0] > 0)
    is_measured[1] &= schedule.diameter_measured
    noisy = true_outputs + np.array([[stage.sensor_sd[0]], [stage.sensor_sd[1]]]) * rng.standard_normal(
        (2, n)
    )
    problem = dataclasses.replace(
        stage.simulate(noisy_schedule), measured=np.where(is_measured, noisy, np.nan)
    )
    return problem, stage.build_noise(problem, a.estimate.values, is_measured)


def draw_tie(seed: int) -> tuple[GroundTruth, LibraryProblem, ModelFit, ModelFit, int]:
    """Return a recording, its concealed mechanism, the best rival, and the number of rejected muscles."""
    for rejected_count in range(50):
        rng = np.random.default_rng([61, seed, rejected_count])
        envelope = inject_effects(
            1, rng, setup=draw_setup(rng, law="elastic"), smallest=SMALLEST, largest=LARGEST, number=seed
        )
        if not envelope.effect_ids or envelope.effect_ids[0] == COSTLY:
            continue
        problem = build_library_problem(envelope.case)
        (true,) = envelope.effect_ids
        baseline = fit_baseline(problem)
        a = fit_mechanism(problem, baseline, true)
        rivals = [
            m for id in _select_rivals(problem, baseline, true) if (m := fit_rival(problem, a, true, id))
        ]
        b = min(rivals, key=lambda m: m.estimate.chi2_with_priors)
        if abs(b.estimate.chi2_with_priors - a.estimate.chi2_with_priors) < DEFAULT_SETTINGS.tie_chi2:
            return envelope, problem, a, b, rejected_count
    raise RuntimeError(f"no tie in muscle {seed}")


def _select_rivals(problem: LibraryProblem, baseline: ModelFit, true: str) -> list[str]:
    """Return the mechanisms that fit a recording best in place of the true one, in the linear limit."""
    offered = [form for form in build_candidates(problem) if form.id not in (COSTLY, true)]
    directions = compute_score_directions(problem, baseline.noise, baseline.estimate, offered)
    return [fitted.candidate.id for fitted in shortlist_candidates(directions, RIVALS)]


def trial(seed: int, repeats: int) -> dict[str, Any]:
    """Return the predictions for two protocols of one muscle, and their results."""
    envelope, problem, a, b, rejected_count = draw_tie(seed)
    # The lengths were set without an error.
    neutral = dict(zip(problem.names, problem.neutral, strict=True))
    true = np.array([envelope.true_values.get(name, neutral[name]) for name in problem.names])
    stage, first, second = SimulatedTestbed.from_fit(problem, a), a.ids[-1], b.ids[-1]
    menu = evaluate_protocols(stage, a, b, (first, second))
    worse = b.estimate.chi2_with_priors - a.estimate.chi2_with_priors
    rng = np.random.default_rng([62, seed])
    results = []
    for kind, experiment in select_protocols(menu).items():
        (protocol,) = (p for p in PROTOCOL_MENU if p.id == experiment.id)
        delta, of_a, of_b = linearise_difference(stage, protocol, a, b)
        back, back_limit = compute_power_and_limit(-delta, of_b, of_a)
        moves = []
        for _ in range(repeats):
            joint = simulate_joint(stage, experiment.id, a, b, true, rng)
            ends = [joint.refit(model) for model in (a, b)]
            moves.append(ends[1].chi2_with_priors - ends[0].chi2_with_priors - worse)
        results.append(
            {
                "kind": kind,
                "protocol": experiment.id,
                "power": experiment.power,
                "limit": _finite_or_none(experiment.chi2_limit),
                "back": back,
                "back_limit": _finite_or_none(back_limit),
                "worse": moves,
            }
        )
    return {
        "muscle": seed,
        "rejected": rejected_count,
        "mechanisms": (first, second),
        "tie": worse,
        "size": envelope.effect_sizes[0],
        "protocols": results,
    }


def select_protocols(menu: list[Experiment]) -> dict[str, Experiment]:
    """Return the recommended protocol, and another of medium predicted power."""
    recommended = choose_experiment(menu, DEFAULT_SETTINGS)
    rest = [e for e in menu if e is not recommended and MIDDLING[0] < e.power < MIDDLING[1]]
    return {"chosen": recommended} | (
        {"middling": min(rest, key=lambda e: abs(e.power - BEST))} if rest else {}
    )


def _finite_or_none(limit: float) -> float | None:
    return limit if np.isfinite(limit) else None


def report(lines: list[dict[str, Any]]) -> str:
    """Return predicted and reached rates over muscles, with bootstrap intervals over muscles."""
    out = [f"{len(lines)} muscles, {np.mean([x['rejected'] for x in lines]):.1f} rejected before each"]
    for kind in ("chosen", "middling"):
        results = [result for line in lines for result in line["protocols"] if result["kind"] == kind]
        out.append(f"{kind} protocols: {len(results)}")
        out += _words(_compute_rates(results))
    all_results = [result for line in lines for result in line["protocols"]]
    for low, high in ((0.0, 0.3), (0.3, 0.7), (0.7, 0.9), (0.9, 0.99), (0.99, 1.01)):
        in_range = [result for result in all_results if low <= result["power"] < high]
        if in_range:
            out.append(f"predicted {low:.2f} to {min(high, 1):.2f}: {len(in_range)}")
            out += _words(_compute_rates(in_range))
    return "\n".join(out)


def figures(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the rates of the recommended and of the medium protocols, to be stored."""
    kept: dict[str, Any] = {"muscles": len(lines)}
    for kind in ("chosen", "middling"):
        results = [result for line in lines for result in line["protocols"] if result["kind"] == kind]
        kept[f"{kind}, protocols"] = len(results)
        kept |= {f"{kind}, {name}": value for name, value in _compute_rates(results).items()}
    return kept


def _words(rates: dict[str, float | Interval]) -> list[str]:
    return [f"  {name}: {v if isinstance(v, Interval) else f'{v:.3f}'}" for name, v in rates.items()]


def _compute_rates(results: list[dict[str, Any]]) -> dict[str, float | Interval]:
    predicted = np.array([result["power"] for result in results])
    reached = np.array([np.mean(np.array(result["worse"]) > _limit(result["limit"])) for result in results])
    alarms = np.array(
        [np.mean(-np.array(result["worse"]) > _limit(result["back_limit"])) for result in results]
    )
    rng = np.random.default_rng(0)
    resampled = rng.integers(len(results), size=(2000, len(results)))

    def rate(values: np.ndarray) -> Interval:
        low, high = np.quantile(values[resampled].mean(axis=1), [0.025, 0.975])
        return Interval(float(values.mean()), float(low), float(high))

    return {
        "power predicted": float(predicted.mean()),
        "power measured": rate(reached),
        "more than predicted": rate(reached - predicted),
        "false alarms, 0.05 predicted": rate(alarms),
    }


def _limit(limit: float | None) -> float:
    return np.inf if limit is None else limit


def main(muscles: int = 100, repeats: int = 1, file: Path | None = None) -> None:
    keep_compiled()
    trials = Path("out/discriminate.jsonl")
    trials.parent.mkdir(parents=True, exist_ok=True)
    # A killed run may have left an incomplete line.
    whole = [t for t in trials.read_text("utf-8").splitlines() if t.endswith("]}")] if trials.exists() else []
    lines_by_muscle = {line["muscle"]: line for line in map(json.loads, whole)}
    for seed in range(muscles):
        if seed not in lines_by_muscle:
            lines_by_muscle[seed] = trial(seed, repeats)
            with trials.open("a", encoding="utf-8") as out:
                out.write(json.dumps(lines_by_muscle[seed]) + "\n")
    lines = [lines_by_muscle[seed] for seed in range(muscles)]
    print(report(lines))
    keep(file, figures(lines))


if __name__ == "__main__":
    words, file = arguments()
    main(*map(int, words), file=file)

"""Plan of the next runs: which runs to make, their duration, and the expected precision."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pamjax.drawing import DrawableResult
from pamjax.errors import BadInput, check_minimum, suggest_word
from pamjax.model.parameters import find_meaning
from pamjax.notebook import NotebookText
from pamjax.planning.information import PriorInformation
from pamjax.planning.isotonic_runs import build_pressure_ramp, list_isotonic_runs
from pamjax.planning.optimal_design import RunMenu, build_variance_criterion, build_volume_criterion
from pamjax.planning.prior_information import build_prior_information, list_muscle_parameters
from pamjax.planning.rig_capabilities import RigCapabilities, read_capabilities
from pamjax.planning.runs import ISOBAR_CYCLES, PlannedRun, list_isobars, list_runs
from pamjax.records.case import Case, ensure_case_or_toml
from pamjax.records.files import write_atomically
from pamjax.records.reading.muscle_toml import MuscleToml
from pamjax.units import compute_si_factor, format_quantity, parse_number

#: Default goals, the stiffness of the threads, and the default relative precision.
_DEFAULT_GOALS, _DEFAULT_PRECISION = ("thread.modulus", "thread.stiffness"), 0.05

#: Goal that means all parameters of the muscle together.
ALL_PARAMETERS = "all"


@dataclass(frozen=True)
class ExpectedSd:
    """Present value of a parameter, SI, its standard deviation now, and that expected after the plan."""

    value: float
    current_sd: float
    expected_sd: float


@dataclass(frozen=True, eq=False, repr=False)
class Plan(DrawableResult, NotebookText):
    """Runs to make, and the precision that they are expected to reach.

    Attributes:
        prior: information before the plan.
        goal: parameter to determine, or "all".
        target_sd: wanted standard deviation, SI; 0 for the smallest possible.
        chosen_runs: count of each run, and the run, in the order to make them.
        minutes: total duration, min.
        expected_sds: parameters of the muscle, with standard deviations now and expected after the plan.
        reaches_goal: whether the plan is expected to reach the goal.
        single_channel: for each of several channels, the standard deviation of the goal (SI) and the duration
            (min) of the best plan with this channel only.
        usual_sd: standard deviation of the goal after the usual protocol in the same time, SI: ten isobars,
            or pressure ramps at the smallest set force of an isotonic rig.
    """

    prior: PriorInformation
    goal: str
    target_sd: float
    chosen_runs: tuple[tuple[int, PlannedRun], ...]
    minutes: float
    expected_sds: dict[str, ExpectedSd]
    reaches_goal: bool
    single_channel: dict[str, tuple[float, float]]
    usual_sd: float

    @property
    def rows(self) -> int:
        """Return the number of samples to record."""
        return sum(count * run.pressure.size for count, run in self.chosen_runs)

    @property
    def sd(self) -> float:
        """Return the expected standard deviation of the goal, SI; for "all", of the first parameter."""
        return self.expected_sds[
            next(iter(self.expected_sds)) if self.goal == ALL_PARAMETERS else self.goal
        ].expected_sd

    def schedule(self) -> pd.DataFrame:
        """Return the table of pressure and length, or set force, to command, with the run of each sample."""
        recorded_runs = [run for count, run in self.chosen_runs for _ in range(count) if run.pressure.size]
        step, start_time, tables = 1 / self.prior.capabilities.rate, 0.0, []
        for k, run in enumerate(recorded_runs, 1):
            second = {"length [mm]": run.length * 1e3} if run.load is None else {"force [N]": run.load}
            time = start_time + step * np.arange(run.pressure.size)
            table = {"time [s]": time, "pressure [kPa]": run.pressure / 1e3, **second, "cycle": k}
            tables.append(pd.DataFrame(table))
            start_time += 60 * run.minutes
        return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as it is written to plan.json, in display units."""

        def describe(name: str, expected: ExpectedSd) -> dict[str, Any]:
            meaning = find_meaning(name)
            scale = compute_si_factor(meaning.show)
            return {
                "value": expected.value / scale,
                "sd_before": expected.current_sd / scale if math.isfinite(expected.current_sd) else None,
                "sd_after": expected.expected_sd / scale,
                "unit": meaning.show,
            }

        from pamjax.planning.report import format_plan_sentence

        isotonic = self.prior.capabilities.measures_length
        scale = 1.0 if self.goal == ALL_PARAMETERS else compute_si_factor(find_meaning(self.goal).show)
        return {
            "schema": "pamjax.plan/2",
            "muscle": self.prior.muscle_toml.name,
            "says": format_plan_sentence(self),
            "goal": {"parameter": self.goal, "sd": self.target_sd / scale, "reached": self.reaches_goal},
            "runs": [
                {"count": n, "run": run.description, "minutes": n * run.minutes}
                for n, run in self.chosen_runs
            ],
            "minutes": self.minutes,
            "rows": self.rows,
            "parameters": {name: describe(name, expected) for name, expected in self.expected_sds.items()},
            "single_channels": {
                c: {"sd": sd / scale, "minutes": m} for c, (sd, m) in self.single_channel.items()
            },
            f"{'ramps' if isotonic else 'ten_isobars'}_in_the_same_time": {"sd": self.usual_sd / scale},
            "misfit_over_noise": dict(self.prior.misfit_ratios),
            "assumed_sds": dict(self.prior.capabilities.assumed_sds),
        }

    def __str__(self) -> str:
        from pamjax.planning.report import format_plan_summary

        return format_plan_summary(self)


def plan(
    muscle: MuscleToml | Case | str | Path,
    rig: Path | RigCapabilities | None = None,
    goal: str | None = None,
    to: str | float | None = None,
    *,
    minutes: float | None = None,
    law: str | None = None,
    seed: int = 0,
) -> Plan:
    """Choose the next runs of a muscle on a rig.

    Args:
        muscle: content of muscle.toml, or a case with its recording, or the path of either.
        rig: TOML file with a table [rig], or the capabilities; None uses the sensors of muscle.toml and the
            channels of the case.
        goal: parameter to determine, such as "thread.modulus", or "all"; None is the stiffness of the
            threads.
        to: wanted standard deviation of the goal, "5 %" or "4 GPa" (a number: SI). None is 5 %, and the
            smallest possible value for "all".
        minutes: available time, min; None uses that of the rig.
        law: thread law; None uses that of the baseline model.
        seed: random seed for the parameter values over which the expected precision is averaged.

    Returns:
        the `Plan`; `print` shows its summary, `schedule` returns its commands as a table.

    Raises:
        BadInput: for an unknown goal, or one that is no free parameter of a fit.

    Example:
        plan = pamjax.plan("mine", goal="thread.modulus", to="5 %")
        plan.schedule().to_csv("commands.csv", index=False)
    """
    check_minimum("seed", seed, 0)
    source = ensure_case_or_toml(muscle)
    case, muscle_toml = (source, source.muscle_toml) if isinstance(source, Case) else (None, source)
    limits_of_recording: dict[str, Any] = (
        {"max_recorded_pressure": _find_highest_pressure(case)} if case else {}
    )
    if case:
        limits_of_recording["recorded_channels"] = case.recording.channels
        if case.recording.measures_length:
            force = case.recording.force
            limits_of_recording["recorded_loads"] = float(np.nanmin(force)), float(np.nanmax(force))
    if isinstance(rig, RigCapabilities):
        capabilities = rig if minutes is None else replace(rig, minutes=minutes)
    else:
        capabilities = read_capabilities(muscle_toml, rig, **limits_of_recording, minutes=minutes)
    # The information of a recording takes seconds: a wrong goal is refused before.
    goal = _resolve_goal([n.name for n in list_muscle_parameters(muscle_toml, law, case)], goal)
    prior = build_prior_information(muscle_toml, capabilities, law, case)
    target_sd = _resolve_target_sd(prior, goal, to)
    run_menu, offered_runs = _build_menu(prior, goal, target_sd, seed)
    counts = run_menu.choose_runs()
    sds_after_plan = _compute_sds(prior, run_menu.compute_information(counts))
    total_minutes = float(counts @ run_menu.minutes)
    single_channel = {}
    if len(capabilities.channels) > 1 and goal != ALL_PARAMETERS:
        # An isotonic rig always measures the length.
        for channel in capabilities.channels[: 1 if capabilities.measures_length else None]:
            channel_prior = build_prior_information(
                muscle_toml, capabilities.keep_channel(channel), law, case
            )
            channel_menu, _ = _build_menu(channel_prior, goal, target_sd, seed)
            best = channel_menu.choose_runs()
            single_channel[channel] = (
                _compute_sds(channel_prior, channel_menu.compute_information(best))[
                    channel_prior.find_index(goal)
                ],
                float(best @ channel_menu.minutes),
            )
    usual_sds = _compute_usual_sds(prior, run_menu, total_minutes)
    indices = (
        prior.muscle_indices
        if goal == ALL_PARAMETERS
        else [prior.find_index(goal), *(k for k in prior.muscle_indices if k != prior.find_index(goal))]
    )
    current_sds = _compute_sds(prior, run_menu.prior_matrix)
    return Plan(
        prior=prior,
        goal=goal,
        target_sd=target_sd,
        chosen_runs=tuple((int(n), run) for n, run in zip(counts, offered_runs, strict=True) if n),
        minutes=total_minutes,
        expected_sds={
            prior.space.names[k]: ExpectedSd(
                *(float(x[k]) for x in (prior.mean, current_sds, sds_after_plan))
            )
            for k in indices
        },
        reaches_goal=bool(run_menu.compute_criterion(counts) <= run_menu.goal) if target_sd else True,
        single_channel=single_channel,
        usual_sd=float(usual_sds[indices[0]]),
    )


def _find_highest_pressure(case: Case) -> float:
    """Return the highest recorded pressure, Pa."""
    return float(np.max(case.recording.pressure[case.recording.usable]))


def _build_menu(
    prior: PriorInformation, goal: str, target_sd: float, seed: int
) -> tuple[RunMenu, list[PlannedRun]]:
    offered_runs = _list_offered_runs(prior)
    shortest = min(run.minutes for run in offered_runs if run.pressure.size)
    if prior.capabilities.minutes < shortest:
        rule = f"the shortest run of this rig takes {shortest:.2g} min"
        got = f"{prior.capabilities.minutes:g} min for all runs"
        raise BadInput.from_rule(rule, got, remedy="Increase `minutes`.")
    draws = prior.draw_parameters(seed=seed)
    run_matrices = np.stack([prior.compute_run_information(offered_runs, values) for values in draws], axis=1)
    k = 0 if goal == ALL_PARAMETERS else prior.find_index(goal)
    return RunMenu(
        prior_matrix=np.broadcast_to(prior.matrix, (len(draws), *prior.matrix.shape)),
        run_matrices=run_matrices,
        minutes=np.array([run.minutes for run in offered_runs]),
        once_only=np.array([not run.is_repeatable for run in offered_runs]),
        criterion=build_volume_criterion(prior.muscle_indices)
        if goal == ALL_PARAMETERS
        else build_variance_criterion(k),
        budget=prior.capabilities.minutes,
        goal=0.0 if goal == ALL_PARAMETERS else (target_sd / prior.scale[k]) ** 2,
    ), offered_runs


def _list_offered_runs(prior: PriorInformation) -> list[PlannedRun]:
    if prior.capabilities.measures_length:
        return list_isotonic_runs(prior.capabilities)
    return list_runs(prior.capabilities, prior.muscle_toml.rest_length.value)


def _compute_sds(prior: PriorInformation, information: np.ndarray) -> np.ndarray:
    """Return (p,) expected standard deviations, SI: roots of the mean variances over the draws."""
    variance = np.diagonal(np.linalg.inv(information), axis1=-2, axis2=-1).mean(axis=0)
    return np.sqrt(variance) * prior.scale


def _compute_usual_sds(prior: PriorInformation, run_menu: RunMenu, minutes: float) -> np.ndarray:
    """Return (p,) standard deviations after the usual protocol, scaled to the same total time, SI."""
    usual_runs = _list_usual_runs(prior)
    run_matrices = np.stack(
        [prior.compute_run_information(usual_runs, values).sum(axis=0) for values in prior.draw_parameters()]
    )
    share = minutes / sum(run.minutes for run in usual_runs)
    return _compute_sds(prior, run_menu.prior_matrix + share * run_matrices)


def _list_usual_runs(prior: PriorInformation) -> list[PlannedRun]:
    """Return one cycle of ten isobars; on an isotonic rig, a pressure ramp at the smallest set force."""
    if prior.capabilities.measures_length:
        return [build_pressure_ramp(prior.capabilities, prior.capabilities.loads[0])]
    isobar_runs = list_isobars(prior.capabilities, prior.muscle_toml.rest_length.value)
    return isobar_runs[::ISOBAR_CYCLES]


def _resolve_goal(own_names: list[str], goal: str | None) -> str:
    if goal is None:
        goal = next((name for name in _DEFAULT_GOALS if name in own_names), ALL_PARAMETERS)
    if goal != ALL_PARAMETERS and goal not in own_names:
        rule = f"{goal!r} is no free parameter of this muscle"
        raise BadInput.from_rule(rule, remedy=suggest_word(goal, [*own_names, ALL_PARAMETERS]))
    return goal


def _resolve_target_sd(prior: PriorInformation, goal: str, to: str | float | None) -> float:
    if goal == ALL_PARAMETERS:
        if to is not None:
            remedy = "Omit `to`, or name one parameter as goal."
            raise BadInput.from_rule(
                "the goal `all` has no wanted standard deviation", f"{to}", "`to`", remedy
            )
        return 0.0
    value = abs(float(prior.mean[prior.find_index(goal)]))
    if to is None:
        return _DEFAULT_PRECISION * value
    if isinstance(to, str) and to.strip().endswith("%"):
        target_sd = float(parse_number(to.strip()[:-1], "1", "`to`")) / 100 * value
    else:
        target_sd = parse_number(str(to), find_meaning(goal).unit, "`to`")
    if not 0 < target_sd < math.inf:
        raise BadInput.from_rule(
            "a wanted standard deviation must be positive",
            format_quantity(target_sd, find_meaning(goal).show),
            "`to`",
        )
    return target_sd


def save_plan(plan: Plan, folder: Path) -> list[Path]:
    """Write plan.json and schedule.csv atomically and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    texts = {
        "plan.json": json.dumps(plan.as_dict(), indent=1, allow_nan=False) + "\n",
        "schedule.csv": plan.schedule().to_csv(index=False, float_format="%.6g"),
    }
    for name, text in texts.items():
        with write_atomically(folder / name) as temporary:
            temporary.write_text(text)
    return [folder / name for name in texts]


def compute_sd_course(plan: Plan, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the elapsed minutes, and a parameter's expected sd (SI), before and after each run of a plan."""
    prior, k = plan.prior, plan.prior.find_index(name)
    done_runs = [run for count, run in plan.chosen_runs for _ in range(count)]
    if not done_runs:
        return np.zeros(1), _compute_sds(prior, prior.matrix[None])[k : k + 1]
    run_matrices = np.stack(
        [prior.compute_run_information(done_runs, values) for values in prior.draw_parameters()], axis=1
    )
    matrices = prior.matrix + np.concatenate(
        [np.zeros_like(run_matrices[:1]), np.cumsum(run_matrices, axis=0)]
    )
    sds = np.array([_compute_sds(prior, information)[k] for information in matrices])
    return np.cumsum([0.0, *(run.minutes for run in done_runs)]), sds

"""Small simulated recordings with known effects, and their diagnoses.

Each recording has the 438 rows of the reference protocol: two strokes at each of five pressures. The baseline
is inelastic and the threads have no stated modulus, so that stretch of the threads is one of the mechanisms
that a diagnosis can name. All recordings share one compiled program.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from pamjax import diagnose
from pamjax.benchmark.inject_effect import GroundTruth, inject_effects
from pamjax.benchmark.setups import Setup, build_reference_setup
from pamjax.diagnosis.library.library_problem import LibraryProblem, build_library_problem
from pamjax.diagnosis.result import Diagnosis
from pamjax.records.case import Case
from pamjax.records.recording import Recording

#: Probability from which a named mechanism counts as certain.
CERTAIN_PROBABILITY = 0.9


@dataclass(frozen=True)
class BankRecording:
    """Definition of a simulated recording; the same definition gives the same recording.

    Attributes:
        effect_count: number of injected mechanisms.
        seed: seed of the muscle, of the effects and of the noise.
        only: id of the only mechanism to inject; None draws the mechanisms.
        smallest, largest: range of effect sizes, rms in noise standard deviations.
        correlation: noise correlation of neighbouring samples of force and of diameter.
        unmodelled: key of `UNMODELLED_FORCES`, for an effect outside the library; None for none.
        pressures: indices of the pressures in the recording, from the lowest of five.
    """

    effect_count: int = 0
    seed: int = 4
    only: str | None = None
    smallest: float = 3.0
    largest: float = 3.0
    correlation: float = 0.5
    unmodelled: str | None = None
    pressures: tuple[int, ...] = (0, 1, 2, 3, 4)


def build_setup() -> Setup:
    """Return the muscle and the protocol of all recordings."""
    reference = build_reference_setup()
    return replace(reference, muscle_toml=replace(reference.muscle_toml, baseline="inelastic", modulus=None))


def _compute_obstacle_force(recording: Recording) -> np.ndarray:
    """Return the force of an elastic stop that the muscle touches at 12 % contraction, N."""
    rest_length = build_setup().muscle_toml.rest_length.value
    return 1300.0 * np.maximum(1 - recording.length / rest_length - 0.12, 0.0)


def _compute_zero_step(recording: Recording) -> np.ndarray:
    """Return the change of the force zero by 15 N after 55 % of the time, N."""
    assert recording.time is not None
    return np.where(recording.time > 0.55 * recording.time[-1], 15.0, 0.0)


def _compute_ripple(recording: Recording) -> np.ndarray:
    """Return a force of 20 N that changes its sign every 1.5 mm of length, N."""
    return 20.0 * np.sin(2 * np.pi * recording.length / 3e-3)


def _compute_bending_force(recording: Recording) -> np.ndarray:
    """Return the force that a muscle loses by bending beyond 8 % contraction at low pressure, N."""
    slackness = np.maximum(1 - recording.pressure / (0.45 * recording.pressure.max()), 0.0)
    contraction = 1 - recording.length / build_setup().muscle_toml.rest_length.value
    return -6000.0 * slackness * np.maximum(contraction - 0.08, 0.0)


#: Forces outside the library by name.
UNMODELLED_FORCES: dict[str, Callable[[Recording], np.ndarray]] = {
    "obstacle": _compute_obstacle_force,
    "zero_step": _compute_zero_step,
    "ripple": _compute_ripple,
    "bending": _compute_bending_force,
}


@cache
def simulate_bank(definition: BankRecording) -> GroundTruth:
    """Return the recording of a definition and its injected effects."""
    setup = build_setup()
    pressures = np.unique(setup.plan.pressure)[list(definition.pressures)]
    setup = replace(setup, plan=setup.plan.select(np.isin(setup.plan.pressure, pressures)))
    ground_truth = inject_effects(
        definition.effect_count, np.random.default_rng(definition.seed), setup=setup, only=definition.only,
        smallest=definition.smallest, largest=definition.largest, correlation=definition.correlation,
    )  # fmt: skip
    assert len(ground_truth.effect_ids) == definition.effect_count
    if definition.unmodelled is None:
        return ground_truth
    recording = ground_truth.case.recording
    force = recording.force + UNMODELLED_FORCES[definition.unmodelled](recording)
    return replace(ground_truth, case=replace_recording(ground_truth.case, force=force))


@cache
def diagnose_bank(definition: BankRecording) -> Diagnosis:
    """Return the diagnosis of a recording with the ordinary settings."""
    return diagnose(simulate_bank(definition).case)


@cache
def build_plan_problem() -> LibraryProblem:
    """Return the problem of the protocol before its simulation: real limits and priors, nothing compiled."""
    setup = build_setup()
    return build_library_problem(Case("bank", Path("bank"), setup.muscle_toml, setup.plan, "simulated"))


@cache
def simulate_without_noise() -> LibraryProblem:
    """Return the problem of the protocol with the readings of the stated muscle."""
    problem = build_plan_problem()
    return replace_readings(problem, problem.predict(problem.neutral))


def replace_readings(problem: LibraryProblem, measured: np.ndarray) -> LibraryProblem:
    """Return a problem with other readings of force (N) and diameter (m), (2, n); NaN where there is none."""
    return replace(problem, measured=measured)


def replace_recording(case: Case, **channels: np.ndarray) -> Case:
    """Return a case with other values of some channels, (n,) each, SI."""
    return replace(case, recording=replace(case.recording, **channels))


def list_missing(diagnosis: Diagnosis, injected: Iterable[str]) -> list[str]:
    """Return the injected ids that neither a reported mechanism nor one of its ties has."""
    reported = {
        id
        for mechanism in diagnosis.named_mechanisms
        if mechanism.probability >= diagnosis.settings.established_probability
        for id in (mechanism.id, *mechanism.indistinguishable)
    }
    return [id for id in injected if id not in reported]


def list_certain_errors(diagnosis: Diagnosis, injected: Iterable[str]) -> list[str]:
    """Return the certain mechanisms that were not injected and are not tied with an injected one."""
    injected = set(injected)
    return [
        mechanism.id
        for mechanism in diagnosis.named_mechanisms
        if mechanism.probability >= CERTAIN_PROBABILITY
        and not injected & {mechanism.id, *mechanism.indistinguishable}
    ]


def check_no_misfit(diagnosis: Diagnosis) -> None:
    """Assert that a diagnosis reports nothing."""
    assert not diagnosis.is_detected
    assert diagnosis.named_mechanisms == ()
    assert not diagnosis.unexplained


def check_unexplained(diagnosis: Diagnosis) -> None:
    """Assert that a diagnosis reports an effect outside the library, and no mechanism as certain."""
    assert diagnosis.is_detected
    assert diagnosis.unexplained
    assert list_certain_errors(diagnosis, ()) == []


def check_identified(diagnosis: Diagnosis, injected: Iterable[str]) -> None:
    """Assert that every injected mechanism is reported, that no error is certain, and nothing is left."""
    injected = tuple(injected)
    assert diagnosis.is_detected
    assert list_missing(diagnosis, injected) == []
    assert list_certain_errors(diagnosis, injected) == []
    assert not diagnosis.unexplained

"""The next experiment: the protocol that distinguishes mechanisms this recording cannot, with its power."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pamjax.diagnosis.detect.score_test import compute_score_directions
from pamjax.diagnosis.library.candidates import Candidate, build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.next_experiment.isotonic_protocols import ISOTONIC_MENU
from pamjax.diagnosis.next_experiment.power import compute_power_and_limit
from pamjax.diagnosis.next_experiment.protocols import PROTOCOL_MENU
from pamjax.diagnosis.next_experiment.testbed import SimulatedTestbed, linearise_difference
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.refit.model_fit import (
    ModelFit,
    get_free_indices,
    switch_off_candidate,
    switch_on_candidate,
)
from pamjax.diagnosis.select.mechanism_refits import refit_fully
from pamjax.diagnosis.select.rivals import NamedMechanism
from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.progress import Progress, ignore_progress

#: Shares of the linear amplitudes of a rival from which a refit starts.
_START_AMPLITUDE_SHARES = (1.0, 0.1)


@dataclass(frozen=True)
class Experiment:
    """A protocol that distinguishes mechanisms.

    Attributes:
        protocol: instruction, one sentence.
        separates: ids of the mechanisms that it distinguishes.
        power: probability that it identifies the true mechanism at the false-alarm rate of the settings.
        minutes: duration, min.
        id: id of the protocol in the list.
        chi2_limit: increase of χ² at which the second model is rejected.
    """

    protocol: str
    separates: tuple[str, ...]
    power: float
    minutes: float = 0.0
    id: str = ""
    chi2_limit: float = math.inf

    def as_dict(self) -> dict[str, Any]:
        """Return the experiment as it is written to diagnosis.json."""
        return {"protocol": self.protocol, "separates": list(self.separates), "power": self.power}


def propose_experiments(
    build_testbed: Callable[[], SimulatedTestbed],
    problem: LibraryProblem,
    fit: ModelFit,
    named_mechanisms: Sequence[NamedMechanism],
) -> list[Experiment]:
    """Return protocols that distinguish each identified mechanism from its indistinguishable rivals.

    Args:
        build_testbed: returns muscle, rig and noise of the recording.
        problem: the recording and the library; its rows can be means of those of the testbed.
        fit: the model with the identified mechanisms, refitted to this problem.
        named_mechanisms: the identified mechanisms with their rivals.

    Returns:
        one experiment for each chosen protocol; empty without rivals. The protocols of an isotonic recording
        set the force and measure the length.
    """
    pairs = [
        (name.id, rival)
        for name in named_mechanisms
        for rival in sorted(
            name.indistinguishable, key=lambda id, name=name: name.rival_bic_increase.get(id, np.inf)
        )[: problem.settings.max_rivals_per_mechanism]
    ]
    pairs = list({frozenset(pair): pair for pair in reversed(pairs)}.values())[::-1][
        : problem.settings.max_rival_pairs
    ]
    if not pairs:
        return []
    testbed = build_testbed()
    best = {}
    for name, rival in pairs:
        rival_fit = fit_rival(problem, fit, name, rival)
        if rival_fit is not None:
            best[name, rival] = choose_experiment(
                evaluate_protocols(testbed, fit, rival_fit, (name, rival)), problem.settings
            )
    return _merge_by_protocol(list(best.values()))


def _merge_by_protocol(experiments: list[Experiment]) -> list[Experiment]:
    """Return one experiment for each protocol, with all it distinguishes and the lowest power."""
    out: dict[str, Experiment] = {}
    for experiment in experiments:
        known_experiment = out.get(experiment.protocol)
        if known_experiment is not None:
            ids = tuple(dict.fromkeys((*known_experiment.separates, *experiment.separates)))
            experiment = dataclasses.replace(
                experiment, separates=ids, power=min(experiment.power, known_experiment.power)
            )
        out[experiment.protocol] = experiment
    return list(out.values())


def choose_experiment(experiments: Sequence[Experiment], settings: DiagnosisSettings) -> Experiment:
    """Return the shortest experiment with sufficient power, else the one with the highest power."""
    powerful = [experiment for experiment in experiments if experiment.power >= settings.sufficient_power]
    return min(powerful, key=lambda e: e.minutes) if powerful else max(experiments, key=lambda e: e.power)


def evaluate_protocols(
    testbed: SimulatedTestbed,
    fit: ModelFit,
    rival_fit: ModelFit,
    ids: tuple[str, str],
    progress: Progress = ignore_progress,
) -> list[Experiment]:
    """Return every protocol of the list with its power to distinguish two models."""
    out, settings = [], testbed.problem.settings
    menu = PROTOCOL_MENU if testbed.rig.load is None else ISOTONIC_MENU
    for k, protocol in enumerate(menu):
        progress("simulating protocols", 0.5 + 0.5 * k / len(menu))
        power, chi2_limit = compute_power_and_limit(
            *linearise_difference(testbed, protocol, fit, rival_fit),
            draws=settings.power_draws,
            false_alarm_rate=settings.false_alarm_rate,
        )
        minutes = protocol.compute_minutes(testbed.rig)
        description = f"{protocol.describe(testbed.rig)} ({_format_duration(minutes)})"
        out.append(Experiment(description, ids, round(power, 3), minutes, protocol.id, chi2_limit))
    return out


def _format_duration(minutes: float) -> str:
    return f"{minutes:.0f} min" if minutes < 90 else f"{minutes / 60:.0f} h"


def fit_rival(problem: LibraryProblem, fit: ModelFit, name: str, rival: str) -> ModelFit | None:
    """Return the model refitted with a rival instead of a mechanism; None if the rival is not testable."""
    candidate = next((f for f in fit.mechanisms if f.id == name), None)
    candidates = [f for f in build_candidates(problem) if f.id == rival]
    if candidate is None or not candidates:
        return None
    remaining = tuple(f for f in fit.mechanisms if f is not candidate)
    reduced_estimate = fit_parameters(
        problem,
        fit.noise,
        get_free_indices(problem, remaining),
        switch_off_candidate(problem, fit.estimate.values, candidate),
    )
    return fit_best_rival(problem, ModelFit(remaining, fit.noise, reduced_estimate), candidates)


def fit_best_rival(
    problem: LibraryProblem, reduced_fit: ModelFit, candidates: Sequence[Candidate]
) -> ModelFit:
    """Return the best refit of a model with one more candidate.

    The best candidate of the linear approximation can have an amplitude far outside its limits. Therefore
    several candidates are refitted, each from its linear amplitude and from a share of it.
    """
    best_directions = sorted(
        compute_score_directions(problem, reduced_fit.noise, reduced_fit.estimate, candidates),
        key=lambda s: -s.chi2_reduction,
    )[: problem.settings.rival_candidates_refitted]
    rough_fits = []
    for score_direction in best_directions:
        mechanisms = (*reduced_fit.mechanisms, score_direction.candidate)
        for share in _START_AMPLITUDE_SHARES:
            values = switch_on_candidate(
                problem,
                reduced_fit.estimate.values,
                score_direction.candidate,
                share * score_direction.amplitudes,
            )
            estimate = fit_parameters(
                problem,
                reduced_fit.noise,
                get_free_indices(problem, mechanisms),
                values,
                problem.settings.rough_evaluations,
                is_rough=True,
            )
            rough_fits.append(ModelFit(mechanisms, reduced_fit.noise, estimate))
    best = sorted(rough_fits, key=lambda m: m.estimate.chi2_with_priors)[: problem.settings.final_refit_count]
    return min(refit_fully(problem, best), key=lambda m: m.corrected_chi2)

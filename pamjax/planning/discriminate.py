"""Discrimination between two mechanisms: the power of each protocol to identify the true one.

The power is the probability that a test between the two mechanisms identifies the true one. It is valid only
if one of the two explains the recording. The residual test of a diagnosis checks this first, and the report
states it if neither mechanism explains the recording.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.diagnosis.detect.residual_test import is_residual_significant, run_residual_test
from pamjax.diagnosis.detect.significance import ResidualTest
from pamjax.diagnosis.library.candidates import MECHANISMS_NEEDING_TIME, build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem, build_library_problem
from pamjax.diagnosis.next_experiment.experiment import (
    Experiment,
    choose_experiment,
    evaluate_protocols,
    fit_best_rival,
    fit_rival,
)
from pamjax.diagnosis.next_experiment.testbed import SimulatedTestbed
from pamjax.diagnosis.refit.model_fit import ModelFit, fit_model
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.errors import BadInput
from pamjax.model.registry import find_mechanism
from pamjax.notebook import NotebookText
from pamjax.progress import Progress, ignore_progress
from pamjax.records.case import Case, ensure_case
from pamjax.records.files import write_atomically

#: Largest number of protocols in a summary.
_MAX_LISTED_PROTOCOLS = 6


@dataclass(frozen=True, eq=False, repr=False)
class Discrimination(NotebookText):
    """Two mechanisms, their fits to a recording, and the protocols that distinguish them.

    Attributes:
        case: the recording.
        ids: ids of the two mechanisms.
        chi2_difference: χ² of the second minus χ² of the first on the recording.
        testbed: rig and noise estimated from the recording, for the simulation of protocols.
        experiments: every protocol with its power.
        chosen_experiment: the shortest protocol with sufficient power, else the most powerful one.
        residual_tests: residual test of the fit with the first and with the second mechanism.
        neither_explains: whether the residuals of both are larger than noise and typical form errors.
    """

    case: Case
    ids: tuple[str, str]
    chi2_difference: float
    testbed: SimulatedTestbed
    experiments: tuple[Experiment, ...]
    chosen_experiment: Experiment
    residual_tests: tuple[ResidualTest, ResidualTest]
    neither_explains: bool

    @property
    def ranked_experiments(self) -> list[Experiment]:
        """Return the protocols by decreasing power; of equal power the shortest first."""
        return sorted(
            self.experiments, key=lambda experiment: (-round(experiment.power, 2), experiment.minutes)
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the discrimination as it is written to discrimination.json."""
        return {
            "schema": "pamjax.discrimination/1",
            "case": self.case.name,
            "mechanisms": list(self.ids),
            "chi2_difference": self.chi2_difference,
            "explained": not self.neither_explains,
            "says": self.comparison_sentence,
            "residual_tests": {
                id: {"p_value": residual_test.p_value, "rms_over_noise": math.sqrt(residual_test.mean_square)}
                for id, residual_test in zip(self.ids, self.residual_tests, strict=True)
            },
            "next_experiment": self.chosen_experiment.as_dict(),
            "protocols": [
                experiment.as_dict() | _describe_experiment(experiment) for experiment in self.experiments
            ],
        }

    def __str__(self) -> str:
        wanted_power, alarm = DEFAULT_SETTINGS.sufficient_power, DEFAULT_SETTINGS.false_alarm_rate
        condition = "if one of them is present nevertheless" if self.neither_explains else "next experiment"
        lines = [
            f"{self.case.name}: {self.comparison_sentence}",
            f"  {condition}: {self.chosen_experiment.protocol}",
            f"  power {self.chosen_experiment.power:.2f} at a false-alarm rate of {alarm:.0%}"
            + (
                "" if self.chosen_experiment.power >= wanted_power else f", below the wanted {wanted_power:g}"
            ),
            "",
        ]
        return "\n".join(
            lines
            + [
                f"  {experiment.power:5.2f}  {experiment.id:<4} {experiment.protocol}"
                for experiment in self.ranked_experiments[:_MAX_LISTED_PROTOCOLS]
            ]
        )

    @property
    def comparison_sentence(self) -> str:
        """Return which mechanism fits the recording better; or that neither explains it."""
        first, second = self.ids
        better, worse = (first, second) if self.chi2_difference > 0 else (second, first)
        if self.neither_explains:
            return f"neither {first} nor {second} explains this recording: {self.residual_summary}"
        return f"{better} fits this recording better than {worse}, by {abs(self.chi2_difference):.3g} in χ²"

    @property
    def residual_summary(self) -> str:
        """Return the residuals of both mechanisms over the noise, and the next step."""
        pairs = zip(self.ids, self.residual_tests, strict=True)
        residuals = ", ".join(
            f"{math.sqrt(residual_test.mean_square):.2g} with {id}" for id, residual_test in pairs
        )
        return f"the rms residual over noise is {residuals}; run `pamjax diagnose` first"


def _describe_experiment(experiment: Experiment) -> dict[str, Any]:
    limit = experiment.chi2_limit if math.isfinite(experiment.chi2_limit) else None
    return {"id": experiment.id, "minutes": experiment.minutes, "limit": limit}


def discriminate(
    case: Case | str | Path,
    first: str,
    second: str,
    progress: Progress = ignore_progress,
) -> Discrimination:
    """Return the protocol that best distinguishes two mechanisms on the rig of a recording.

    Args:
        case: the recording, or its folder.
        first, second: ids of the mechanisms.
        progress: called with the current step and the completed share.

    Returns:
        the `Discrimination`; `print` shows its summary.

    Raises:
        BadInput: for an unknown id, or a mechanism without effect on this recording.

    Example:
        print(pamjax.discriminate("rubbed", "braid_friction", "viscoelastic_creep"))
    """
    case = ensure_case(case)
    for id in (first, second):
        find_mechanism(id)
    if first == second:
        raise BadInput.from_rule(
            "a discrimination needs two different mechanisms", f"{first!r} twice", remedy="Name another one."
        )
    library_problem = build_library_problem(case)
    available_ids = {candidate.id for candidate in build_candidates(library_problem)}
    for id in (first, second):
        if id not in available_ids:
            raise _build_unavailable_error(id, case)
    progress("fitting mechanisms", 0.1)
    baseline = fit_baseline(library_problem)
    first_fit = fit_mechanism(library_problem, baseline, first)
    second_fit = fit_rival(library_problem, first_fit, first, second)
    assert second_fit is not None
    progress("testing residuals", 0.3)
    residual_tests = (
        run_residual_test(library_problem, first_fit),
        run_residual_test(library_problem, second_fit),
    )
    baseline_test = run_residual_test(library_problem, baseline)
    progress("simulating protocols", 0.5)
    testbed = SimulatedTestbed.from_fit(library_problem, first_fit)
    experiments = evaluate_protocols(testbed, first_fit, second_fit, (first, second))
    return Discrimination(
        case,
        (first, second),
        second_fit.corrected_chi2 - first_fit.corrected_chi2,
        testbed,
        tuple(experiments),
        choose_experiment(experiments, library_problem.settings),
        residual_tests,
        all(
            is_residual_significant(baseline_test, residual_test, library_problem.settings)
            for residual_test in residual_tests
        ),
    )


def fit_baseline(library_problem: LibraryProblem) -> ModelFit:
    """Return the fit of the baseline model alone."""
    return fit_model(library_problem, np.ones(library_problem.n, dtype=bool), (), library_problem.neutral)


def fit_mechanism(library_problem: LibraryProblem, baseline: ModelFit, id: str) -> ModelFit:
    """Return the fit of the baseline model with one mechanism in its best form."""
    start_fit = fit_best_rival(
        library_problem,
        baseline,
        [candidate for candidate in build_candidates(library_problem) if candidate.id == id],
    )
    return fit_model(
        library_problem,
        np.ones(library_problem.n, dtype=bool),
        start_fit.mechanisms,
        start_fit.estimate.values,
    )


def _build_unavailable_error(id: str, case: Case) -> BadInput:
    if id in MECHANISMS_NEEDING_TIME and not case.recording.has_time:
        rule = f"mechanism {id!r} needs time"
        remedy = "Record strokes first: `plan` proposes runs."
        return BadInput.from_rule(rule, "a table without time", case.name, remedy)
    rule = "both mechanisms must have an effect on the recording that its baseline does not include"
    return BadInput.from_rule(rule, f"{id!r} without such an effect", case.name, "Name another mechanism.")


def save_discrimination(discrimination: Discrimination, folder: Path) -> list[Path]:
    """Write discrimination.json atomically and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    with write_atomically(folder / "discrimination.json") as temporary:
        temporary.write_text(json.dumps(discrimination.as_dict(), indent=1, allow_nan=False) + "\n")
    return [folder / "discrimination.json"]

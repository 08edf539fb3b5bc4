"""Tell apart: the power of every protocol of the menu to settle which of two mechanisms a recording shows.

A power is that of a choice between two. Where neither explains the recording there is no such choice yet, and
that is said first: what each leaves is judged as a diagnosis judges it.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.diagnosis.detect.residual_test import is_residual_significant, run_residual_test
from pamjax.diagnosis.detect.significance import Significance
from pamjax.diagnosis.library.candidates import MECHANISMS_NEEDING_TIME, build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem, build_library_problem
from pamjax.diagnosis.next_experiment.experiment import (
    SUFFICIENT_POWER,
    Experiment,
    choose_experiment,
    evaluate_protocols,
    fit_best_candidate,
    fit_rival,
)
from pamjax.diagnosis.next_experiment.testbed import SimulatedTestbed
from pamjax.diagnosis.refit.candidate_fit import CandidateFit, fit_candidate
from pamjax.errors import BadInput, refuse
from pamjax.model.registry import find_mechanism
from pamjax.progress import Progress, ignore_progress
from pamjax.records.case import Case, load_case
from pamjax.records.files import write_atomically

#: Protocols in a note.
MAX_LISTED_PROTOCOLS = 6


@dataclass(frozen=True, eq=False)
class Discrimination:
    """Two mechanisms before a recording, and what would tell them apart.

    Attributes:
        case: the recording.
        ids: the two.
        chi2_difference: χ² by which the second fits the recording worse than the first.
        testbed: the rig and the noise that the recording shows, on which protocols are played.
        experiments: every protocol with its power.
        chosen: the cheapest that is powerful enough, else the most powerful.
        residual_tests: what the first and what the second alone leave of the recording, judged.
        neither_explains: whether both leave more than noise and the rough edges of textbook forms.
    """

    case: Case
    ids: tuple[str, str]
    chi2_difference: float
    testbed: SimulatedTestbed
    experiments: tuple[Experiment, ...]
    chosen: Experiment
    residual_tests: tuple[Significance, Significance]
    neither_explains: bool

    @property
    def ranked_experiments(self) -> list[Experiment]:
        """The menu, what is most powerful first and of that the shortest."""
        return sorted(
            self.experiments, key=lambda experiment: (-round(experiment.power, 2), experiment.minutes)
        )

    def as_dict(self) -> dict[str, Any]:
        """As plain numbers."""
        return {
            "schema": "pamjax.contest/1",
            "case": self.case.name,
            "tell": list(self.ids),
            "chi2_worse": self.chi2_difference,
            "explained": not self.neither_explains,
            "says": self.verdict,
            "left": {
                id: {"p_value": residual_test.p_value, "rms_over_noise": math.sqrt(residual_test.mean_square)}
                for id, residual_test in zip(self.ids, self.residual_tests, strict=True)
            },
            "next_experiment": self.chosen.as_dict(),
            "menu": [
                experiment.as_dict() | _describe_experiment(experiment) for experiment in self.experiments
            ],
        }

    def __str__(self) -> str:
        condition = "if one of them is true all the same" if self.neither_explains else "next"
        lines = [
            f"{self.case.name}: {self.verdict}",
            f"  {condition}: {self.chosen.protocol}",
            f"  power {self.chosen.power:.2f} at a false alarm of one in twenty"
            + ("" if self.chosen.power >= SUFFICIENT_POWER else ", which may not be enough"),
            "",
        ]
        return "\n".join(
            lines
            + [
                f"  {experiment.power:5.2f}  {experiment.id:<4} {experiment.protocol}"
                for experiment in self.ranked_experiments[:MAX_LISTED_PROTOCOLS]
            ]
        )

    @property
    def verdict(self) -> str:
        """Which fits the recording better, and by how much; or that neither does."""
        first, second = self.ids
        better_id = first if self.chi2_difference > 0 else second
        if self.neither_explains:
            return f"neither {first} nor {second} explains this recording: {self.residual_summary}"
        return f"{first} or {second}; here {better_id} fits better by a χ² of {abs(self.chi2_difference):.3g}"

    @property
    def residual_summary(self) -> str:
        """What the two leave, and what to do about it."""
        pairs = zip(self.ids, self.residual_tests, strict=True)
        residuals = ", ".join(
            f"{id} alone leaves {math.sqrt(residual_test.mean_square):.2g}" for id, residual_test in pairs
        )
        return f"{residuals} times the noise (rms); `pamjax diagnose` first"


def _describe_experiment(experiment: Experiment) -> dict[str, Any]:
    limit = experiment.chi2_limit if math.isfinite(experiment.chi2_limit) else None
    return {"id": experiment.id, "minutes": experiment.minutes, "limit": limit}


def discriminate(
    case: Case | str | Path,
    first: str,
    second: str,
    progress: Progress = ignore_progress,
) -> Discrimination:
    """Which protocol of the menu settles which of two mechanisms a recording shows.

    Args:
        case: the recording, or its folder.
        first, second: ids of the mechanisms.
        progress: called with what is being done and the share done.

    Raises:
        BadInput: for an unknown id, or one that this recording cannot show at all.
    """
    case = load_case(case)
    for id in (first, second):
        find_mechanism(id)
    if first == second:
        raise refuse("two mechanisms are told apart", f"{first!r} twice")
    library_problem = build_library_problem(case)
    visible_ids = {candidate.id for candidate in build_candidates(library_problem)}
    for id in (first, second):
        if id not in visible_ids:
            raise _build_invisible_error(id, case)
    progress("fitting both", 0.1)
    baseline = fit_baseline(library_problem)
    first_fit = fit_mechanism(library_problem, baseline, first)
    second_fit = fit_rival(library_problem, first_fit, first, second)
    assert second_fit is not None
    progress("judging both", 0.3)
    residual_tests = (
        run_residual_test(library_problem, first_fit),
        run_residual_test(library_problem, second_fit),
    )
    baseline_test = run_residual_test(library_problem, baseline)
    progress("playing protocols", 0.5)
    testbed = SimulatedTestbed.from_fit(library_problem, first_fit)
    experiments = evaluate_protocols(testbed, first_fit, second_fit, (first, second))
    return Discrimination(
        case,
        (first, second),
        second_fit.corrected_chi2 - first_fit.corrected_chi2,
        testbed,
        tuple(experiments),
        choose_experiment(experiments),
        residual_tests,
        all(is_residual_significant(baseline_test, residual_test) for residual_test in residual_tests),
    )


def fit_baseline(library_problem: LibraryProblem) -> CandidateFit:
    """The baseline by itself, refitted under the noise that it leaves."""
    return fit_candidate(library_problem, np.ones(library_problem.n, dtype=bool), (), library_problem.neutral)


def fit_mechanism(library_problem: LibraryProblem, baseline: CandidateFit, id: str) -> CandidateFit:
    """The baseline with one mechanism in its best form, refitted under the noise that this leaves."""
    start_fit = fit_best_candidate(
        library_problem,
        baseline,
        [candidate for candidate in build_candidates(library_problem) if candidate.id == id],
    )
    return fit_candidate(
        library_problem,
        np.ones(library_problem.n, dtype=bool),
        start_fit.mechanisms,
        start_fit.estimate.values,
    )


def _build_invisible_error(id: str, case: Case) -> BadInput:
    if id in MECHANISMS_NEEDING_TIME and not case.recording.has_time:
        rule = f"two mechanisms are told apart after a recording that could show them, and {id!r} needs time"
        remedy = "Record strokes first: `pamjax plan` without `--tell` chooses some."
        return refuse(rule, "a table without time", case.name, remedy)
    rule = "two mechanisms are told apart that a recording could show beside its baseline"
    return refuse(rule, f"{id!r}, which this one cannot", case.name)


def save_discrimination(discrimination: Discrimination, folder: Path) -> list[Path]:
    """Write contest.json, beside and then renamed."""
    folder.mkdir(parents=True, exist_ok=True)
    with write_atomically(folder / "contest.json") as temporary:
        temporary.write_text(json.dumps(discrimination.as_dict(), indent=1, allow_nan=False) + "\n")
    return [folder / "contest.json"]

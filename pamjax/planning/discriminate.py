"""Discrimination between two mechanisms: the power of each protocol to identify the true one.

The power is the probability that a test between the two mechanisms identifies the true one. It is valid only
if one of the two explains the recording. The residual test of a diagnosis checks this first, and the report
states it if neither mechanism explains the recording.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pamjax.diagnosis.library.candidates import MECHANISMS_NEEDING_TIME, build_candidates
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.next_experiment.experiment import (
    Experiment,
    choose_experiment,
    evaluate_protocols,
)
from pamjax.diagnosis.next_experiment.testbed import SimulatedTestbed
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.errors import BadInput
from pamjax.model.registry import find_mechanism
from pamjax.notebook import NotebookText
from pamjax.planning.compare_pair import PairComparison, compare_pair
from pamjax.progress import Progress, ignore_progress
from pamjax.records.case import Case, ensure_case
from pamjax.records.files import write_atomically
from pamjax.text import join_words

#: Largest number of protocols in a summary.
_MAX_LISTED_PROTOCOLS = 6


@dataclass(frozen=True, eq=False, repr=False)
class Discrimination(NotebookText):
    """Two mechanisms, their fits to a recording, and the protocols that distinguish them.

    Attributes:
        case: the recording.
        ids: ids of the two mechanisms.
        mechanisms: ids of the mechanisms in both models.
        comparison: comparison of the two on the recording.
        testbed: rig and noise estimated from the recording, for the simulation of protocols.
        experiments: every protocol with its power.
        chosen_experiment: the shortest protocol with sufficient power, else the most powerful one.
    """

    case: Case
    ids: tuple[str, str]
    mechanisms: tuple[str, ...]
    comparison: PairComparison
    testbed: SimulatedTestbed
    experiments: tuple[Experiment, ...]
    chosen_experiment: Experiment

    @property
    def neither_explains(self) -> bool:
        """Return whether the residuals of both are larger than noise and form errors."""
        return self.comparison.neither_explains

    @property
    def is_distinguished(self) -> bool:
        """Return whether the recording already distinguishes the two, and one of them explains it."""
        return self.comparison.is_distinguished and not self.neither_explains

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
            "mechanisms_in_both": list(self.mechanisms),
            "chi2_difference": self.comparison.chi2_difference,
            "bic_difference": self.comparison.bic_difference,
            "bic_limit": self.comparison.bic_limit,
            "distinguished": self.comparison.is_distinguished,
            "explained": not self.neither_explains,
            "says": self.comparison_sentence,
            "residual_tests": {
                id: {"p_value": residual_test.p_value, "rms_over_noise": math.sqrt(residual_test.mean_square)}
                for id, residual_test in zip(self.ids, self.comparison.residual_tests, strict=True)
            },
            "next_experiment": self.chosen_experiment.as_dict(),
            "protocols": [
                experiment.as_dict() | _describe_experiment(experiment) for experiment in self.experiments
            ],
        }

    def __str__(self) -> str:
        wanted_power, alarm = DEFAULT_SETTINGS.sufficient_power, DEFAULT_SETTINGS.false_alarm_rate
        lines = [
            f"{self.case.name}: {self.comparison_sentence}",
            f"  {self.model_sentence}",
            f"  {self._condition}: {self.chosen_experiment.protocol}",
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
        if self.neither_explains:
            return f"neither {first} nor {second} explains this recording: {self.residual_summary}"
        difference, limit = abs(self.comparison.bic_difference), self.comparison.bic_limit
        if not self.is_distinguished:
            return (
                f"this recording does not distinguish {first} from {second}: their BIC differs by"
                f" {difference:.3g}, and the limit is {limit:.3g}"
            )
        better, other = (first, second) if self.comparison.better == 0 else (second, first)
        return (
            f"{better} fits this recording better than {other}: its BIC is lower by {difference:.3g}, and the"
            f" limit is {limit:.3g}"
        )

    @property
    def model_sentence(self) -> str:
        """Return which mechanisms both models have."""
        if self.mechanisms:
            return f"both models also have {join_words(list(self.mechanisms))}"
        return (
            "both models have no other mechanism; add those that a diagnosis names with `--with`, because"
            " they change the comparison"
        )

    @property
    def _condition(self) -> str:
        """Return when the protocol is useful."""
        if self.neither_explains:
            return "if one of them is present nevertheless"
        return "experiment to confirm this" if self.is_distinguished else "next experiment"

    @property
    def residual_summary(self) -> str:
        """Return the residuals of both mechanisms over the noise, and the next step."""
        pairs = zip(self.ids, self.comparison.residual_tests, strict=True)
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
    *,
    mechanisms: Sequence[str] = (),
) -> Discrimination:
    """Return the protocol that best distinguishes two mechanisms on the rig of a recording.

    Args:
        case: the recording, or its folder.
        first, second: ids of the mechanisms.
        progress: called with the current step and the completed fraction.
        mechanisms: ids of mechanisms in both models, such as the others that a diagnosis names.

    Returns:
        the `Discrimination`; `print` shows its summary.

    Raises:
        BadInput: for an unknown id, or a mechanism without effect on this recording.

    Example:
        print(pamjax.discriminate("rubbed", "braid_friction", "viscoelastic_creep"))
    """
    case = ensure_case(case)
    ids = (first, second, *mechanisms)
    for id in ids:
        find_mechanism(id)
    for id in ids:
        if ids.count(id) > 1:
            raise BadInput.from_rule(
                "a discrimination needs different mechanisms", f"{id!r} twice", remedy="Choose another one."
            )
    library_problem = build_library_problem(case)
    available_ids = {candidate.id for candidate in build_candidates(library_problem)}
    for id in ids:
        if id not in available_ids:
            raise _build_unavailable_error(id, case)
    comparison = compare_pair(library_problem, first, second, mechanisms, progress)
    testbed = SimulatedTestbed.from_fit(library_problem, comparison.fits[comparison.better])
    experiments = evaluate_protocols(testbed, *comparison.fits, (first, second), progress)
    progress("done", 1.0)
    return Discrimination(
        case,
        (first, second),
        tuple(mechanisms),
        comparison,
        testbed,
        tuple(experiments),
        choose_experiment(experiments, library_problem.settings),
    )


def _build_unavailable_error(id: str, case: Case) -> BadInput:
    if id in MECHANISMS_NEEDING_TIME and not case.recording.has_time:
        rule = f"mechanism {id!r} needs time"
        remedy = "Record strokes first: `plan` proposes runs."
        return BadInput.from_rule(rule, "a table without time", case.name, remedy)
    rule = "a mechanism must have an effect on the recording that its baseline does not include"
    return BadInput.from_rule(rule, f"{id!r} without such an effect", case.name, "Choose another mechanism.")


def save_discrimination(discrimination: Discrimination, folder: Path) -> list[Path]:
    """Write discrimination.json atomically and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    with write_atomically(folder / "discrimination.json") as temporary:
        temporary.write_text(json.dumps(discrimination.as_dict(), indent=1, allow_nan=False) + "\n")
    return [folder / "discrimination.json"]

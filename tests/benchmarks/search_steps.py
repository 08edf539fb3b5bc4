"""Contribution of each step of the search for mechanisms.

    python -m tests.benchmarks.search_steps [recordings of each kind] [seed] [--json FILE]

The recordings are those of `pamjax prove`: effects in other forms, and effects with the equations of the fit.
A step changes the set of mechanisms or not. The new set is nearer to the truth if fewer ids are missing or
too many. Ids that a diagnosis would report as indistinguishable count as different here.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from pamjax.benchmark.bank_trial import draw_task_recording
from pamjax.benchmark.other_forms.case_files import build_bank_case
from pamjax.benchmark.trial import TrialTask, draw_ground_truth
from pamjax.compile.jax_cache import keep_compiled
from pamjax.diagnosis.search_rows import DiagnosedRows
from pamjax.diagnosis.select import selection
from pamjax.diagnosis.selection_tests import fit_baseline
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.records.case import Case
from tests.benchmarks.keep import arguments, keep

SEED = 73

#: Kinds of recordings by bank: those that conceal effects of the library.
KINDS = {"other forms": ("single", "pair", "triple", "mixed"), "same forms": ("single", "pair", "triple")}

#: Functions of the selection by the name of the step.
STEPS = {
    "add one by one": "search_mechanisms",
    "pairs": "swap_pairs",
    "one in place of two": "merge_mechanisms",
    "remove redundant": "remove_redundant_mechanisms",
    "masked effects": "add_masked_effects",
    "small effects": "add_small_effects",
}


@dataclass
class Course:
    """Sets of mechanisms after each step of one search, and the processor time of the step, s."""

    ids: list[frozenset[str]] = field(default_factory=lambda: [frozenset()])
    seconds: Counter[str] = field(default_factory=Counter)
    steps: list[str] = field(default_factory=list)

    def follow(self, step: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function of a step that also adds its result to the course."""

        def run(*inputs):
            start = time.process_time()
            fit = function(*inputs)
            self.seconds[step] += time.process_time() - start
            self.steps.append(step)
            self.ids.append(frozenset(fit.ids))
            return fit

        return run


@contextmanager
def follow_steps() -> Iterator[Course]:
    """Record the steps of the searches within the context."""
    course, functions = Course(), {step: getattr(selection, name) for step, name in STEPS.items()}
    for step, function in functions.items():
        setattr(selection, STEPS[step], course.follow(step, function))
    try:
        yield course
    finally:
        for step, function in functions.items():
            setattr(selection, STEPS[step], function)


def search_case(case: Case) -> Course:
    """Return the course of the search for the mechanisms of a recording."""
    rows = DiagnosedRows.from_case(case, DEFAULT_SETTINGS)
    training = fit_baseline(rows, seed=0)
    with follow_steps() as course:
        if training.is_detected:
            selection.select_mechanisms(training.problem, training.mask, training.baseline)
    rows.clear_evaluations()
    return course


def list_recordings(bank: str, count: int, seed: int) -> Iterator[tuple[Case, frozenset[str]]]:
    """Yield recordings with the ids of their concealed mechanisms."""
    for kind in KINDS[bank]:
        for number in range(count):
            task = TrialTask("all", kind, 0.5, number, seed=seed)
            if bank == "same forms":
                ground_truth = draw_ground_truth(task)
                yield ground_truth.case, frozenset(ground_truth.effect_ids)
                continue
            recording = draw_task_recording(task)
            ids = frozenset(effect.id for effect in recording.effects if effect.in_library)
            yield build_bank_case(recording, f"{kind}-{number}"), ids


def main(count: int = 12, seed: int = SEED, file=None) -> None:
    keep_compiled()
    figures: dict[str, float] = {"recordings of each kind": count}
    for bank in KINDS:
        tally, seconds, recordings = Counter[tuple[str, str]](), Counter[str](), 0
        for case, truth in list_recordings(bank, count, seed):
            course, recordings = search_case(case), recordings + 1
            seconds.update(course.seconds)
            for step, (before, after) in zip(course.steps, pairwise(course.ids), strict=True):
                change = len(after ^ truth) - len(before ^ truth)
                tally[step, "changed"] += before != after
                tally[step, "nearer"] += change < 0
                tally[step, "farther"] += change > 0
        print(f"{bank}: {recordings} recordings")
        figures[f"{bank}, recordings"] = recordings
        for step in STEPS:
            counts = {word: tally[step, word] for word in ("changed", "nearer", "farther")}
            print(f"  {step:<22}", *(f"{word} {n}," for word, n in counts.items()), f"{seconds[step]:.0f} s")
            figures |= {f"{bank}, {step}, {word}": n for word, n in counts.items()}
            figures[f"{bank}, {step}, processor [s]"] = seconds[step]
    keep(file, figures)


if __name__ == "__main__":
    words, file = arguments()
    main(*map(int, words), file=file)

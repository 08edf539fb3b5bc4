"""Rows of a recording in which mechanisms are searched.

The duration of a search is proportional to the number of rows. A long recording has more samples in each
stroke than a search needs, so it takes every second, third, … row. The chosen mechanisms are then fitted to
all rows.

Neglects: effects that are faster than the interval of the rows that are taken.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pamjax.diagnosis.crossval.held_out_errors import build_held_out_mask
from pamjax.diagnosis.library.library_problem import LibraryProblem, build_library_problem, select_rows
from pamjax.diagnosis.noise.input_noise import clear_evaluations
from pamjax.diagnosis.noise.turn_variance import clear_one_sided_problems
from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.records.blocks import Blocks, assign_length_levels, find_blocks
from pamjax.records.case import Case
from pamjax.records.recording import Recording


@dataclass(frozen=True, eq=False)
class DiagnosedRows:
    """The rows of a recording: all of them, and those in which mechanisms are searched.

    Attributes:
        problem: all rows, and the library.
        blocks: isobars, holds or cycles of all rows.
        training_mask: (n,) whether a row is not held out.
        length: (n,) m, as it was read; the length of `problem` is averaged where it is fixed.
        search_problem: the rows of the search, and the library.
        search_rows: (k,) their indices.
    """

    problem: LibraryProblem
    blocks: Blocks
    training_mask: np.ndarray
    length: np.ndarray
    search_problem: LibraryProblem
    search_rows: np.ndarray

    @classmethod
    def from_case(cls, case: Case, settings: DiagnosisSettings) -> DiagnosedRows:
        """Return the rows of a case."""
        problem, blocks = build_library_problem(case, settings), find_blocks(case.recording)
        search_rows = choose_search_rows(problem.case.recording, settings.max_search_rows)
        search_problem = problem if search_rows.size == problem.n else select_rows(problem, search_rows)
        training_mask = ~build_held_out_mask(blocks, settings)
        return cls(problem, blocks, training_mask, case.recording.length, search_problem, search_rows)

    @property
    def search_blocks(self) -> Blocks:
        """Return the blocks of the rows of the search."""
        return replace(self.blocks, label=self.blocks.label[self.search_rows])

    def start_compilation(self) -> None:
        """Start to compile the programs, those of the search first."""
        self.search_problem.start_compilation()
        if self.search_problem is not self.problem:
            self.problem.start_compilation()

    def clear_evaluations(self) -> None:
        """Forget the cached evaluations: the result holds the problem, and must not hold them."""
        for problem in (self.search_problem, self.problem):
            clear_evaluations(problem)
            clear_one_sided_problems(problem)


def choose_search_rows(recording: Recording, max_rows: int) -> np.ndarray:
    """Return the row indices for a search, (k,): every m-th row of each run, m = ⌈n / `max_rows`⌉.

    All rows are taken if they are no time series, or if fewer rows show other length levels.
    """
    all_rows = np.arange(recording.n)
    if recording.n <= max_rows or recording.time is None:
        return all_rows
    run_start = np.maximum.accumulate(np.where(recording.is_run_start, all_rows, 0))
    rows = np.flatnonzero((all_rows - run_start) % math.ceil(recording.n / max_rows) == 0)
    levels = assign_length_levels(recording)[rows]
    is_same = np.array_equal(assign_length_levels(recording.select(rows)), levels)
    return rows if is_same else all_rows

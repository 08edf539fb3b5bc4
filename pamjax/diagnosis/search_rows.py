"""Rows of a recording in which mechanisms are searched.

The duration of a search is proportional to the number of rows. A long recording has more samples in each
stroke than a search needs, so averages of 3, 5, … neighbouring rows take their place. The chosen
mechanisms are then fitted to all rows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pamjax.diagnosis.crossval.held_out_errors import build_held_out_mask
from pamjax.diagnosis.library.library_problem import LibraryProblem, average_rows, build_library_problem
from pamjax.diagnosis.noise.input_noise import clear_evaluations
from pamjax.diagnosis.noise.turn_variance import clear_one_sided_problems
from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.records.blocks import Blocks, assign_length_levels, find_blocks
from pamjax.records.case import Case
from pamjax.records.recording import Recording
from pamjax.records.row_averages import RowAverages


@dataclass(frozen=True, eq=False)
class DiagnosedRows:
    """The rows of a recording: all of them, and those in which mechanisms are searched.

    Attributes:
        problem: all rows, and the library.
        blocks: isobars, holds or cycles of all rows.
        training_mask: (n,) whether a row is not held out.
        search_problem: the rows of the search, and the library.
        search_length: (k,) m, as it was read; the length of a problem is averaged where it is fixed.
        search_rows: (k,) index of each row of the search; the centre of a group of rows.
    """

    problem: LibraryProblem
    blocks: Blocks
    training_mask: np.ndarray
    search_problem: LibraryProblem
    search_length: np.ndarray
    search_rows: np.ndarray

    @classmethod
    def from_case(cls, case: Case, settings: DiagnosisSettings) -> DiagnosedRows:
        """Return the rows of a case."""
        problem, blocks = build_library_problem(case, settings), find_blocks(case.recording)
        training_mask, length = ~build_held_out_mask(blocks, settings), case.recording.length
        averages = choose_search_rows(problem.case.recording, blocks.label, settings.max_search_rows)
        if averages is None:
            return cls(problem, blocks, training_mask, problem, length, np.arange(problem.n))
        search_problem, search_length = average_rows(problem, averages), averages.average(length)
        return cls(problem, blocks, training_mask, search_problem, search_length, averages.centres)

    @property
    def search_blocks(self) -> Blocks:
        """Return the blocks of the rows of the search."""
        return replace(self.blocks, label=self.blocks.label[self.search_rows])

    def start_compilation(self) -> None:
        """Start to compile the programs, in the order of their first use."""
        if self.search_problem is not self.problem:
            # The noise of means is estimated from predictions of the samples.
            self.problem.start_compilation_of_prediction()
        self.search_problem.start_compilation()
        self.problem.start_compilation_of_derivatives()

    def clear_evaluations(self) -> None:
        """Forget the cached evaluations: the result holds the problem, and must not hold them."""
        for problem in (self.search_problem, self.problem):
            clear_evaluations(problem)
            clear_one_sided_problems(problem)


def choose_search_rows(recording: Recording, label: np.ndarray, max_rows: int) -> RowAverages | None:
    """Return averages of 3, 5, … neighbouring rows for a search; None to search all rows.

    All rows are searched if they are no time series, or if the averages show other length levels.

    Args:
        recording: the recording.
        label: (n,) block of each row.
        max_rows: intended number of rows of a search.
    """
    if recording.n <= max_rows or recording.time is None:
        return None
    half_width = math.ceil((recording.n / max_rows - 1) / 2)
    averages = RowAverages.from_recording(recording, label, 2 * half_width + 1)
    averaged, centres = averages.averaged_recording, averages.centres
    usable = recording.usable[centres] & averaged.usable
    levels = assign_length_levels(recording)[centres][usable]
    is_same = np.array_equal(assign_length_levels(averaged)[usable], levels)
    return averages if is_same else None

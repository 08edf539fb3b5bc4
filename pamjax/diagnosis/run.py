"""Diagnose: locate the mismatch, name the missing physics, model it, show the gain. The verb of the study."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from pamjax.diagnosis.crossval.cross_validated import (
    cross_validate_selection,
    format_dropped_mechanisms,
    halve_certainty,
)
from pamjax.diagnosis.crossval.gain import compute_gain, select_held_out_rows
from pamjax.diagnosis.detect.locate import locate_effects, locate_residual
from pamjax.diagnosis.detect.residual_test import (
    is_residual_large,
    is_residual_significant,
    run_residual_test,
)
from pamjax.diagnosis.detect.score_test import compute_score_directions
from pamjax.diagnosis.detect.significance import DETECTION_P_VALUE, Significance, compute_significance
from pamjax.diagnosis.identifiability import format_notes
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem, build_library_problem
from pamjax.diagnosis.next_experiment.experiment import propose_experiments
from pamjax.diagnosis.refit.candidate_fit import CandidateFit, fit_candidate
from pamjax.diagnosis.refit.misfit_weighting import fit_with_misfit_weight
from pamjax.diagnosis.refit.noise_correlation import fit_noise_correlation
from pamjax.diagnosis.result import Diagnosis, ParameterEstimate, ParameterShift, build_parameter_estimate
from pamjax.diagnosis.select.model_averaging import average_models
from pamjax.diagnosis.select.selection import Selection, drop_small_effects, select_mechanisms
from pamjax.progress import Progress, ignore_progress
from pamjax.records.blocks import find_blocks
from pamjax.records.case import Case, load_case


def diagnose(
    case: Case | str | Path,
    *,
    seed: int = 0,
    progress: Progress = ignore_progress,
) -> Diagnosis:
    """Say what a recording's baseline leaves out.

    Args:
        case: the recording and what the lab believes of its muscle, or their folder.
        seed: of the draws behind the p-values.
        progress: called with what is being done and the share done.

    Raises:
        BadInput: for a baseline that no bench has, or a recording without force and diameter.
    """
    case = load_case(case)
    progress("compiling", 0.0)
    problem = build_library_problem(case)
    problem.compile()
    blocks_of_case = find_blocks(case.recording)
    held_out_rows = select_held_out_rows(blocks_of_case)
    selection = select_mechanisms(problem, ~held_out_rows, progress)
    progress("judging", 0.85)
    mismatch = _test_baseline(problem, selection, seed)
    detected = mismatch.p_value < DETECTION_P_VALUE
    if not detected:
        selection = replace(
            selection,
            model=selection.baseline,
            named_mechanisms=(),
            weighted_values=None,
            fit_before_small_effects=None,
        )
    residual_test = _test_residual(problem, selection, mismatch, seed)
    unexplained = detected and is_residual_significant(mismatch, residual_test)
    if unexplained and selection.fit_before_small_effects is not None:
        # What is small beside a name is told only where nothing else is: it bends to that.
        selection = drop_small_effects(problem, selection)
        residual_test = _test_residual(problem, selection, mismatch, seed)
        unexplained = is_residual_significant(mismatch, residual_test)
    selection_before = selection
    if selection.named_mechanisms:
        # Names that bend to what is in no catalogue may leave too little to be told from noise.
        validated = cross_validate_selection(
            problem,
            blocks_of_case,
            ~held_out_rows,
            selection,
            judge_each=is_residual_large(mismatch, residual_test),
        )
        residual_test = (
            residual_test
            if validated.model is selection.model
            else _test_residual(problem, validated, mismatch, seed)
        )
        selection, unexplained = validated, is_residual_significant(mismatch, residual_test)
    if selection.named_mechanisms and unexplained:
        selection = halve_certainty(selection)
    held_out_gain = compute_gain(
        problem,
        blocks_of_case,
        held_out_rows,
        selection.baseline,
        _fit_selection(problem, selection, ~held_out_rows),
    )
    all_rows = np.ones(problem.n, dtype=bool)
    baseline = fit_candidate(problem, all_rows, (), selection.baseline.estimate.values)
    model = baseline
    if selection.named_mechanisms:
        model = fit_noise_correlation(problem, _fit_selection(problem, selection, all_rows))
        model = average_models(problem, model, selection.named_mechanisms)
    progress("done", 1.0)
    return Diagnosis(
        problem=problem,
        selection=selection,
        model=model,
        baseline=baseline,
        mismatch=mismatch,
        mismatch_boxes=(
            locate_effects(problem, baseline, model)
            if selection.named_mechanisms
            else locate_residual(problem, baseline)
        ),
        residual_test=residual_test,
        unexplained=unexplained,
        residual_boxes=locate_residual(problem, model) if unexplained else [],
        residual_share=_compute_residual_share(mismatch, residual_test),
        blocks=blocks_of_case,
        gain=held_out_gain,
        parameters=_collect_estimates(problem, model),
        parameter_shifts=_compute_shifts(problem, baseline, model) if selection.named_mechanisms else {},
        notes=[
            *(format_dropped_mechanisms(selection_before, selection) if unexplained else []),
            *problem.case.warnings,
            *format_notes(problem, baseline, model),
        ],
        experiments=propose_experiments(problem, model, selection.named_mechanisms),
    )  # fmt: skip


def _test_baseline(problem: LibraryProblem, selection: Selection, seed: int) -> Significance:
    """The baseline's residual, judged; of a table of unknown noise every row, since each tells the noise."""
    baseline, score_directions = selection.baseline, list(selection.baseline_directions)
    if any(channel and math.isfinite(channel.degrees_of_freedom) for channel in baseline.noise.channels):
        baseline = fit_candidate(problem, np.ones(problem.n, dtype=bool), (), baseline.estimate.values)
        score_directions = compute_score_directions(
            problem, baseline.noise, baseline.estimate, build_candidates(problem)
        )
    return compute_significance(problem, baseline.noise, baseline.estimate, score_directions, seed)


def _fit_selection(problem: LibraryProblem, selection: Selection, rows: np.ndarray) -> CandidateFit:
    """The named model as some rows tell it; a baseline without names stays as it was judged."""
    fit = selection.model
    return (
        fit_with_misfit_weight(problem, rows, fit.mechanisms, selection.start_values)
        if fit.mechanisms
        else fit
    )


def _test_residual(
    problem: LibraryProblem, selection: Selection, mismatch: Significance, seed: int
) -> Significance:
    """What the names leave, judged; the mismatch itself where there are none."""
    return run_residual_test(problem, selection.model, seed) if selection.model.mechanisms else mismatch


def _compute_residual_share(mismatch: Significance, residual_test: Significance) -> float:
    before = max(mismatch.mean_square - 1, 0.0)
    return float(np.clip(max(residual_test.mean_square - 1, 0.0) / before, 0.0, 1.0)) if before > 0 else 0.0


def _collect_estimates(problem: LibraryProblem, fit: CandidateFit) -> dict[str, dict[str, ParameterEstimate]]:
    return {
        candidate.id: {
            name.rpartition(".")[2]: build_parameter_estimate(problem, fit, problem.index(name))
            for name in candidate.free_parameters
        }
        for candidate in fit.mechanisms
    }


def _compute_shifts(
    problem: LibraryProblem, baseline: CandidateFit, fit: CandidateFit
) -> dict[str, ParameterShift]:
    out = {}
    for k in baseline.estimate.free:
        before, after, sd = baseline.estimate.values[k], fit.estimate.values[k], baseline.sd(k)
        shift = (after - before) / sd if sd > 0 else 0.0
        out[problem.names[k]] = ParameterShift(float(before), float(after), float(shift), problem.meanings[k])
    return out

"""Diagnosis of a recording: detect and locate misfit, select mechanisms, validate and report them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pamjax.compile.parallel import use_one_blas_thread
from pamjax.diagnosis.crossval.confirm_selection import (
    cross_validate_selection,
    format_dropped_mechanisms,
)
from pamjax.diagnosis.crossval.held_out_errors import compute_held_out_errors, select_held_out_rows
from pamjax.diagnosis.detect.locate import locate_effects, locate_residual
from pamjax.diagnosis.detect.residual_test import (
    is_residual_significant,
    run_baseline_test,
    run_residual_test,
)
from pamjax.diagnosis.detect.significance import Significance
from pamjax.diagnosis.form_errors.fit import add_form_errors
from pamjax.diagnosis.form_errors.prediction import describe_form_errors, predict_with_form_errors
from pamjax.diagnosis.library.library_problem import LibraryProblem, build_library_problem
from pamjax.diagnosis.next_experiment.experiment import propose_experiments
from pamjax.diagnosis.noise.sensor_scale import compute_noise_ratios, format_noise_notes
from pamjax.diagnosis.notes import format_notes
from pamjax.diagnosis.outside.rival_templates import Likeness, list_likenesses
from pamjax.diagnosis.outside.template_context import build_template_context
from pamjax.diagnosis.outside.templates import build_templates
from pamjax.diagnosis.refit.candidate_fit import CandidateFit, fit_candidate
from pamjax.diagnosis.refit.least_squares import evaluate_estimate
from pamjax.diagnosis.refit.misfit_weighting import fit_with_misfit_weight
from pamjax.diagnosis.refit.noise_correlation import fit_noise_correlation
from pamjax.diagnosis.result import (
    Diagnosis,
    ParameterEstimate,
    ParameterShift,
    build_parameter_estimate,
)
from pamjax.diagnosis.select.model_averaging import average_models
from pamjax.diagnosis.select.replace_by_template import replace_by_template
from pamjax.diagnosis.select.selection import (
    Selection,
    drop_small_effects,
    format_masked_mechanisms,
    select_mechanisms,
    shrink_to_even_odds,
)
from pamjax.diagnosis.settings import DEFAULT_SETTINGS, DiagnosisSettings
from pamjax.infer.form_errors.parts import FormErrorPart
from pamjax.progress import Progress, ignore_progress
from pamjax.records.blocks import Blocks, find_blocks
from pamjax.records.case import Case, ensure_case


@dataclass(frozen=True, eq=False)
class _Choice:
    """The mechanisms of a recording, tested, and the fits with them.

    Attributes:
        selection: the mechanisms, chosen on the training rows.
        mismatch: test of the baseline's residual.
        residual_test: test of the residual with the mechanisms.
        unexplained: whether physics is left that no mechanism explains.
        likenesses: effects outside the library that it resembles.
        training_fit: the fit with the mechanisms to the training rows.
        baseline: the baseline, fitted to all rows.
        model: the fit with the mechanisms to all rows.
        form_errors: form errors of the mechanisms in all rows.
        notes: mechanisms that were replaced by a template, or dropped.
    """

    selection: Selection
    mismatch: Significance
    residual_test: Significance
    unexplained: bool
    likenesses: tuple[Likeness, ...]
    training_fit: CandidateFit
    baseline: CandidateFit
    model: CandidateFit
    form_errors: dict[str, FormErrorPart]
    notes: list[str]


@use_one_blas_thread
def diagnose(
    case: Case | str | Path,
    *,
    seed: int = 0,
    settings: DiagnosisSettings = DEFAULT_SETTINGS,
    progress: Progress = ignore_progress,
) -> Diagnosis:
    """Return the mechanisms that the baseline of a recording omits.

    Args:
        case: the recording and the stated values of its muscle, or their folder.
        seed: seed of the random draws for the p-values.
        settings: thresholds of the diagnosis.
        progress: called with the name of the step and the share done.

    Returns:
        the `Diagnosis`; `print` shows it as a note, `plot` draws it.

    Raises:
        BadInput: for an unknown baseline, or a recording without force and diameter.

    Example:
        diagnosis = pamjax.diagnose("rubbed")
        print(diagnosis)
        for mechanism in diagnosis.named_mechanisms:
            print(mechanism.id, mechanism.probability)
        diagnosis.plot("map").savefig("map.png")
    """
    case = ensure_case(case)
    progress("compiling", 0.0)
    problem = build_library_problem(case, settings)
    problem.compile()
    blocks_of_case = find_blocks(case.recording)
    held_out_rows = select_held_out_rows(blocks_of_case, problem.settings)
    choice = _choose_mechanisms(problem, case.recording.length, blocks_of_case, held_out_rows, seed, progress)
    selection, baseline, model = choice.selection, choice.baseline, choice.model
    noise_ratios = compute_noise_ratios(problem, model.estimate.values)
    training_fit = add_form_errors(problem, choice.training_fit)
    progress("done", 1.0)
    return Diagnosis(
        problem=problem,
        selection=selection,
        model=model,
        baseline=baseline,
        mismatch=choice.mismatch,
        mismatch_boxes=(
            locate_effects(problem, baseline, model)
            if selection.named_mechanisms
            else locate_residual(problem, baseline)
        ),
        residual_test=choice.residual_test,
        unexplained=choice.unexplained,
        likenesses=choice.likenesses,
        residual_boxes=locate_residual(problem, model) if choice.unexplained else [],
        residual_share=_compute_residual_share(problem, baseline, model),
        noise_ratios=noise_ratios,
        blocks=blocks_of_case,
        held_out_errors=compute_held_out_errors(
            problem, blocks_of_case, held_out_rows, selection.baseline, choice.training_fit
        ),
        parameters=_collect_estimates(problem, model),
        parameter_shifts=_compute_shifts(problem, baseline, model) if selection.named_mechanisms else {},
        notes=[
            *choice.notes,
            *format_noise_notes(noise_ratios),
            *problem.case.warnings,
            *format_notes(problem, baseline, model),
        ],
        experiments=propose_experiments(problem, model, selection.named_mechanisms),
        form_errors=choice.form_errors,
        form_prediction=predict_with_form_errors(problem, training_fit),
    )


def _choose_mechanisms(
    problem: LibraryProblem,
    length: np.ndarray,
    blocks_of_case: Blocks,
    held_out_rows: np.ndarray,
    seed: int,
    progress: Progress,
) -> _Choice:
    """Choose mechanisms one after the other, and test them on held-out blocks."""
    training_fit = fit_candidate(problem, ~held_out_rows, (), problem.neutral)
    mismatch = run_baseline_test(problem, training_fit, seed)
    is_detected = mismatch.p_value < problem.settings.detection_p_value
    selection = (
        select_mechanisms(problem, ~held_out_rows, training_fit, progress)
        if is_detected
        else Selection(training_fit, training_fit, ())
    )
    progress("testing", 0.85)
    # The templates describe forces; where length is measured, none applies.
    templates = (
        build_templates(build_template_context(problem, length, blocks_of_case, training_fit))
        if is_detected and not problem.case.recording.measures_length
        else []
    )
    selection, replaced = replace_by_template(problem, ~held_out_rows, selection, templates)
    residual_test = _test_residual(problem, selection, mismatch, seed)
    is_unexplained = is_detected and (
        bool(replaced) or is_residual_significant(mismatch, residual_test, problem.settings)
    )
    if is_unexplained and selection.fit_before_small_effects is not None:
        # Small effects are reported only if nothing is unexplained: otherwise they can absorb that part.
        selection, replaced = replace_by_template(
            problem, ~held_out_rows, drop_small_effects(problem, selection), templates
        )
        residual_test = _test_residual(problem, selection, mismatch, seed)
        is_unexplained = bool(replaced) or is_residual_significant(mismatch, residual_test, problem.settings)
    selection_before = selection
    if selection.named_mechanisms:
        # Mechanisms can absorb physics outside the library, so that the residual is no longer significant.
        validated_selection, is_predictive = cross_validate_selection(
            problem,
            blocks_of_case,
            ~held_out_rows,
            selection,
        )
        if validated_selection.model is not selection.model:
            residual_test = _test_residual(problem, validated_selection, mismatch, seed)
        selection = validated_selection
        is_unexplained = (
            bool(replaced)
            or not is_predictive
            or is_residual_significant(mismatch, residual_test, problem.settings)
        )
    if selection.named_mechanisms and is_unexplained:
        names = selection.named_mechanisms
        ids = {name.id for name in names}
        selection = replace(selection, named_mechanisms=shrink_to_even_odds(names, problem.settings, ids))
    all_rows = np.ones(problem.n, dtype=bool)
    # The reported baseline is that of `fit`, which takes the noise as stated.
    baseline = fit_candidate(problem, all_rows, (), selection.baseline.estimate.values, max_noise_ratio=1.0)
    model, form_errors = baseline, {}
    if selection.named_mechanisms:
        model = fit_noise_correlation(problem, _fit_selection(problem, selection, all_rows))
        model = average_models(problem, model, selection.named_mechanisms)
        form_errors = describe_form_errors(problem, add_form_errors(problem, model))
        selection = _state_form_errors(selection, form_errors)
    return _Choice(
        selection=selection,
        mismatch=mismatch,
        residual_test=residual_test,
        unexplained=is_unexplained,
        likenesses=list_likenesses(problem, templates, selection.model) if is_unexplained else (),
        training_fit=_fit_selection(problem, selection, ~held_out_rows),
        baseline=baseline,
        model=model,
        form_errors=form_errors,
        notes=[
            *replaced,
            *format_dropped_mechanisms(selection_before, selection),
            *format_masked_mechanisms(selection, problem.settings),
        ],
    )


def _fit_selection(problem: LibraryProblem, selection: Selection, rows: np.ndarray) -> CandidateFit:
    """Refit the selected model to some rows; a baseline without mechanisms is returned unchanged."""
    fit = selection.model
    return (
        fit_with_misfit_weight(problem, rows, fit.mechanisms, selection.start_values)
        if fit.mechanisms
        else fit
    )


def _state_form_errors(selection: Selection, parts: dict[str, FormErrorPart]) -> Selection:
    names = tuple(
        replace(name, form_error=parts[name.id].ratio if name.id in parts else None)
        for name in selection.named_mechanisms
    )
    return replace(selection, named_mechanisms=names)


def _test_residual(
    problem: LibraryProblem, selection: Selection, mismatch: Significance, seed: int
) -> Significance:
    """Test the residual beyond form errors; without mechanisms, return the test of the baseline."""
    return (
        run_residual_test(problem, add_form_errors(problem, selection.model), seed)
        if selection.model.mechanisms
        else mismatch
    )


def _compute_residual_share(problem: LibraryProblem, baseline: CandidateFit, model: CandidateFit) -> float:
    """Return the share of the baseline's excess χ² that the model leaves, both with the baseline's noise."""
    before, after = (
        evaluate_estimate(problem, baseline.noise, fit.estimate.free, fit.estimate.values).chi2
        - baseline.noise.size
        for fit in (baseline, model)
    )
    return float(np.clip(after / before, 0.0, 1.0)) if before > 0 else 0.0


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

"""Diagnosis of a recording: detect and locate misfit, select mechanisms, validate and report them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pamjax.compile.parallel import use_one_blas_thread
from pamjax.diagnosis.crossval.confirm_selection import (
    cross_validate_selection,
    format_dropped_mechanisms,
)
from pamjax.diagnosis.crossval.held_out_errors import (
    HeldOutErrors,
    compute_held_out_errors,
)
from pamjax.diagnosis.crossval.held_out_ratios import drop_harmful_mechanisms, format_harmful_mechanisms
from pamjax.diagnosis.detect.locate import locate_effects, locate_residual
from pamjax.diagnosis.detect.residual_test import (
    compute_residual_share,
    is_residual_significant,
    run_baseline_test,
    run_residual_test,
)
from pamjax.diagnosis.detect.significance import ResidualTest
from pamjax.diagnosis.estimates import collect_mechanism_estimates, compute_parameter_shifts
from pamjax.diagnosis.form_errors.fit import add_form_errors
from pamjax.diagnosis.form_errors.prediction import (
    ModelPrediction,
    describe_form_errors,
    predict_with_uncertainty,
)
from pamjax.diagnosis.form_errors.uncertainty import include_form_errors
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.next_experiment.experiment import Experiment, propose_experiments
from pamjax.diagnosis.noise.noise_ratios import compute_noise_ratios, format_noise_notes
from pamjax.diagnosis.notes import format_notes
from pamjax.diagnosis.outside.template_context import get_template_builder
from pamjax.diagnosis.outside.template_fits import list_likenesses
from pamjax.diagnosis.outside.templates import TemplateBuilder
from pamjax.diagnosis.refit.misfit_weighting import fit_with_misfit_weight
from pamjax.diagnosis.refit.model_fit import ModelFit, fit_model
from pamjax.diagnosis.refit.noise_correlation import fit_noise_correlation
from pamjax.diagnosis.result import Diagnosis
from pamjax.diagnosis.saved_form_errors import build_saved_form_errors
from pamjax.diagnosis.search_rows import DiagnosedRows
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
from pamjax.infer.form_errors.form_model import FormErrorModel
from pamjax.infer.form_errors.parts import FormErrorPart
from pamjax.progress import Progress, ignore_progress
from pamjax.records.blocks import Blocks
from pamjax.records.case import Case, ensure_case


@dataclass(frozen=True, eq=False)
class _Training:
    """The training rows of a search, and the test of the baseline.

    Attributes:
        problem: the rows in which mechanisms are searched, and the library.
        mask: (n,) whether a row is used in the fits, and not held out.
        blocks: isobars, holds or cycles of these rows.
        baseline: the baseline, fitted to the training rows.
        mismatch: test of its residual.
        seed: seed of the random draws for the p-values.
    """

    problem: LibraryProblem
    mask: np.ndarray
    blocks: Blocks
    baseline: ModelFit
    mismatch: ResidualTest
    seed: int

    @property
    def is_detected(self) -> bool:
        """Return whether the misfit of the baseline is significant."""
        return self.mismatch.p_value < self.problem.settings.detection_p_value


@dataclass(frozen=True, eq=False)
class _TestedSelection:
    """Mechanisms that were selected on the training rows, and the test of their residual.

    Attributes:
        selection: the mechanisms.
        residual_test: test of the residual with the mechanisms.
        unexplained: whether no mechanism explains a part of the misfit.
        replacement_notes: notes on mechanisms that a template replaces.
    """

    selection: Selection
    residual_test: ResidualTest
    unexplained: bool
    replacement_notes: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class _FinalFit:
    """The fits of the chosen mechanisms to all rows.

    Attributes:
        selection: the mechanisms, with the sizes of their form errors.
        baseline: the baseline.
        model: the fit with the mechanisms.
        form_errors: their form errors.
        form_error_model: their form errors for other recordings; None if there are none.
    """

    selection: Selection
    baseline: ModelFit
    model: ModelFit
    form_errors: dict[str, FormErrorPart]
    form_error_model: FormErrorModel | None = None


@dataclass(frozen=True, eq=False)
class _HeldOutTest:
    """The prediction of the held-out rows by a fit without them, and its errors."""

    prediction: ModelPrediction
    errors: HeldOutErrors


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
        the `Diagnosis`; `print` shows its summary, `plot` draws it.

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
    rows = DiagnosedRows.from_case(case, settings)
    rows.start_compilation()
    try:
        return _diagnose_rows(rows, seed, progress)
    finally:
        rows.clear_evaluations()


def _diagnose_rows(rows: DiagnosedRows, seed: int, progress: Progress) -> Diagnosis:
    search_problem, settings = rows.search_problem, rows.problem.settings
    training = _test_baseline(rows, seed)
    selection = (
        select_mechanisms(search_problem, training.mask, training.baseline, progress)
        if training.is_detected
        else Selection(training.baseline, training.baseline, ())
    )
    progress("testing", 0.85)
    build_templates_at = get_template_builder(
        search_problem, rows.length[rows.search_rows], rows.search_blocks
    )
    tested_selection = _test_against_templates(training, selection, build_templates_at)
    cross_validated_selection = _cross_validate_on_blocks(training, tested_selection)
    confirmed_selection, held_out_test = _check_on_held_out_rows(rows, training, cross_validated_selection)
    final_fit = _fit_all_rows(rows.problem, confirmed_selection.selection)
    notes = [
        *confirmed_selection.replacement_notes,
        *format_dropped_mechanisms(tested_selection.selection, cross_validated_selection.selection),
        *format_harmful_mechanisms(cross_validated_selection.selection, confirmed_selection.selection),
        *format_masked_mechanisms(confirmed_selection.selection, settings),
    ]
    progress("proposing experiments", 0.9)
    experiments = propose_experiments(rows.problem, final_fit.model, final_fit.selection.named_mechanisms)
    diagnosis = _build_diagnosis(
        rows, training, confirmed_selection, held_out_test, final_fit, build_templates_at, experiments, notes
    )
    progress("done", 1.0)
    return diagnosis


def _build_diagnosis(
    rows: DiagnosedRows,
    training: _Training,
    confirmed_selection: _TestedSelection,
    held_out_test: _HeldOutTest,
    final_fit: _FinalFit,
    build_templates_at: TemplateBuilder,
    experiments: list[Experiment],
    selection_notes: list[str],
) -> Diagnosis:
    """Return the result of all steps, with the places of the misfit and the errors on held-out blocks."""
    problem, unexplained = rows.problem, confirmed_selection.unexplained
    selection, baseline, model = final_fit.selection, final_fit.baseline, final_fit.model
    prediction = held_out_test.prediction
    noise_ratios = compute_noise_ratios(problem, model.estimate.values)
    return Diagnosis(
        problem=problem,
        selection=selection,
        model=model,
        baseline=baseline,
        mismatch=training.mismatch,
        mismatch_boxes=(
            locate_effects(problem, baseline, model)
            if selection.named_mechanisms
            else locate_residual(problem, baseline)
        ),
        residual_test=confirmed_selection.residual_test,
        unexplained=unexplained,
        likenesses=list_likenesses(training.problem, build_templates_at, selection.model)
        if unexplained
        else (),
        residual_boxes=locate_residual(problem, model) if unexplained else [],
        residual_share=compute_residual_share(problem, baseline, model),
        noise_ratios=noise_ratios,
        blocks=rows.blocks,
        held_out_errors=held_out_test.errors,
        parameters=collect_mechanism_estimates(problem, model),
        parameter_shifts=compute_parameter_shifts(problem, baseline, model)
        if selection.named_mechanisms
        else {},
        notes=[
            *selection_notes,
            *format_noise_notes(noise_ratios, problem.settings.min_reported_noise_ratio),
            *problem.case.warnings,
            *format_notes(problem, baseline, model),
        ],
        experiments=experiments,
        form_errors=final_fit.form_errors,
        form_error_model=final_fit.form_error_model,
        form_prediction=prediction if prediction.has_form_errors else None,
    )


def _test_baseline(rows: DiagnosedRows, seed: int) -> _Training:
    """Return the fit of the baseline to the training rows of the search, and the test of its residual."""
    problem, mask = rows.search_problem, rows.training_mask[rows.search_rows]
    baseline = fit_model(problem, mask, (), problem.neutral)
    mismatch = run_baseline_test(problem, baseline, seed)
    return _Training(problem, mask, rows.search_blocks, baseline, mismatch, seed)


def _test_against_templates(
    training: _Training, selection: Selection, build_templates_at: TemplateBuilder
) -> _TestedSelection:
    """Return the mechanisms that no template replaces; without small effects if a part is unexplained."""
    remaining, notes = replace_by_template(training.problem, training.mask, selection, build_templates_at)
    tested_selection = _test_selection(training, remaining, notes)
    if not tested_selection.unexplained or remaining.fit_without_small_effects is None:
        return tested_selection
    # Small effects are reported only if nothing is unexplained: otherwise they can absorb that part.
    return _test_against_templates(
        training, drop_small_effects(training.problem, remaining), build_templates_at
    )


def _cross_validate_on_blocks(training: _Training, tested_selection: _TestedSelection) -> _TestedSelection:
    """Return the mechanisms that also predict left-out blocks; less certain if a part is unexplained.

    Mechanisms can absorb physics outside the library, so that the residual is no longer significant.
    """
    problem = training.problem
    if not tested_selection.selection.named_mechanisms:
        return tested_selection
    selection, is_predictive = cross_validate_selection(
        problem, training.blocks, training.mask, tested_selection.selection
    )
    confirmed_selection = (
        replace(tested_selection, selection=selection)
        if selection.model is tested_selection.selection.model
        else _test_selection(training, selection, tested_selection.replacement_notes)
    )
    is_explained = is_predictive and not confirmed_selection.unexplained
    return confirmed_selection if is_explained else _reduce_certainty(problem, confirmed_selection)


def _check_on_held_out_rows(
    rows: DiagnosedRows, training: _Training, tested_selection: _TestedSelection
) -> tuple[_TestedSelection, _HeldOutTest]:
    """Return the selection that the held-out rows do not contradict, and its errors there."""
    held_out_test = _test_held_out_rows(rows, tested_selection.selection)
    doubted_selection = _doubt_failed_prediction(training, tested_selection, held_out_test.errors)
    remaining_selection = _drop_harmful_mechanisms(training, doubted_selection)
    if remaining_selection is not doubted_selection:
        held_out_test = _test_held_out_rows(rows, remaining_selection.selection)
    return remaining_selection, held_out_test


def _drop_harmful_mechanisms(training: _Training, tested_selection: _TestedSelection) -> _TestedSelection:
    """Return the selection; beside an unexplained part, without mechanisms that increase held-out errors."""
    if not tested_selection.unexplained:
        return tested_selection
    problem, before = training.problem, tested_selection.selection
    selection = drop_harmful_mechanisms(problem, training.mask, before)
    if selection is before:
        return tested_selection
    retested = _test_selection(training, selection, tested_selection.replacement_notes)
    return replace(retested, unexplained=True)


def _test_held_out_rows(rows: DiagnosedRows, selection: Selection) -> _HeldOutTest:
    """Return the prediction of the held-out rows by a fit of the selected model without them."""
    problem, mask = rows.problem, rows.training_mask
    baseline = fit_model(problem, mask, (), selection.baseline.estimate.values)
    fit = _fit_selection(problem, selection, mask) if selection.model.mechanisms else baseline
    prediction = predict_with_uncertainty(problem, add_form_errors(problem, fit))
    errors = compute_held_out_errors(problem, rows.blocks, ~mask, baseline, fit, prediction)
    return _HeldOutTest(prediction, errors)


def _doubt_failed_prediction(
    training: _Training, confirmed_selection: _TestedSelection, errors: HeldOutErrors
) -> _TestedSelection:
    """Return the selection; if held-out errors are too large, less certain and with an unexplained part.

    They are too large if they exceed the expected ones, or those of the baseline.
    """
    is_too_large = errors.largest_error_ratio > training.problem.settings.max_held_out_error_ratio
    if (
        not (is_too_large or errors.is_increased(training.problem.settings))
        or confirmed_selection.unexplained
        or not confirmed_selection.selection.named_mechanisms
    ):
        return confirmed_selection
    return _reduce_certainty(training.problem, confirmed_selection)


def _reduce_certainty(problem: LibraryProblem, tested_selection: _TestedSelection) -> _TestedSelection:
    """Return the selection with less certain mechanisms and an unexplained part."""
    mechanisms = tested_selection.selection.named_mechanisms
    ids = {mechanism.id for mechanism in mechanisms}
    mechanisms = shrink_to_even_odds(mechanisms, problem.settings, ids)
    selection = replace(tested_selection.selection, named_mechanisms=mechanisms)
    return replace(tested_selection, selection=selection, unexplained=True)


def _test_selection(
    training: _Training, selection: Selection, replacement_notes: Sequence[str]
) -> _TestedSelection:
    """Return the selection with the test of its residual beyond form errors."""
    problem, mismatch = training.problem, training.mismatch
    residual_test = (
        run_residual_test(problem, add_form_errors(problem, selection.model), training.seed)
        if selection.model.mechanisms
        else mismatch
    )
    is_significant = is_residual_significant(mismatch, residual_test, problem.settings)
    unexplained = training.is_detected and (bool(replacement_notes) or is_significant)
    return _TestedSelection(selection, residual_test, unexplained, replacement_notes)


def _fit_all_rows(problem: LibraryProblem, selection: Selection) -> _FinalFit:
    """Return the baseline and the model with the selected mechanisms, refitted to all rows."""
    all_rows = np.ones(problem.n, dtype=bool)
    # The reported baseline is that of `fit`, which takes the noise as stated.
    baseline = fit_model(problem, all_rows, (), selection.baseline.estimate.values, max_noise_ratio=1.0)
    if not selection.named_mechanisms:
        return _FinalFit(selection, baseline, baseline, {})
    model = fit_noise_correlation(problem, _fit_selection(problem, selection, all_rows))
    model = average_models(problem, model, selection.named_mechanisms)
    form_error_fit = add_form_errors(problem, model)
    form_errors = describe_form_errors(problem, form_error_fit)
    return _FinalFit(
        _add_form_error_ratios(selection, form_errors),
        baseline,
        include_form_errors(model, form_error_fit),
        form_errors,
        build_saved_form_errors(problem, form_error_fit),
    )


def _fit_selection(problem: LibraryProblem, selection: Selection, rows: np.ndarray) -> ModelFit:
    """Return the selected model with its mechanisms, refitted to some rows."""
    return fit_with_misfit_weight(problem, rows, selection.model.mechanisms, selection.start_values)


def _add_form_error_ratios(selection: Selection, parts: dict[str, FormErrorPart]) -> Selection:
    """Return the selection with the size of the form error of each mechanism."""
    mechanisms = tuple(
        replace(mechanism, form_error=parts[mechanism.id].ratio if mechanism.id in parts else None)
        for mechanism in selection.named_mechanisms
    )
    return replace(selection, named_mechanisms=mechanisms)

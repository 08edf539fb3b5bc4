"""Diagnosis of a recording: detect and locate misfit, select mechanisms, validate and report them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from pamjax.compile.parallel import use_one_blas_thread
from pamjax.diagnosis.crossval.confirm_selection import (
    format_dropped_mechanisms,
)
from pamjax.diagnosis.crossval.held_out_ratios import format_harmful_mechanisms
from pamjax.diagnosis.detect.locate import locate_effects, locate_residual
from pamjax.diagnosis.detect.residual_test import (
    compute_residual_share,
)
from pamjax.diagnosis.estimates import collect_mechanism_estimates, compute_parameter_shifts
from pamjax.diagnosis.form_errors.fit import add_form_errors
from pamjax.diagnosis.form_errors.prediction import (
    describe_form_errors,
)
from pamjax.diagnosis.form_errors.uncertainty import include_form_errors
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.next_experiment.experiment import Experiment, propose_experiments
from pamjax.diagnosis.next_experiment.testbed import SimulatedTestbed
from pamjax.diagnosis.noise.estimate import average_sample_noise
from pamjax.diagnosis.noise.noise_ratios import compute_noise_ratios, format_noise_notes, list_unstated_inputs
from pamjax.diagnosis.notes import format_notes
from pamjax.diagnosis.refit.model_fit import ModelFit, fit_model
from pamjax.diagnosis.refit.noise_correlation import fit_noise_correlation
from pamjax.diagnosis.result import Diagnosis
from pamjax.diagnosis.saved_form_errors import build_saved_form_errors
from pamjax.diagnosis.search_rows import DiagnosedRows
from pamjax.diagnosis.select.model_averaging import add_input_noise_bias, average_models, refit_from
from pamjax.diagnosis.select.selection import (
    Selection,
    format_masked_mechanisms,
    select_mechanisms,
)
from pamjax.diagnosis.selection_tests import (
    CheckedSelection,
    HeldOutTest,
    Training,
    check_on_held_out_rows,
    compare_with_templates,
    cross_validate_on_blocks,
    fit_baseline,
    fit_selection,
)
from pamjax.diagnosis.settings import DEFAULT_SETTINGS, DiagnosisSettings
from pamjax.diagnosis.templates.template_context import get_template_builder
from pamjax.diagnosis.templates.template_fits import Likeness, list_likenesses
from pamjax.diagnosis.templates.templates import TemplateBuilder
from pamjax.infer.form_errors.form_model import FormErrorModel
from pamjax.infer.form_errors.parts import FormErrorPart
from pamjax.progress import Progress, ignore_progress
from pamjax.records.case import Case, ensure_case


@dataclass(frozen=True, eq=False)
class _FinalFit:
    """The fits of the selected mechanisms.

    Attributes:
        selection: the mechanisms, with the sizes of their form errors.
        baseline: the fit of the baseline to all rows.
        model: the fit with the mechanisms to all rows.
        search_model: the fit with the mechanisms to all rows of the search; the baseline without mechanisms.
        form_errors: their form errors.
        form_error_model: their form errors for other recordings; None if there are none.
    """

    selection: Selection
    baseline: ModelFit
    model: ModelFit
    search_model: ModelFit
    form_errors: dict[str, FormErrorPart]
    form_error_model: FormErrorModel | None = None


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
        progress: called with the current step and the completed fraction.

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
    training = fit_baseline(rows, seed)
    selection = (
        select_mechanisms(search_problem, training.mask, training.baseline, progress)
        if training.is_detected
        else Selection(training.baseline, training.baseline, ())
    )
    progress("testing", 0.85)
    build_templates_at = get_template_builder(search_problem, rows.search_length, rows.search_blocks)
    checked_selection = compare_with_templates(training, selection, build_templates_at)
    cross_validated_selection = cross_validate_on_blocks(training, checked_selection)
    confirmed_selection, held_out_test = check_on_held_out_rows(rows, training, cross_validated_selection)
    final_fit = _fit_all_rows(rows, confirmed_selection.selection)
    notes = [
        *confirmed_selection.replacement_notes,
        *format_dropped_mechanisms(checked_selection.selection, cross_validated_selection.selection),
        *format_harmful_mechanisms(cross_validated_selection.selection, confirmed_selection.selection),
        *format_masked_mechanisms(confirmed_selection.selection, settings),
    ]
    progress("proposing experiments", 0.9)
    experiments = propose_experiments(
        partial(SimulatedTestbed.from_fit, rows.problem, final_fit.model),
        search_problem,
        final_fit.search_model,
        final_fit.selection.named_mechanisms,
    )
    diagnosis = _build_diagnosis(
        rows, training, confirmed_selection, held_out_test, final_fit, build_templates_at, experiments, notes
    )
    progress("done", 1.0)
    return diagnosis


def _build_diagnosis(
    rows: DiagnosedRows,
    training: Training,
    confirmed_selection: CheckedSelection,
    held_out_test: HeldOutTest,
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
        baseline_test=training.baseline_test,
        misfit_regions=(
            locate_effects(problem, baseline, model)
            if selection.named_mechanisms
            else locate_residual(problem, baseline)
        ),
        residual_test=confirmed_selection.residual_test,
        unexplained=unexplained,
        likenesses=_list_likenesses(training.problem, build_templates_at, selection) if unexplained else (),
        residual_regions=locate_residual(problem, model) if unexplained else [],
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
            *format_noise_notes(
                noise_ratios, problem.settings.min_reported_noise_ratio, list_unstated_inputs(problem.case)
            ),
            *problem.case.warnings,
            *format_notes(problem, baseline, model),
        ],
        experiments=experiments,
        unexplained_reason=confirmed_selection.unexplained_reason,
        form_errors=final_fit.form_errors,
        form_error_model=final_fit.form_error_model,
        form_prediction=prediction if prediction.has_form_errors else None,
    )


def _list_likenesses(
    problem: LibraryProblem, build_templates_at: TemplateBuilder, selection: Selection
) -> tuple[Likeness, ...]:
    """Return the effects outside the library that the residual resembles, of a fit to all rows.

    The unexplained part can be in the held-out rows alone.
    """
    all_rows, model = np.ones(problem.n, dtype=bool), selection.model
    fit = fit_model(problem, all_rows, model.mechanisms, model.estimate.values)
    return list_likenesses(problem, build_templates_at, fit)


def _fit_all_rows(rows: DiagnosedRows, selection: Selection) -> _FinalFit:
    """Return the baseline and the model with the selected mechanisms, refitted to all rows."""
    problem, all_rows = rows.problem, np.ones(rows.problem.n, dtype=bool)
    # The reported baseline is that of `fit`, which takes the noise as stated.
    baseline = fit_model(problem, all_rows, (), selection.baseline.estimate.values, max_noise_ratio=1.0)
    if not selection.named_mechanisms:
        return _FinalFit(selection, baseline, baseline, baseline, {})
    search_model, model = _fit_selected_mechanisms(rows, selection)
    form_error_fit = add_form_errors(problem, model)
    form_errors = describe_form_errors(problem, form_error_fit)
    return _FinalFit(
        _add_form_error_ratios(selection, form_errors),
        baseline,
        include_form_errors(model, form_error_fit),
        search_model,
        form_errors,
        build_saved_form_errors(problem, form_error_fit),
    )


def _fit_selected_mechanisms(rows: DiagnosedRows, selection: Selection) -> tuple[ModelFit, ModelFit]:
    """Return the model with the selected mechanisms, fitted to all rows of the search and to all rows.

    The refits of other models, which need the most time, use the rows of the search. If these are means,
    their noise is that of the fit to all rows.
    """
    problem, search_problem = rows.problem, rows.search_problem
    fit = fit_noise_correlation(problem, fit_selection(problem, selection, np.ones(problem.n, dtype=bool)))
    if search_problem is problem:
        model = add_input_noise_bias(problem, average_models(problem, fit, selection.named_mechanisms))
        return model, model
    noise = average_sample_noise(search_problem, fit.noise, np.ones(search_problem.n, dtype=bool))
    search_fit = refit_from(search_problem, replace(fit, noise=noise), fit.estimate.values)
    search_model = average_models(search_problem, search_fit, selection.named_mechanisms)
    if search_model.estimate is not search_fit.estimate:
        # The covariance between models belongs to the better minimum that the rows of the search have.
        fit = refit_from(problem, fit, search_model.estimate.values)
    return search_model, replace(
        add_input_noise_bias(problem, fit), between_model_covariance=search_model.between_model_covariance
    )


def _add_form_error_ratios(selection: Selection, parts: dict[str, FormErrorPart]) -> Selection:
    """Return the selection with the size of the form error of each mechanism."""
    mechanisms = tuple(
        replace(mechanism, form_error=parts[mechanism.id].ratio if mechanism.id in parts else None)
        for mechanism in selection.named_mechanisms
    )
    return replace(selection, named_mechanisms=mechanisms)

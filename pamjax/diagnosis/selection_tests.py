"""Tests of selected mechanisms: templates, left-out blocks, and held-out rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pamjax.diagnosis.crossval.confirm_selection import (
    cross_validate_selection,
)
from pamjax.diagnosis.crossval.held_out_errors import (
    HeldOutErrors,
    compute_held_out_errors,
)
from pamjax.diagnosis.crossval.held_out_ratios import drop_harmful_mechanisms
from pamjax.diagnosis.detect.residual_test import (
    is_residual_significant,
    run_baseline_test,
    run_residual_test,
)
from pamjax.diagnosis.detect.significance import ResidualTest
from pamjax.diagnosis.form_errors.fit import add_form_errors
from pamjax.diagnosis.form_errors.prediction import (
    ModelPrediction,
    predict_with_uncertainty,
)
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.misfit_weighting import fit_with_misfit_weight
from pamjax.diagnosis.refit.model_fit import ModelFit, fit_model
from pamjax.diagnosis.search_rows import DiagnosedRows
from pamjax.diagnosis.select.replace_by_template import replace_by_template
from pamjax.diagnosis.select.selection import (
    Selection,
    drop_small_effects,
    shrink_to_even_odds,
)
from pamjax.diagnosis.templates.templates import TemplateBuilder
from pamjax.diagnosis.unexplained import UnexplainedReason
from pamjax.records.blocks import Blocks


@dataclass(frozen=True, eq=False)
class Training:
    """The training rows of a search, and the test of the baseline.

    Attributes:
        problem: the rows in which mechanisms are searched, and the library.
        mask: (n,) whether a row is used in the fits, and not held out.
        blocks: isobars, holds or cycles of these rows.
        baseline: the baseline, fitted to the training rows.
        baseline_test: test of the baseline's residual on all rows, training and held-out.
        seed: seed of the random draws for the p-values.
    """

    problem: LibraryProblem
    mask: np.ndarray
    blocks: Blocks
    baseline: ModelFit
    baseline_test: ResidualTest
    seed: int

    @property
    def is_detected(self) -> bool:
        """Return whether the misfit of the baseline is significant."""
        return self.baseline_test.p_value < self.problem.settings.detection_p_value

    @cached_property
    def training_test(self) -> ResidualTest:
        """Return the test of the baseline's residual on the training rows alone."""
        return run_residual_test(self.problem, self.baseline, self.seed)


@dataclass(frozen=True, eq=False)
class CheckedSelection:
    """Mechanisms that were selected on the training rows, and the test of their residual.

    Attributes:
        selection: the mechanisms.
        residual_test: test of the residual with the mechanisms.
        replacement_notes: notes on mechanisms that a template replaces.
        unexplained_reason: the first reason why a part is unexplained; None if nothing is unexplained.
    """

    selection: Selection
    residual_test: ResidualTest
    replacement_notes: Sequence[str] = ()
    unexplained_reason: UnexplainedReason | None = None

    @property
    def unexplained(self) -> bool:
        """Return whether no mechanism explains a part of the misfit."""
        return self.unexplained_reason is not None


@dataclass(frozen=True, eq=False)
class HeldOutTest:
    """The prediction of the held-out rows by a fit without them, and its errors."""

    prediction: ModelPrediction
    errors: HeldOutErrors


def fit_baseline(rows: DiagnosedRows, seed: int) -> Training:
    """Return the fit of the baseline to the training rows, and its test on all rows of the search."""
    problem, mask = rows.search_problem, rows.training_mask[rows.search_rows]
    baseline = fit_model(problem, mask, (), problem.neutral)
    baseline_test = run_baseline_test(problem, baseline.estimate.values, seed)
    return Training(problem, mask, rows.search_blocks, baseline, baseline_test, seed)


def compare_with_templates(
    training: Training, selection: Selection, build_templates_at: TemplateBuilder
) -> CheckedSelection:
    """Return the mechanisms that no template replaces; without small effects if a part is unexplained."""
    remaining, notes = replace_by_template(training.problem, training.mask, selection, build_templates_at)
    if notes and not _get_ids(selection) - _get_ids(remaining) - selection.masked_ids:
        # Without its masked effects, a model explains the same misfit by form errors. Test these instead.
        return compare_with_templates(training, remaining, build_templates_at)
    checked_selection = _test_selection(training, remaining, notes)
    if not checked_selection.unexplained or remaining.fit_without_small_effects is None:
        return checked_selection
    # Small effects are reported only if nothing is unexplained: otherwise they can absorb that part.
    return compare_with_templates(
        training, drop_small_effects(training.problem, remaining), build_templates_at
    )


def _get_ids(selection: Selection) -> set[str]:
    return {mechanism.id for mechanism in selection.named_mechanisms}


def cross_validate_on_blocks(training: Training, checked_selection: CheckedSelection) -> CheckedSelection:
    """Return the mechanisms that also predict left-out blocks; less certain if a part is unexplained.

    Mechanisms can absorb physics outside the library, so that the residual is no longer significant.
    """
    problem = training.problem
    if not checked_selection.selection.named_mechanisms:
        return checked_selection
    selection, is_predictive = cross_validate_selection(
        problem, training.blocks, training.mask, checked_selection.selection
    )
    confirmed_selection = (
        replace(checked_selection, selection=selection)
        if selection.model is checked_selection.selection.model
        else _test_selection(training, selection, checked_selection.replacement_notes)
    )
    is_explained = is_predictive and not confirmed_selection.unexplained
    if is_explained:
        return confirmed_selection
    return _reduce_certainty(problem, confirmed_selection, UnexplainedReason.LEFT_OUT_BLOCKS)


def check_on_held_out_rows(
    rows: DiagnosedRows, training: Training, checked_selection: CheckedSelection
) -> tuple[CheckedSelection, HeldOutTest]:
    """Return the selection that the held-out rows do not contradict, and its errors there."""
    held_out_test = _test_held_out_rows(rows, checked_selection.selection)
    doubted_selection = _doubt_failed_prediction(training, checked_selection, held_out_test.errors)
    remaining_selection = _drop_harmful_mechanisms(training, doubted_selection)
    if remaining_selection is not doubted_selection:
        held_out_test = _test_held_out_rows(rows, remaining_selection.selection)
    return remaining_selection, held_out_test


def _drop_harmful_mechanisms(training: Training, checked_selection: CheckedSelection) -> CheckedSelection:
    """Return the selection; if a part is unexplained, without mechanisms that increase held-out errors."""
    if not checked_selection.unexplained:
        return checked_selection
    problem, before = training.problem, checked_selection.selection
    selection = drop_harmful_mechanisms(problem, training.mask, before)
    if selection is before:
        return checked_selection
    retested = _test_selection(training, selection, checked_selection.replacement_notes)
    reason = retested.unexplained_reason or checked_selection.unexplained_reason
    return replace(retested, unexplained_reason=reason)


def _test_held_out_rows(rows: DiagnosedRows, selection: Selection) -> HeldOutTest:
    """Return the prediction of the held-out rows by a fit of the selected model without them."""
    problem, mask = rows.problem, rows.training_mask
    baseline = fit_model(problem, mask, (), selection.baseline.estimate.values)
    fit = fit_selection(problem, selection, mask) if selection.model.mechanisms else baseline
    prediction = predict_with_uncertainty(problem, add_form_errors(problem, fit))
    errors = compute_held_out_errors(problem, rows.blocks, ~mask, baseline, fit, prediction)
    return HeldOutTest(prediction, errors)


def _doubt_failed_prediction(
    training: Training, confirmed_selection: CheckedSelection, errors: HeldOutErrors
) -> CheckedSelection:
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
    reason = UnexplainedReason.HELD_OUT_ERROR if is_too_large else UnexplainedReason.INCREASED_ERROR
    return _reduce_certainty(training.problem, confirmed_selection, reason)


def _reduce_certainty(
    problem: LibraryProblem, checked_selection: CheckedSelection, reason: UnexplainedReason
) -> CheckedSelection:
    """Return the selection with less certain mechanisms and an unexplained part.

    Args:
        problem: the recording and the library.
        checked_selection: the selection.
        reason: why a part is unexplained, if the selection has no reason yet.
    """
    selection = checked_selection.selection
    mechanisms = shrink_to_even_odds(selection.named_mechanisms, problem.settings, _get_ids(selection))
    selection = replace(selection, named_mechanisms=mechanisms)
    reason = checked_selection.unexplained_reason or reason
    return replace(checked_selection, selection=selection, unexplained_reason=reason)


def _test_selection(
    training: Training, selection: Selection, replacement_notes: Sequence[str]
) -> CheckedSelection:
    """Return the selection with the test of its residual beyond form errors."""
    problem, reference = training.problem, training.baseline_test
    residual_test = reference
    if selection.model.mechanisms:
        # Held-out rows, which the model does not fit, must not raise the limit of a large residual.
        reference = training.training_test
        form_error_fit = add_form_errors(problem, selection.model)
        residual_test = run_residual_test(problem, form_error_fit, training.seed)
    reason = None
    if training.is_detected and is_residual_significant(reference, residual_test, problem.settings):
        reason = UnexplainedReason.RESIDUAL
    elif training.is_detected and replacement_notes:
        reason = UnexplainedReason.TEMPLATE
    return CheckedSelection(selection, residual_test, replacement_notes, reason)


def fit_selection(problem: LibraryProblem, selection: Selection, rows: np.ndarray) -> ModelFit:
    """Return the selected model with its mechanisms, refitted to some rows."""
    return fit_with_misfit_weight(problem, rows, selection.model.mechanisms, selection.start_values)

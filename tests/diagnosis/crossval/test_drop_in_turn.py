"""Mechanisms that left-out blocks do not confirm are dropped one at a time."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pamjax.diagnosis.crossval import confirm_selection
from pamjax.diagnosis.select.rivals import NamedMechanism
from pamjax.diagnosis.select.selection import Selection
from pamjax.diagnosis.selection_tests import CheckedSelection, _doubt_failed_prediction
from pamjax.diagnosis.unexplained import UnexplainedReason
from tests.view.made_up import diagnosis

#: By the mechanisms in the model: predicted fraction of each, and excess χ² of left-out blocks without it.
FRACTIONS = {
    # Two effects whose sum is right, and a third one that spoils the prediction.
    ("creep", "crimp", "rubber"): {"creep": 0.0, "crimp": 0.0, "rubber": 1.0},
    ("creep", "rubber"): {"creep": 1.0, "rubber": 1.0},
    ("crimp", "rubber"): {"crimp": 1.0, "rubber": 1.0},
    ("slip",): {"slip": 0.1},
}
EXCESS_WITHOUT = {"creep": 2300.0, "crimp": 650.0, "rubber": 1e5, "slip": 10.0}


@pytest.fixture
def confirm(monkeypatch):
    """Return the ids and probabilities that remain of some mechanisms."""
    settings = diagnosis().settings

    def cross_validate(problem, blocks, mask, ids):
        key = tuple(sorted(ids))
        return SimpleNamespace(
            predicted_fraction_by_mechanism=FRACTIONS[key],
            left_out_excess_without={id: EXCESS_WITHOUT[id] for id in key},
            fails_out_of_sample=False,
        )

    def restrict(problem, mask, selection, named_mechanisms):
        named = tuple(named_mechanisms)
        return replace(selection, model=[m.id for m in named], named_mechanisms=named)

    cross_validation = SimpleNamespace(from_blocks=cross_validate)
    monkeypatch.setattr(confirm_selection, "BlockCrossValidation", cross_validation)
    monkeypatch.setattr(confirm_selection, "restrict_selection", restrict)
    monkeypatch.setattr(confirm_selection, "add_form_errors", lambda problem, model: model)

    def _confirm(*ids):
        named = tuple(NamedMechanism(id, 0.9, (), 1.0) for id in ids)
        selection = Selection([], list(ids), named)  # type: ignore[arg-type]
        problem = SimpleNamespace(settings=settings)
        confirmed, _ = confirm_selection.cross_validate_selection(problem, None, None, selection)  # type: ignore[arg-type]
        return {m.id: m.probability for m in confirmed.named_mechanisms}

    return _confirm


def test_the_others_are_tested_again_without_the_worst(confirm):
    assert confirm("creep", "crimp", "rubber") == {"creep": 0.9, "rubber": 0.9}


def test_a_single_mechanism_is_dropped(confirm):
    assert confirm("slip") == {}


@pytest.mark.parametrize(("factor", "is_doubted"), [(1.5, True), (1.01, False), (0.5, False)])
def test_an_increased_held_out_error_reduces_the_certainty(factor, is_doubted):
    result = diagnosis()
    errors = replace(
        result.held_out_errors,
        expected_rmse={"force": 10.0},
        baseline_rmse={"force": 12.0},
        model_rmse={"force": factor * 12.0},
        held_out_mask=np.ones(100, bool),
    )
    before = CheckedSelection(result.selection, result.residual_test)
    after = _doubt_failed_prediction(SimpleNamespace(problem=result.problem), before, errors)  # type: ignore[arg-type]
    assert after.unexplained == is_doubted
    assert after.unexplained_reason == (UnexplainedReason.INCREASED_ERROR if is_doubted else None)
    probabilities = [s.selection.named_mechanisms[0].probability for s in (before, after)]
    assert (probabilities[1] < probabilities[0]) == is_doubted

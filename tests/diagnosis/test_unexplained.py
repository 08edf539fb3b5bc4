"""Why a part of the misfit counts as unexplained, and how probable an outside effect then is."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from pamjax.diagnosis import selection_tests
from pamjax.diagnosis.selection_tests import CheckedSelection, cross_validate_on_blocks
from pamjax.diagnosis.unexplained import (
    UnexplainedReason,
    compute_unexplained_probability,
    describe_unexplained_probability,
)
from tests.view.made_up import diagnosis

BANKS = Path(__file__).parents[2] / "fits" / "proof" / "other_forms"


def build_training(result):
    return SimpleNamespace(
        problem=result.problem,
        blocks=None,
        mask=None,
        seed=0,
        baseline_test=result.baseline_test,
        training_test=result.baseline_test,
        is_detected=True,
    )


@pytest.mark.parametrize(
    ("earlier", "expected"),
    [
        (None, UnexplainedReason.LEFT_OUT_BLOCKS),
        (UnexplainedReason.TEMPLATE, UnexplainedReason.TEMPLATE),
    ],
)
def test_blocks_that_are_not_predicted_are_the_reason(earlier, expected, monkeypatch):
    result = diagnosis()
    monkeypatch.setattr(selection_tests, "cross_validate_selection", lambda *_: (result.selection, False))
    before = CheckedSelection(result.selection, result.residual_test, unexplained_reason=earlier)
    after = cross_validate_on_blocks(build_training(result), before)
    assert after.unexplained
    assert after.unexplained_reason is expected


@pytest.mark.parametrize(
    ("p_value", "notes", "expected"),
    [
        (1e-9, [], UnexplainedReason.RESIDUAL),
        (1e-9, ["replaced"], UnexplainedReason.RESIDUAL),
        (0.86, ["replaced"], UnexplainedReason.TEMPLATE),
        (0.86, [], None),
    ],
)
def test_residual_test_and_templates_are_reasons(p_value, notes, expected, monkeypatch):
    result = diagnosis()
    residual_test = replace(result.residual_test, p_value=p_value, mean_square=50.0)
    monkeypatch.setattr(selection_tests, "run_residual_test", lambda *_: residual_test)
    monkeypatch.setattr(selection_tests, "add_form_errors", lambda _, fit: fit)
    model = SimpleNamespace(mechanisms=("friction",))
    after = selection_tests._test_selection(
        build_training(result), replace(result.selection, model=model), notes
    )
    assert after.unexplained == (expected is not None)
    assert after.unexplained_reason is expected


def test_held_out_rows_do_not_raise_the_limit_of_the_residual(monkeypatch):
    """A huge misfit of the held-out rows alone must not make that of the training rows look small."""
    result = diagnosis()
    training = build_training(result)
    training.baseline_test = replace(result.baseline_test, mean_square=1e6)
    residual_test = replace(result.residual_test, p_value=1e-9, mean_square=50.0)
    monkeypatch.setattr(selection_tests, "run_residual_test", lambda *_: residual_test)
    monkeypatch.setattr(selection_tests, "add_form_errors", lambda _, fit: fit)
    selection = replace(result.selection, model=SimpleNamespace(mechanisms=("friction",)))
    assert selection_tests._test_selection(training, selection, []).unexplained


def test_probability_of_outside_physics_follows_the_decisions():
    """An unexplained part makes it likely, and less so beside names; the file has the same number."""
    beside_names = replace(diagnosis(), unexplained=True)
    alone = replace(beside_names, selection=replace(beside_names.selection, named_mechanisms=()))
    explained = replace(alone, unexplained=False)
    probabilities = [compute_unexplained_probability(each) for each in (alone, beside_names, explained)]
    assert probabilities == sorted(probabilities, reverse=True)
    assert probabilities[1] > 0.5 > probabilities[2] > 0
    assert beside_names.as_dict()["unexplained"]["probability"] == probabilities[1]


SENTENCE = "Of simulated recordings with such a result, 80 % have an effect outside the library."


@pytest.mark.parametrize(
    ("unexplained", "has_time", "expected"),
    [(True, True, SENTENCE), (True, False, None), (False, True, None)],
)
def test_probability_is_stated_if_all_mechanisms_were_tested(unexplained, has_time, expected):
    result = replace(diagnosis(), unexplained=unexplained)
    recording = SimpleNamespace(has_time=has_time)
    result = replace(result, problem=SimpleNamespace(case=SimpleNamespace(recording=recording)))
    assert describe_unexplained_probability(result) == expected


def test_summary_states_the_probability():
    assert SENTENCE in str(replace(diagnosis(), unexplained=True))
    assert SENTENCE not in str(diagnosis())


def test_probabilities_are_those_of_the_banks():
    """The measured shares of recordings with an outside effect, by the rule of succession."""
    counts = {}
    for seed in (97, 101):
        for line in (BANKS / f"seed-{seed}" / "trials.jsonl").read_text("utf-8").splitlines():
            trial = json.loads(line)
            decisions = trial.get("unexplained", False), bool(trial.get("named"))
            decisions = decisions if decisions[0] else (False, False)
            present, total = counts.get(decisions, (0, 0))
            counts[decisions] = (present + bool(trial.get("outside")), total + 1)
    measured = {key: (present + 1) / (total + 2) for key, (present, total) in counts.items()}
    beside_names = replace(diagnosis(), unexplained=True)
    alone = replace(beside_names, selection=replace(beside_names.selection, named_mechanisms=()))
    for result, decisions in (
        (alone, (True, False)),
        (beside_names, (True, True)),
        (diagnosis(), (False, False)),
    ):
        assert compute_unexplained_probability(result) == pytest.approx(measured[decisions], rel=0.02)

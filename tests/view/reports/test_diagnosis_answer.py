"""The first screen of a diagnosis report: its headline and its answers."""

import math
from dataclasses import replace

import pytest

from pamjax.diagnosis.estimates import ParameterEstimate
from pamjax.diagnosis.notes import format_untestable_mechanisms
from pamjax.diagnosis.summary import format_named_estimate, format_summary
from pamjax.diagnosis.unexplained import UnexplainedReason, describe_unexplained_reason
from pamjax.errors import BadInput
from pamjax.infer.fitting.io import save
from pamjax.model.parameters import find_meaning
from pamjax.view.reports.diagnosis_answer import format_headline, list_answers
from tests.view.made_up import diagnosis, planned, table


def answers_of(result):
    """Return the sentences of the first screen, by question."""
    return {a.question: " ".join(a.sentences) for a in list_answers(result)}


def test_first_screen_answers_five_questions_in_order():
    result = diagnosis()
    assert format_headline(result) == "Missing from the baseline: friction between braid threads"
    answers = answers_of(result)
    assert list(answers) == ["Missing", "How sure", "Where", "How much better", "Next"]
    assert answers["Missing"] == "`braid_friction`: coefficient 0.210 ± 0.010."
    assert answers["How sure"].startswith("Probability 0.98; no other mechanism explains")
    assert "p < 1e-12" in answers["How sure"]
    assert answers["Where"].startswith("Above 100 kPa")
    before, after = (
        s["force"] for s in (result.held_out_errors.baseline_rmse, result.held_out_errors.model_rmse)
    )
    assert f"force {before:.3g} → {after:.3g} N (noise 2 N); diameter" in answers["How much better"]
    assert "pamjax validate model.json OTHER" in answers["Next"]


@pytest.mark.parametrize(
    ("options", "title", "question", "sentence"),
    [
        (
            {"detected": False},
            "The baseline has no misfit beyond the noise",
            "How sure",
            "Global test of the baseline: p = 0.43. pamjax reports a misfit only below p = 0.01."
            " Noise alone is below this limit in 1 % of recordings.",
        ),
        (
            {"named": False, "unexplained": True},
            "The baseline has a misfit that no mechanism of the library explains",
            "Missing",
            "12 % of the misfit is unexplained, similar to a stop beyond 12.0 % contraction.",
        ),
        (
            {"unexplained": True},
            "Missing from the baseline: friction between braid threads; part of the misfit is unexplained",
            "How sure",
            "Of simulated recordings with such a result, 80 % have an effect outside the library.",
        ),
        (
            {"named": False},
            "The baseline has a misfit that is too small to identify its cause",
            "Missing",
            "so pamjax names no mechanism",
        ),
        (
            {"unexplained": True},
            "Missing from the baseline: friction between braid threads; part of the misfit is unexplained",
            "Next",
            "Check the rig and the muscle",
        ),
        (
            {"ties": ("channel_lag",), "experiments": (planned(),)},
            "Missing from the baseline: friction between braid threads"
            " (or time delay between force and the other channels)",
            "Next",
            "Run this: stroke at 1 and at 50 mm/s. It separates",
        ),
    ],
    ids=["null", "unknown", "partly-sure", "faint", "partly", "tied"],
)
def test_first_screen_of_other_results(options, title, question, sentence):
    result = diagnosis(**options)
    assert format_headline(result) == title
    assert sentence in answers_of(result)[question]


def test_first_screen_and_summary_state_what_a_recording_without_time_cannot_test():
    result = diagnosis(named=False, unexplained=True, protocol=table)
    effects = "Without a column `time`, friction, damping, relaxation, delays and drift were not tested."
    answers = answers_of(result)
    assert answers["Not tested"] == effects
    assert "add the column `time`" in answers["Next"]
    assert (
        format_headline(result)
        == "The baseline has a misfit that no tested mechanism of the library explains"
    )
    summary = str(replace(result, notes=[*result.notes, *format_untestable_mechanisms(result.problem)]))
    assert [line for line in summary.splitlines() if "not tested" in line] == [f"  {effects}"]
    with_time = diagnosis(named=False, unexplained=True)
    assert "Not tested" not in answers_of(with_time)
    assert "not tested" not in str(with_time)


@pytest.mark.parametrize(
    ("reason", "p_value", "sentence"),
    [
        (
            UnexplainedReason.RESIDUAL,
            1e-6,
            "Reason: the residual test is significant also with the mechanisms (p = 1e-06).",
        ),
        (
            UnexplainedReason.LEFT_OUT_BLOCKS,
            0.86,
            "The residual test is not significant (p = 0.86), but in cross-validation, the mechanisms do not"
            " explain most of the misfit of the left-out blocks.",
        ),
        (
            UnexplainedReason.TEMPLATE,
            1e-6,
            "Reason: an effect outside the library explains the misfit better than a mechanism.",
        ),
    ],
)
def test_reason_of_an_unexplained_part_is_on_the_first_screen(reason, p_value, sentence):
    result = diagnosis(unexplained=True)
    residual_test = replace(result.residual_test, p_value=p_value)
    result = replace(result, unexplained_reason=reason, residual_test=residual_test)
    assert answers_of(result)["Missing"].endswith(sentence)
    assert f"    {sentence}" in str(result).splitlines()


def test_nothing_unexplained_has_no_reason():
    assert describe_unexplained_reason(diagnosis()) is None
    assert describe_unexplained_reason(diagnosis(named=False, unexplained=True)) is None


def test_undetermined_parameters_are_last_and_have_no_value():
    names = ("coefficient", "constant", "angle")
    coefficient, constant, angle = (find_meaning(f"braid_friction.{name}") for name in names)
    estimates = {
        "coefficient": ParameterEstimate(0.1, 100.0, coefficient),
        "angle": ParameterEstimate(0.0, 0.05, angle),
        "constant": ParameterEstimate(2.0, 0.5, constant),
    }
    result = replace(diagnosis(), parameters={"braid_friction": estimates})
    text = "constant 2.00 ± 0.50 N, angle 0.000 ± 0.050, coefficient not determined"
    assert answers_of(result)["Missing"] == f"`braid_friction`: {text}."
    assert f"    {text}" in str(result).splitlines()


def test_value_at_its_limit_is_shown():
    estimate = ParameterEstimate(2.98765, math.nan, find_meaning("braid_friction.coefficient"), at_limit=True)
    assert format_named_estimate("coefficient", estimate) == "coefficient 2.988 (at its limit)"


def test_change_of_a_parameter_has_the_sd_of_the_new_value():
    result = diagnosis()
    lines = [line for line in str(result).splitlines() if "changes from" in line]
    assert lines == ["  thread.modulus changes from 80.0 ± 1.2 GPa to 92.0 ± 1.2 GPa"]
    # A baseline at its limit has no sd: the change is shown, without a shift in sd.
    result.baseline.estimate.values[0] = 400e9
    shift = replace(result.parameter_shifts["thread.modulus"], baseline_value=400e9, shift_in_sd=math.nan)
    result.parameter_shifts["thread.modulus"] = shift
    assert "  thread.modulus changes from 400 GPa (at its upper limit) to 92.0 ± 1.2 GPa" in str(result)
    document = result.as_dict()
    assert document["baseline"]["parameters"]["thread.modulus"]["sd"] is None
    assert document["parameters_moved"]["thread.modulus"]["shift_in_sd"] is None


@pytest.mark.parametrize(("factor", "is_doubted"), [(0.9, False), (1.0001, True)])
def test_held_out_error_that_does_not_decrease_is_reported(factor, is_doubted):
    result = diagnosis()
    errors = result.held_out_errors
    rmse = {channel: factor * value for channel, value in errors.baseline_rmse.items()}
    result = replace(result, held_out_errors=replace(errors, model_rmse=rmse))
    sentence = "The held-out error is larger with the mechanisms, but the increase is within the noise."
    assert (sentence in str(result)) is is_doubted
    assert (sentence in answers_of(result)["How much better"]) is is_doubted


def test_table_and_files_of_a_diagnosis(tmp_path):
    frame = diagnosis().to_frame()
    row = frame.loc["braid_friction.coefficient"]
    assert (row["value"], row["sd"], row["unit"], row["probability"]) == (0.21, 0.01, "1", 0.98)
    assert diagnosis(named=False).to_frame().empty
    with pytest.raises(
        BadInput, match=r"`save` writes a fit; got a Diagnosis\. .*`diagnosis\.save\(folder\)`"
    ):
        save(diagnosis(), tmp_path)  # type: ignore[arg-type]


def test_summary_labels_each_number_of_the_held_out_errors():
    result = diagnosis()
    errors = replace(
        result.held_out_errors,
        baseline_rmse={"force": 7.5},
        model_rmse={"force": 2.5},
        expected_rmse={"force": 2.6},
        block_description="1 of 3 isobars: 250 kPa",
    )
    line = next(
        line
        for line in format_summary(replace(result, held_out_errors=errors)).splitlines()
        if "rmse" in line
    )
    assert line == (
        "  held-out rmse of force (1 of 3 isobars): baseline 7.5 N, with mechanisms 2.5 N, expected 2.6 N,"
        " noise 2 N"
    )
    alone = format_summary(replace(diagnosis(named=False, unexplained=True), held_out_errors=errors))
    assert "  held-out rmse of force (1 of 3 isobars): baseline 7.5 N, noise 2 N" in alone.splitlines()

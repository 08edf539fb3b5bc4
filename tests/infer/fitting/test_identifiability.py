"""Identifiability of the parameters of a recording, and its text."""

import re
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.infer.fitting.case_summary import CaseSummary
from pamjax.infer.fitting.determination import NOT_DETERMINED
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.identifiability import check_identifiability, describe_weak_information
from pamjax.infer.fitting.result import Estimate
from pamjax.infer.problem.priors import list_free_parameters
from pamjax.model.assembly import assemble
from pamjax.model.muscle import predict
from pamjax.model.parameters import find_meaning
from pamjax.records.dataframe import case_from
from pamjax.records.protocol import Protocol
from pamjax.records.reading.muscle_toml import Sensors
from tests.infer.made import TRUE, made

MUSCLE = {
    "muscle": {
        "rest_length": "235.7 mm",
        "thread_length": {"value": "251.2 mm", "sd": "0.8 mm"},
        "turns": {"value": 1.09, "sd": 0.005},
    }
}

#: As the paper's Table 1: diameters at one length, five pressures.
TABLE = Protocol(
    kind="holds",
    pressures=["138 kPa", "276 kPa", "414 kPa", "552 kPa", "689 kPa"],
    contractions=[0.0],
    duration="1 s",
)
DIAMETERS = {"plan": TABLE, "channels": ("diameter",), "bench": Sensors(diameter=2e-5)}


def test_complete_recording_determines_all_parameters():
    parameters, sentences = check_identifiability(made())
    assert all(d.is_determined for d in parameters)
    assert sentences == [
        "This recording can determine `muscle.thread_length`, `muscle.turns` and `thread.modulus`, "
        "if the model is correct."
    ]


def test_diameters_at_one_length_do_not_determine_turns():
    parameters, sentences = check_identifiability(made(**DIAMETERS))
    assert {d.name: d.is_determined for d in parameters} == {
        "muscle.thread_length": True,
        "muscle.turns": False,
        "thread.modulus": True,
    }
    assert sentences[-1] == ("This recording does not determine `muscle.turns`: a fit returns its prior.")


def test_table_and_sentences_of_check_agree():
    case = made(**DIAMETERS)
    summary = str(CaseSummary(case, *check_identifiability(case)))
    assert "not determined by the data" in summary
    assert "partly determined by the data" not in summary


def test_sentence_depends_on_how_well_a_parameter_is_determined():
    determined, partly = (describe_weak_information("muscle.turns", kind) for kind in (NOT_DETERMINED, None))
    assert determined == "This recording does not determine `muscle.turns`: a fit returns its prior."
    assert partly == (
        "This recording reduces the sd of `muscle.turns` by less than half:"
        " the estimate depends mostly on the prior."
    )


def test_check_and_fit_have_one_scale_without_a_prior():
    meaning = find_meaning("thread.stiffness")
    estimate = Estimate(value=1e5, sd=1e4, prior=1e5, prior_sd=np.inf, meaning=meaning, at_limit=False)
    entry = {**MUSCLE, "baseline": {"model": "elastic"}}
    case = case_from(made().recording.to_frame(), entry, name="unstated")
    (stiffness,) = (d for d in check_identifiability(case)[0] if d.name == "thread.stiffness")
    stated = {p.name: p.start for p in list_free_parameters(case, "elastic")}["thread.stiffness"]
    ratio = stiffness.expected_sd / stiffness.sd_ratio / stated
    assert ratio == pytest.approx(estimate.sd / estimate.sd_ratio / estimate.value)


def test_fewer_rows_than_unknown_parameters_are_reported():
    frame = made().recording.to_frame()
    # Both are padded to eight rows, so that one program computes both.
    few, many = (case_from(frame[:rows], MUSCLE, name="few") for rows in (3, 8))
    friction = ("braid_friction",)
    assert "measure more rows, or use fewer mechanisms" in check_identifiability(few, None, friction)[1][-1]
    assert "measure more rows" not in " ".join(check_identifiability(many, None, friction)[1])
    assert "measure more rows" not in " ".join(check_identifiability(few)[1])


@pytest.mark.slow
def test_fit_then_returns_the_prior_of_the_turns():
    fitted = fit(made(**DIAMETERS), starts=1)
    turns = fitted.estimates["muscle.turns"]
    assert turns.sd_ratio > 0.9
    assert "not determined by the data (posterior equals prior)" in str(fitted)


def test_forces_at_one_length_determine_turns_only_in_combination():
    # F = P (3 L² − B²) / (4 π N²): one factor of the pressure, with two parameters.
    case = made(plan=TABLE, channels=("force",), off=(0, 0, 0))
    _, sentences = check_identifiability(case, "inelastic")
    (sentence,) = (s for s in sentences if "only in combination" in s)
    moves = dict(re.findall(r"`([\w.]+)` ([+-]?[\d.e-]+)", sentence))
    assert set(moves) == {"muscle.thread_length", "muscle.turns"}

    def force(**by):
        numbers = {n: jnp.asarray(TRUE[n] + by.get(n.split(".")[1], 0.0)) for n in TRUE}
        return np.asarray(
            predict(assemble("inelastic", numbers), [6.89e5], [TRUE["muscle.rest_length"]]).force
        )

    length, turns = float(moves["muscle.thread_length"]) * 1e-3, float(moves["muscle.turns"])
    together = abs(force(thread_length=length, turns=turns) - force())
    assert together < 0.1 * abs(force(thread_length=length) - force())
    assert together < 0.1 * abs(force(turns=turns) - force())


def test_expected_sd_agrees_with_the_fit():
    # Without a fit, the sensor noise gives the expected sd.
    case = made(off=(0, 0, 0))
    fitted = fit(case, starts=1, fold_count=2)
    for d in check_identifiability(case)[0]:
        assert d.expected_sd == pytest.approx(fitted.estimates[d.name].sd, rel=0.25)


def test_summary_counts_rows_and_parameters():
    case = made()
    seen = CaseSummary(case, *check_identifiability(case))
    assert "4 isobars for cross-validation" in str(seen)
    document = seen.as_dict()
    assert document["numbers"]["thread.modulus"]["unit"] == "GPa"
    assert document["numbers"]["thread.modulus"]["sd_before"] == pytest.approx(8.0)
    assert document["blocks"]["names"][0] == "isobar 100 kPa"


@pytest.mark.parametrize("has_time", [True, False])
def test_summary_of_a_static_table_names_what_it_cannot_test(has_time):
    case = made()
    assert case.recording.has_time
    if not has_time:
        case = replace(case, recording=replace(case.recording, time=None))
    note = "Without the column `time`, a diagnosis cannot test friction"
    assert (note in str(CaseSummary(case, *check_identifiability(case)))) != has_time

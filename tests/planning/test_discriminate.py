"""The comparison of two mechanisms in a plan is that of a diagnosis."""

from typing import Any

import numpy as np
import pytest

from pamjax.diagnosis.detect.significance import ResidualTest
from pamjax.diagnosis.next_experiment.experiment import Experiment
from pamjax.diagnosis.run import diagnose
from pamjax.errors import BadInput
from pamjax.planning.compare_pair import PairComparison
from pamjax.planning.discriminate import Discrimination, discriminate
from pamjax.records.case import read_case
from pamjax.records.writing.template import write_template
from pamjax.view.reports.discrimination import format_answer, format_headline


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return read_case(write_template(tmp_path_factory.mktemp("new") / "mine")[0].parent)


def build(case, bic_difference, neither=False, mechanisms=()):
    """Return a discrimination with a given comparison and one protocol."""
    residual_test = ResidualTest(0.5, 1.0, 3, 4.0)
    nothing: Any = None
    comparison = PairComparison(
        (nothing, nothing), int(bic_difference < 0), bic_difference, 12.0, (residual_test,) * 2, neither
    )
    experiment = Experiment("Stroke slowly (5 min)", ("a", "b"), 0.95, 5.0, "X2", 3.0)
    return Discrimination(case, ("a", "b"), mechanisms, comparison, nothing, (experiment,), experiment)


@pytest.mark.parametrize(
    ("difference", "sentence", "headline"),
    [
        (-5.0, "does not distinguish a from b: their BIC differs by 5", "A protocol of 5 min"),
        (
            30.0,
            "a fits this recording better than b: its BIC is lower by 30",
            "already distinguishes a from b",
        ),
        (-30.0, "b fits this recording better than a", "already distinguishes a from b"),
    ],
)
def test_text_agrees_with_the_limit_of_a_diagnosis(case, difference, sentence, headline):
    discrimination = build(case, difference)
    assert sentence in discrimination.comparison_sentence
    assert headline in format_headline(discrimination)
    assert "--with" in " ".join(format_answer(discrimination))
    assert ("experiment to confirm this: " in str(discrimination)) == (abs(difference) > 12)


def test_mechanisms_in_both_models_are_named(case):
    discrimination = build(case, 5.0, mechanisms=("braid_elasticity",))
    assert "both models also have braid_elasticity" in str(discrimination)
    assert "--with" not in str(discrimination)


def test_misfit_of_both_comes_before_the_comparison(case):
    discrimination = build(case, 30.0, neither=True)
    assert not discrimination.is_distinguished
    assert "neither a nor b explains this recording" in str(discrimination)


def test_mechanism_cannot_be_in_both_models_and_compared(case):
    with pytest.raises(BadInput, match="'viscous_damping' twice"):
        discriminate(case, "braid_friction", "viscous_damping", mechanisms=["viscous_damping"])


@pytest.mark.slow
def test_plan_and_diagnosis_compare_two_mechanisms_alike(case):
    steps = []
    discrimination = discriminate(
        case, "viscous_damping", "braid_friction", lambda step, share: steps.append(share)
    )
    (friction,) = diagnose(case).named_mechanisms
    # The diagnosis uses two of three isobars.
    expected = friction.rival_bic_increase["viscous_damping"]
    assert 0.7 < -discrimination.comparison.bic_difference / expected < 1.8
    assert "viscous_damping" not in friction.indistinguishable
    assert discrimination.is_distinguished
    assert discrimination.comparison.better == 1
    # The progress is complete at the end.
    assert steps[-1] == 1.0
    assert np.all(np.diff(steps) >= 0)
    assert discrimination.chosen_experiment.power > 0.9

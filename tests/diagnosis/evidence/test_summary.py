"""Names and ties from the evidence of sets."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from pamjax.diagnosis.evidence.evidence_search import EvidenceFit
from pamjax.diagnosis.evidence.marginal_likelihood import Evidence
from pamjax.diagnosis.evidence.settings import EvidenceSettings
from pamjax.diagnosis.evidence.summary import summarise
from pamjax.diagnosis.library.candidates import Candidate

SETTINGS = EvidenceSettings()


def build_fit(ids, log_z, generic=-np.inf, ratios=None, overdispersion=1.0):
    """Return a set of mechanisms with an evidence."""
    mechanisms = tuple(Candidate(id, (f"{id}.a",)) for id in ids)
    evidence = Evidence(log_z, generic, np.zeros(0), 1.0, (), outside_mean_square=0.05)
    estimate = SimpleNamespace(chi2=100 * overdispersion, residual=np.zeros(100))
    unused: Any = SimpleNamespace()
    return EvidenceFit(
        mechanisms, cast(Any, estimate), unused, unused, evidence, ratios or {}, np.zeros((2, 1))
    )


def summarise_sets(*fits):
    return summarise(sorted(fits, key=lambda fit: -fit.evidence.total), SETTINGS)


def test_probability_is_the_share_of_the_evidence():
    summary = summarise_sets(build_fit(["force_gain"], 0.0), build_fit([], -np.log(4)))
    assert [(name.id, name.probability) for name in summary.names] == [("force_gain", pytest.approx(0.8))]


def test_mechanisms_of_equal_evidence_are_indistinguishable():
    summary = summarise_sets(
        build_fit(["force_gain"], 0.0), build_fit(["pressure_gain"], -0.1), build_fit(["end_taper"], -9.0)
    )
    (name,) = summary.names
    assert name.id == "force_gain"
    assert name.indistinguishable == ("pressure_gain",)
    assert name.probability > 0.999


def test_a_mechanism_that_is_mostly_form_error_is_unexplained():
    sets = [build_fit(["end_taper"], 0.0, ratios={"end_taper": 1.2}), build_fit([], -50.0)]
    summary = summarise_sets(*sets)
    assert summary.names == ()
    assert summary.unexplained_probability > 0.99
    small = summarise_sets(replace(sets[0], form_ratios={"end_taper": 0.2}), sets[1])
    assert [name.id for name in small.names] == ["end_taper"]
    assert small.unexplained_probability < 0.01


def test_generic_physics_with_the_larger_evidence_is_unexplained():
    summary = summarise_sets(build_fit(["end_taper"], 0.0, generic=2.0))
    assert summary.unexplained_probability == pytest.approx(1 / (1 + np.exp(-2.0)))
    assert [name.id for name in summary.names] == ["end_taper"]


def test_a_large_residual_makes_probabilities_smaller():
    alternatives = build_fit(["force_gain"], 0.0, overdispersion=10.0), build_fit([], -10.0)
    summary = summarise_sets(*alternatives)
    assert summary.names[0].probability == pytest.approx(1 / (1 + np.exp(-1.0)))


def test_physics_outside_the_library_is_reported_from_a_share_of_the_misfit():
    fit = build_fit(["end_taper"], 0.0, generic=20.0)
    assert summarise([fit], SETTINGS, baseline_excess=1.0).unexplained_probability > 0.99
    assert summarise([fit], SETTINGS, baseline_excess=20.0).unexplained_probability == 0.0

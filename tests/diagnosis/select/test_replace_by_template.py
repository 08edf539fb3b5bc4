"""Mechanisms that imitate bending of the muscle, beside a mechanism that is present."""

from functools import cache

import numpy as np
import pytest

from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.refit.model_fit import fit_model
from pamjax.diagnosis.select.replace_by_template import replace_by_template
from pamjax.diagnosis.select.rivals import NamedMechanism
from pamjax.diagnosis.select.selection import Selection
from pamjax.diagnosis.templates.template_context import build_template_context
from pamjax.diagnosis.templates.templates import build_templates
from pamjax.records.blocks import find_blocks
from tests.diagnosis.bank import BankRecording, simulate_bank

pytestmark = pytest.mark.slow

PRESENT = "braid_friction"
IMITATORS = ("mullins_softening", "diameter_offset")


@cache
def select_by_hand(unmodelled):
    """Return problem, rows, selection of friction and both imitators, and the builder of templates."""
    definition = BankRecording(1, only=PRESENT, smallest=8.0, largest=8.0, unmodelled=unmodelled)
    problem = build_library_problem(simulate_bank(definition).case)
    rows = np.ones(problem.n, dtype=bool)
    baseline = fit_model(problem, rows, (), problem.neutral)
    candidates = {candidate.id: candidate for candidate in build_candidates(problem)}
    ids = (PRESENT, *IMITATORS)
    fit = fit_model(problem, rows, [candidates[id] for id in ids], problem.neutral)
    names = tuple(NamedMechanism(id, 1.0, (), 100.0) for id in ids)
    recording = problem.case.recording
    blocks = find_blocks(recording)

    def build_templates_at(values):
        return build_templates(build_template_context(problem, recording.length, blocks, values))

    return problem, rows, Selection(baseline, fit, names), build_templates_at


def test_all_mechanisms_that_imitate_bending_are_removed():
    """One of them is replaced by bending; the other one is superfluous then."""
    selection, notes = replace_by_template(*select_by_hand("bending"))
    assert [name.id for name in selection.named_mechanisms] == [PRESENT]
    assert [mechanism.id for mechanism in selection.model.mechanisms] == [PRESENT]
    (note,) = notes
    assert note.startswith("Bending beyond 8")
    assert all(f"`{id}`" in note for id in IMITATORS)


def test_without_an_outside_effect_no_template_replaces_a_mechanism():
    problem, rows, selection, build_templates_at = select_by_hand(None)
    unchanged, notes = replace_by_template(problem, rows, selection, build_templates_at)
    assert PRESENT in {name.id for name in unchanged.named_mechanisms}
    assert notes == [] or f"`{PRESENT}`" not in notes[0]

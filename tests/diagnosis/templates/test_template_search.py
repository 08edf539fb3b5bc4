"""Search for the place of a large effect outside the library, from a baseline that it has biased."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.diagnosis.form_errors.fit import add_form_errors
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.refit.model_fit import fit_model
from pamjax.diagnosis.templates.template_context import build_template_context
from pamjax.diagnosis.templates.template_fits import (
    _select_template,
    find_best_template_fits,
    list_likenesses,
)
from pamjax.diagnosis.templates.templates import build_templates
from pamjax.records.blocks import find_blocks
from tests.diagnosis.bank import BankRecording, replace_recording, simulate_bank

pytestmark = pytest.mark.slow

#: Row of the break, between two of the 96 coarse moments, and the share of the force that is lost.
BREAK_ROW_SHARE, LOST_SHARE = 0.3127, 0.2


@pytest.fixture(scope="module")
def broken():
    """Return problem, builder of templates, baseline of a muscle whose threads break, and the moment, s."""
    case = simulate_bank(BankRecording(seed=3)).case
    time, force = case.recording.time, case.recording.force
    row = int(BREAK_ROW_SHARE * time.size)
    case = replace_recording(case, force=np.where(np.arange(time.size) >= row, 1 - LOST_SHARE, 1.0) * force)
    problem, blocks = build_library_problem(case), find_blocks(case.recording)
    baseline = fit_model(problem, np.ones(problem.n, dtype=bool), (), problem.neutral)

    def build_templates_at(values):
        return build_templates(build_template_context(problem, case.recording.length, blocks, values))

    return problem, build_templates_at, baseline, float(time[row])


def read_moment(description):
    """Return the moment in the words of a template, s; it has one decimal or more."""
    return float(description.removeprefix("broken threads after ").removesuffix(" s"))


def test_search_finds_the_row_of_a_break(broken):
    problem, build_templates_at, baseline, moment = broken
    (best_fit,) = find_best_template_fits(problem, build_templates_at, [baseline])
    assert best_fit.template.id == "thread_break"
    assert read_moment(best_fit.template.description) == pytest.approx(moment, abs=0.06)
    # Only noise remains.
    assert not best_fit.leaves_misfit(4.0)
    # Negative control: the linear model at the baseline, at coarse moments, has another place.
    coarse = _select_template(
        add_form_errors(problem, baseline), build_templates_at(baseline.estimate.values)
    )
    assert coarse is not None
    assert coarse.description != best_fit.template.description


def test_likeness_states_the_place_of_the_search(broken):
    problem, build_templates_at, baseline, moment = broken
    first, *_ = list_likenesses(problem, build_templates_at, baseline)
    assert first.id == "thread_break"
    assert first.probability > 0.99
    assert read_moment(first.description) == pytest.approx(moment, abs=0.06)


def test_without_templates_nothing_is_found(broken):
    problem, _, baseline, _ = broken
    assert find_best_template_fits(problem, lambda values: [], [replace(baseline)]) == []
    assert list_likenesses(problem, lambda values: [], baseline) == ()

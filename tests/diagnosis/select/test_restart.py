"""Restarts of a search: when they are tried, and which results are accepted."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.select import search as search_module
from pamjax.diagnosis.select.search import MechanismSearch, search_mechanisms
from pamjax.progress import ignore_progress
from tests.diagnosis.bank import build_plan_problem
from tests.diagnosis.plain_fits import build_fit

N = 1000
#: One wrong mechanism leaves 2 % of a large misfit, which is four times the noise.
BASELINE, WRONG, BETTER, RIGHT = 1e6, 20e3, 6e3, 1010.0


def build(id, chi2):
    return build_fit(n=N, chi2=chi2, mechanisms=(Candidate(id, (f"{id}.gain",)),) if id else ())


@pytest.fixture
def run(monkeypatch):
    """Return the id that a search selects, whose first result and restart have some χ²."""

    def _run(first, restarted, is_stated=True):
        baseline = build("", BASELINE)
        results = [build("force_gain", first), build("pressure_gain", restarted)]
        if not is_stated:
            results = [_forget_noise(fit) for fit in results]
        starts = []

        def run_search(search, start, directions=None):
            starts.append(start)
            return results[len(starts) - 1]

        monkeypatch.setattr(search_module, "run_search", run_search)
        monkeypatch.setattr(search_module, "_find_restart_pairs", lambda *_: [build("pressure_gain", 1e5)])
        monkeypatch.setattr(search_module, "add_form_errors", lambda problem, fit: fit)
        monkeypatch.setattr(MechanismSearch, "refit", lambda self, fit: fit)
        search = MechanismSearch(build_plan_problem(), np.ones(1, bool), baseline, (), ignore_progress)
        return search_mechanisms(search, []).ids, len(starts)

    return _run


def _forget_noise(fit):
    channels = tuple(channel and replace(channel, is_stated=False) for channel in fit.noise.by_channel)
    return replace(fit, noise=replace(fit.noise, by_channel=channels))


def test_a_small_part_of_a_large_misfit_is_searched_again(run):
    assert run(WRONG, RIGHT) == (("pressure_gain",), 2)


def test_only_noise_is_not_searched_again(run):
    assert run(RIGHT, RIGHT) == (("force_gain",), 1)


def test_without_stated_noise_only_a_large_residual_is_searched_again(run):
    assert run(WRONG, RIGHT, is_stated=False) == (("force_gain",), 1)
    assert run(1e5, RIGHT, is_stated=False) == (("pressure_gain",), 2)


def test_a_restart_must_explain_most_of_the_rest(run):
    # 5,000 of 19,000 remain: more than a sixth.
    assert run(WRONG, BETTER) == (("force_gain",), 2)
    assert run(WRONG, 4e3) == (("pressure_gain",), 2)

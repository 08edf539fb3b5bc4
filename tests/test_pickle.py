"""Every public result can be pickled, so that processes exchange it and a notebook keeps it."""

import pickle

import numpy as np
import pytest

import pamjax
from pamjax.cli.main import main
from tests.infer.made import made
from tests.view.made_up import diagnosis

SPEC = {
    "supply": {"pressure": "6 bar"},
    "force": [{"at_least": "300 N", "contraction": 0.1}],
    "envelope": {"length": "250 mm"},
    "threads": {"kinds": "aramid", "counts": 48, "diameters": "0.3 mm"},
    "bladders": {"kinds": "latex"},
}


def copy(result):
    """Return a result after a round trip."""
    return pickle.loads(pickle.dumps(result))


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    """Return the folder of the template case."""
    folder = tmp_path_factory.mktemp("pickle") / "mine"
    assert main(["new", str(folder)]) == 0
    return folder


def test_case_pickles(mine):
    case = pamjax.read_case(mine)
    assert str(copy(case)) == str(case)
    assert np.array_equal(copy(case.recording).force, case.recording.force, equal_nan=True)
    assert copy(case.muscle_toml) == case.muscle_toml


def test_explanation_and_settings_pickle():
    assert copy(pamjax.explain("braid_friction")) == pamjax.explain("braid_friction")
    assert copy(pamjax.DiagnosisSettings()) == pamjax.DiagnosisSettings()
    assert str(copy(pamjax.BadInput("`x` must be positive."))) == "`x` must be positive."


def test_figure_pickles():
    figure = diagnosis().plot("shifts")
    assert copy(figure).get_suptitle() == figure.get_suptitle()


@pytest.mark.slow
def test_muscle_and_inverse_pickle(mine):
    loaded = pamjax.load_muscle(mine)
    reading = pamjax.predict(loaded, [2e5, 4e5], 0.19)
    assert np.array_equal(copy(reading).force, reading.force)
    assert np.array_equal(pamjax.predict(copy(loaded), [2e5, 4e5], 0.19).force, reading.force)
    inverse = pamjax.inverse(loaded)
    command = inverse.pressure([300.0], [0.18])
    assert np.array_equal(copy(inverse).pressure([300.0], [0.18]).value, command.value)
    assert np.array_equal(copy(command).value, command.value)


@pytest.mark.slow
def test_posterior_pickles():
    fit = pamjax.fit(made("elastic"), starts=1, fold_count=2)
    posterior = pamjax.sample(fit, ess=30, rhat=1.5, max_draws=200)
    assert str(copy(posterior)) == str(posterior)
    assert np.array_equal(copy(posterior).draws, posterior.draws)
    for name in posterior.list_figures():
        assert posterior.plot(name).axes, name


@pytest.mark.slow
def test_plan_pickles(mine):
    plan = pamjax.plan(mine, goal="thread.modulus", to="10 %")
    assert str(copy(plan)) == str(plan)
    assert copy(plan).schedule().equals(plan.schedule())


@pytest.mark.slow
def test_design_pickles():
    design = pamjax.size(SPEC, inelastic_and_front=False, stock=False, starts=1)
    assert str(copy(design)) == str(design)
    assert [name for name in design.list_figures() if design.plot(name).axes] == ["chart", "sensitivities"]


def test_fleet_pickles(tmp_path):
    pytest.importorskip("pyarrow", reason="needs the extra pamjax[fleet]")
    from tests.fleet.made_store import write_made_store

    fleet = pamjax.open_fleet(write_made_store(tmp_path, [90.0, 92.0, 94.0]))
    assert copy(fleet).cases.equals(fleet.cases)

"""Results draw themselves, pickle, and complete their names; importing the package is light."""

import pickle
import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure

import pamjax
from pamjax.drawing import DrawableResult
from pamjax.errors import BadInput
from pamjax.records.writing.template import write_template
from tests.infer.made import made
from tests.view import made_up


@pytest.fixture(scope="module")
def fit():
    return pamjax.fit(made("elastic"), starts=1, fold_count=2)


@pytest.fixture
def muscle_file(tmp_path):
    """Return the muscle.toml of the template, whose modulus has a stated sd of 15 GPa."""
    return write_template(tmp_path / "mine")[1]


def test_every_figure_of_a_diagnosis_is_drawn():
    diagnosis = made_up.diagnosis()
    names = diagnosis.list_figures()
    assert names[0] == "map"
    assert {"steps", "loops", "residuals", "held-out", "shifts", "candidates-braid_friction"} <= set(names)
    for name in names:
        figure = diagnosis.plot(name)
        assert isinstance(figure, Figure)
        assert figure.axes
    assert diagnosis.plot().get_suptitle() == diagnosis.plot("map").get_suptitle()


def test_figures_without_content_are_not_listed():
    assert "shifts" not in made_up.diagnosis(detected=False).list_figures()


def test_unknown_figure_is_refused_with_its_neighbour():
    with pytest.raises(BadInput, match=r"unknown figure of a Diagnosis; got 'lops'\. Did you mean `loops`\?"):
        made_up.diagnosis().plot("lops")


def test_parameter_without_a_figure_is_refused():
    for explanation in (pamjax.explain("thread.modulus"), pamjax.explain()):
        with pytest.raises(BadInput, match=r"only the explanation of a mechanism has a figure; got .*Draw"):
            explanation.plot()


@pytest.mark.slow
@pytest.mark.parametrize("narrow", [False, True])
def test_effect_of_a_mechanism_is_drawn(narrow):
    explanation = pamjax.explain("force_offset")
    assert explanation.list_figures() == ["effect"]
    figure = explanation.plot(narrow=narrow)
    figure.draw_without_rendering()
    assert figure.get_suptitle().startswith("force_offset: ")
    for panel in figure.axes:
        assert panel._left_title.get_window_extent().x1 <= figure.bbox.x1


@pytest.mark.slow
def test_figures_of_a_plan_are_drawn(muscle_file):
    plan = pamjax.plan(muscle_file, to="10 GPa")
    assert plan.list_figures() == ["precision", "commands"]
    assert "thread.modulus" in plan.plot().axes[0].get_title("left")
    commanded = plan.plot("commands").axes[0].lines[0].get_ydata()
    assert np.nanmax(commanded) == plan.schedule()["pressure [kPa]"].max()


def test_plan_without_runs_has_no_commands(muscle_file):
    plan = pamjax.plan(muscle_file, to="30 GPa")
    assert plan.list_figures() == ["precision"]
    with pytest.raises(BadInput, match=r"unknown figure of a Plan; got 'commands'"):
        plan.plot("commands")


def test_object_without_figures_is_refused():
    with pytest.raises(BadInput, match=r"got int\. Pass the result of `fit`"):
        pamjax.plot(3)


def test_notebook_shows_a_figure_as_png():
    image = made_up.diagnosis().plot("shifts", narrow=True)._repr_png_()
    assert image.startswith(b"\x89PNG")


@pytest.mark.slow
def test_every_figure_of_a_fit_is_drawn(fit):
    assert fit.list_figures() == ["prediction", "residual", "held-out", "prior"]
    for name in fit.list_figures():
        assert fit.plot(name).axes


@pytest.mark.slow
def test_fit_pickles(fit):
    copy = pickle.loads(pickle.dumps(fit))
    assert str(copy) == str(fit)
    assert copy.estimates["thread.modulus"] == fit.estimates["thread.modulus"]
    assert str(pamjax.predict(copy, [2e5], 0.19).force) == str(pamjax.predict(fit, [2e5], 0.19).force)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
def test_tab_key_offers_the_names_of_estimates(fit):
    completer = pytest.importorskip("IPython.core.completer").IPCompleter(namespace={"fit": fit})
    line = 'fit.estimates["thr'
    _, offered = completer.complete(line_buffer=line, cursor_pos=len(line))
    assert any("thread.modulus" in text for text in offered)


def test_drawable_results_are_the_public_ones():
    drawable = {name for name in pamjax.__all__ if _is_drawable(getattr(pamjax, name))}
    assert drawable == {"Fit", "Posterior", "Diagnosis", "Design", "Plan"}


def _is_drawable(value):
    return isinstance(value, type) and issubclass(value, DrawableResult)


def test_import_is_light():
    program = "import sys, pamjax; print({'jax', 'numpy', 'pandas', 'matplotlib'} & set(sys.modules))"
    process = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert process.stdout.strip() == "set()"

"""Figures of a fit: points, lines, units, noise band and titles for every kind of recording."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import jax.numpy as jnp
import matplotlib
import matplotlib.image
import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.infer.fitting.result import CaseFit, Estimate, HeldOutScore
from pamjax.infer.noise.sensor_noise import ChannelNoise
from pamjax.model.muscle import Muscle, predict
from pamjax.parameter import Meaning
from pamjax.records.blocks import find_blocks
from pamjax.records.case import Case
from pamjax.records.reading.muscle_toml import parse_muscle_toml
from pamjax.records.recording import Recording
from pamjax.view.figures.fit import (
    _format_generalisation,
    plot_held_out,
    plot_prediction,
    plot_residual,
    save_fit_figures,
)
from pamjax.view.figures.fit_priors import plot_prior
from pamjax.view.figures.layout import GRID_CELLS, build_layout, thin_points

MUSCLE = Muscle(0.200, 0.2142, 1.203)
SD = {"force": 2.0, "diameter": 5e-5}


def made_up_fit(pressure, length, time=None, channels=("force", "diameter"), miss=0.0, given=True):
    """Return the fit of the true muscle to a recording with an offset of `miss` times the noise."""
    draw = np.random.default_rng(5).normal(size=len(pressure))
    draw = (draw - draw.mean()) / draw.std()
    reading = predict(MUSCLE, jnp.asarray(pressure), jnp.asarray(length))
    prediction = {c: np.asarray(getattr(reading, c)) for c in SD}
    n = len(pressure)
    measured = {c: prediction[c] + SD[c] * (miss + draw) for c in channels}
    muscle_toml = parse_muscle_toml(
        {"muscle": {"rest_length": "200 mm", "thread_length": "214 mm", "turns": 1.2}}
    )
    recording = Recording.from_arrays(pressure=pressure, length=length, time=time, **measured)
    blocks = find_blocks(recording)
    rmse = {c: float(np.sqrt(np.mean((measured[c] - prediction[c]) ** 2))) for c in channels}
    return CaseFit(
        case=Case("bench", Path(), muscle_toml, recording, ""),
        numbers={},
        muscle=MUSCLE,
        prediction=prediction,
        held_out_prediction={c: 1.01 * prediction[c] for c in prediction},
        block=[blocks.names[k] if k >= 0 else "" for k in blocks.label],
        rmse=rmse,
        noise={
            c: ChannelNoise(SD[c], given, rmse[c] / SD[c] if given else 1.0, 1.0, 0.0, n) for c in channels
        },
        held_out_score=HeldOutScore(blocks.kind, (), {c: 1.5 * rmse[c] for c in channels}),
        failed_rows={},
    )


def strokes(**more):
    """Return four isobars with three strokes each."""
    phase = np.linspace(0, 6 * np.pi, 400)
    length = np.tile(0.19 + 0.01 * np.cos(phase), 4)
    pressure = np.repeat([1e5, 2e5, 3e5, 4e5], 400)
    return made_up_fit(pressure, length, np.arange(1600.0), **more)


def lengths(**more):
    """Return pressure ramps at three lengths."""
    ramp = np.concatenate([np.linspace(2e4, 4e5, 200), np.linspace(4e5, 2e4, 200)])
    return made_up_fit(
        np.tile(ramp, 3), np.repeat([0.18, 0.19, 0.2], 400), np.arange(1200.0), ("force",), **more
    )


def holds(**more):
    """Return holds of pressure and length."""
    pressure = np.repeat([1e5, 3e5, 3e5, 2e5, 2e5, 1e5], 100)
    length = np.repeat([0.2, 0.2, 0.18, 0.18, 0.19, 0.19], 100)
    return made_up_fit(pressure, length, np.arange(600.0), **more)


def table(**more):
    """Return five measurements of the diameter at one length."""
    return made_up_fit(np.linspace(1e5, 7e5, 5), np.full(5, 0.2), None, ("diameter",), **more)


def free_contraction():
    """Return a fit of lengths without a load; near zero pressure the predicted length has no meaning."""
    pressure = np.r_[300.0, np.linspace(5e4, 6e5, 59)]
    length = np.r_[0.2, np.linspace(0.19, 0.15, 59)]
    predicted = np.r_[4.0, length[1:] + 1e-4 * np.tile([1.0, -1.0], 30)[1:]]
    like = made_up_fit(pressure, length, np.arange(60.0))
    recording = Recording.from_arrays(
        time=np.arange(60.0), pressure=pressure, length=length, force=np.zeros(60), measures_length=True
    )
    return replace(
        like,
        case=replace(like.case, recording=recording),
        prediction={"length": predicted},
        held_out_prediction={"length": predicted + 1e-4},
        rmse={"length": 1e-4},
        noise={"length": ChannelNoise(1e-4, True, 1.0, 1.0, 0.0, 59)},
        held_out_score=HeldOutScore("parts", (), {"length": 2e-4}),
    )


def select_lines(figure, kind):
    """Return the lines of a kind for each panel."""
    return [
        [line for line in panel.lines if str(line.get_gid()).split()[0] == kind] for panel in panels(figure)
    ]


def panels(figure):
    return [axes for axes in figure.axes if axes.get_label() != "<colorbar>"]


def list_legend_texts(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


@pytest.mark.parametrize(
    ("case_fit", "xlabel", "groups", "channels"),
    [
        (strokes(), "contraction [%]", 4, ["force [N]", "diameter [mm]"]),
        (lengths(), "pressure [kPa]", 3, ["force [N]"]),
        (holds(), "time [s]", 1, ["force [N]", "diameter [mm]"]),
        (table(), "pressure [kPa]", 1, ["diameter [mm]"]),
    ],
    ids=["strokes", "lengths", "holds", "table"],
)
def test_each_setting_has_points_and_a_line(case_fit, xlabel, groups, channels):
    figure = plot_prediction(case_fit)
    assert [panel.get_ylabel() for panel in panels(figure)] == channels
    assert {panel.get_xlabel() for panel in panels(figure)} == {xlabel}
    assert [len(lines) for lines in select_lines(figure, "measured")] == [groups] * len(channels)
    assert len({line.get_color() for line in select_lines(figure, "model")[0]}) == groups
    assert list_legend_texts(figure)[:2] == ["measured", "fitted model"]
    assert all(line.get_linestyle() == "None" for line in select_lines(figure, "measured")[0])


def test_settings_have_units():
    assert list_legend_texts(plot_prediction(lengths()))[2:] == ["200 mm", "190 mm", "180 mm"]
    (bar,) = (axes for axes in plot_prediction(strokes()).axes if axes.get_label() == "<colorbar>")
    assert bar.get_ylabel() == "pressure [kPa]"
    assert [tick.get_text() for tick in bar.get_yticklabels()] == ["100", "200", "300", "400"]


def test_the_line_is_the_prediction():
    case_fit = lengths()
    line = select_lines(plot_prediction(case_fit), "model")[0][-1]
    x, y = line.get_data()
    at_rest = predict(MUSCLE, jnp.asarray(x) * 1e3, jnp.full(len(x), 0.2)).force
    np.testing.assert_allclose(y, at_rest, rtol=1e-9)


@pytest.mark.parametrize(
    ("case_fit", "title"),
    [
        (lengths(miss=30.0), "RMS error of force: 60 N\n(30 times the noise)"),
        (lengths(), "RMS error of force: 2 N\n(noise 2 N)"),
        (lengths(given=False), "RMS error of force: 2 N\n(0.12 % of the largest value)"),
    ],
    ids=["misfit", "good fit", "unknown noise"],
)
def test_title_states_the_result(case_fit, title):
    assert panels(plot_prediction(case_fit))[0].get_title("left") == title


def test_many_points_are_thinned_but_keep_their_outline():
    x, y = np.random.default_rng(0).normal(size=(2, 20_000))
    x[7] = np.nan
    kept = thin_points(x, y)
    assert 7 not in kept
    assert len(kept) < 0.5 * len(x)
    assert len(kept) <= GRID_CELLS[0] * GRID_CELLS[1]
    assert np.ptp(y[kept]) > 0.95 * np.ptp(y)
    assert thin_points(np.zeros(3), np.zeros(3)).tolist() == [0]


def test_band_is_not_hidden_and_its_width_is_stated():
    fit = strokes()
    sd = {"force": np.linspace(0.0, 1.5, 1600), "diameter": np.full(1600, 1e-8)}
    with_band = plot_prediction(replace(fit, prediction_sd=sd))
    assert "± 2 sd of the model, at most 3 N and 2e-5 mm" in list_legend_texts(with_band)
    for figure, is_outlined, width in ((with_band, False, 0.7), (plot_prediction(fit), True, 1.2)):
        assert all(bool(lines) == is_outlined for lines in select_lines(figure, "casing"))
        assert all(bool(panel.collections) != is_outlined for panel in panels(figure))
        drawn_lines = [line for lines in select_lines(figure, "model") for line in lines]
        assert {line.get_linewidth() for line in drawn_lines} == {width}


@pytest.mark.parametrize("narrow", [False, True])
def test_legend_with_the_width_of_the_band_is_inside_the_figure(narrow):
    fit = strokes()
    sd = {"force": np.full(1600, 5.5), "diameter": np.full(1600, 6.2e-5)}
    figure = plot_prediction(replace(fit, prediction_sd=sd), narrow)
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.x1


def test_residuals_are_drawn_with_the_noise_band():
    figure = plot_residual(strokes(miss=30.0))
    assert [panel.get_xlabel() for panel in panels(figure)[3:]] == [
        "contraction [%]",
        "pressure [kPa]",
        "time [s]",
    ]
    assert panels(figure)[0].get_ylabel() == "force: measured − model [N]"
    (band,) = (patch for patch in panels(figure)[0].patches if patch.get_gid() == "noise")
    assert [band.get_y(), band.get_height()] == [-4.0, 8.0]
    assert "± 2 sd of noise" in list_legend_texts(figure)
    assert figure.get_suptitle().splitlines()[0].startswith("Force: 100 % of rows are outside")
    points = np.concatenate([line.get_ydata() for line in select_lines(figure, "residual")[0]])
    assert np.median(points) == pytest.approx(60.0, abs=1.0)


def test_five_percent_of_the_residuals_are_outside_the_band():
    title = plot_residual(lengths()).get_suptitle()
    assert title in {
        f"Force: {k} % of rows are outside ± 2 sd of the noise (expected: 5 %)" for k in (4, 5, 6)
    }


def test_without_stated_noise_the_largest_residual_is_reported():
    figure = plot_residual(table(given=False))
    assert figure.get_suptitle().startswith("Diameter: largest residual ")
    assert figure.get_suptitle().endswith(" mm")
    assert "± 2 sd of noise (of the residual if no noise is stated)" in list_legend_texts(figure)


def test_each_block_has_a_training_and_a_held_out_score():
    case_fit = lengths()
    figure = plot_held_out(case_fit)
    (panel,) = panels(figure)
    assert [tick.get_text() for tick in panel.get_yticklabels()] == [
        "length 180 mm",
        "length 190 mm",
        "length 200 mm",
    ]
    fitted_rmse, held_out_rmse = (
        select_lines(figure, kind)[0][0].get_xdata() for kind in ("fitted", "held-out")
    )
    at_rest = np.isclose(case_fit.case.recording.length, 0.2)
    misfit = (case_fit.case.recording.force - case_fit.prediction["force"])[at_rest]
    assert fitted_rmse[2] == pytest.approx(np.sqrt(np.mean(misfit**2)))
    assert (held_out_rmse > fitted_rmse).all()
    # No marker is cut at an edge.
    assert panel.get_xlim() == (0, pytest.approx(1.08 * max(held_out_rmse)))
    assert panel.get_xlabel() == "RMS error of force [N]"
    title = panel.get_title("left").splitlines()
    assert title == ["Held-out lengths: RMS error of force 3 N,", "50 % more than in the fit (2 N)"]


@pytest.mark.parametrize(
    ("held_out", "text"),
    [(6.0, "200 % more than in the fit (2 N)"), (46.0, "23 times that of the fit (2 N)")],
)
def test_large_held_out_error_is_a_ratio(held_out, text):
    case_fit = lengths()
    score = replace(case_fit.held_out_score, rmse={"force": held_out})
    case_fit = replace(case_fit, rmse={"force": 2.0}, held_out_score=score)
    assert _format_generalisation(case_fit, "force").splitlines()[1] == text


def test_fit_without_held_out_blocks_is_refused():
    case_fit = table()
    object.__setattr__(case_fit, "held_out_score", None)
    with pytest.raises(BadInput, match="needs held-out blocks; got one block in bench"):
        plot_held_out(case_fit)


def estimates():
    stiff = Meaning("N", "kN", 1.0, 1e6, "log", "stiffness", "test")
    length = Meaning("m", "mm", 0.1, 0.3, "linear", "thread", "test")
    return {
        "muscle.thread_length": Estimate(0.2142, 1e-4, 0.214, 5e-4, length, False),
        "muscle.rest_length": Estimate(0.1999, None, 0.2, 1e-3, length, True),
        "thread.stiffness": Estimate(8e4, 2e3, 1e5, np.inf, stiff, False),
    }


def test_estimates_are_drawn_on_the_scale_of_their_priors():
    figure = plot_prior(SimpleNamespace(estimates=estimates()))
    (panel,) = panels(figure)
    # A parameter without a prior is not drawn.
    assert [tick.get_text() for tick in panel.get_yticklabels()] == list(estimates())[:2]
    (bar,) = panel.containers
    assert bar.lines[0].get_xdata()[0] == pytest.approx(0.4)
    assert len(select_lines(figure, "undetermined")[0]) == 1
    texts = [text.get_text() for text in panel.texts]
    assert texts == ["214.20 ± 0.10 mm", "199.9 mm"]
    assert figure.get_suptitle().startswith("The recording at least halves the sd of 1 of 2 parameters with")
    assert figure.get_suptitle().endswith("largest shift: muscle.thread_length, +0.4 sd of its prior")
    assert list_legend_texts(figure) == [
        "prior ± 1 sd",
        "estimate ± 1 sd",
        "at a limit, or without sd",
    ]


def test_estimate_equal_to_its_prior_has_no_shift():
    still = {name: replace(e, value=e.prior - 0.04 * e.prior_sd) for name, e in list(estimates().items())[:2]}
    title = plot_prior(SimpleNamespace(estimates=still)).get_suptitle()
    assert title.endswith(" of 2 parameters;\nno estimate differs from its prior")
    assert "0.0" not in title


@pytest.mark.parametrize("narrow", [False, True])
def test_title_fits_its_figure(narrow):
    figure = plot_prior(SimpleNamespace(estimates=estimates()), narrow)
    figure.draw_without_rendering()
    assert figure._suptitle.get_window_extent().x1 <= figure.bbox.x1


def test_fit_without_priors_has_no_figure_of_priors(tmp_path):
    (tmp_path / "prior.png").write_text("of an earlier fit")
    free = {name: replace(e, prior_sd=np.inf) for name, e in estimates().items()}
    assert plot_prior(SimpleNamespace(estimates=free)) is None
    save_fit_figures(SimpleNamespace(estimates=free, cases=()), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_rows_between_settings_are_not_drawn():
    case_fit = strokes()
    moving = case_fit.case.recording.pressure
    moving[10:20] = np.linspace(2.2e5, 2.8e5, 10)
    assert (build_layout(case_fit.case).group[10:20] == -1).sum() >= 5


def test_saving_figures_changes_no_settings(tmp_path):
    before = matplotlib.rcParams["font.size"]
    written = save_fit_figures(SimpleNamespace(estimates=estimates(), cases=(table(),)), tmp_path)
    names = ["prior.png", "prediction.png", "residual.png", "held-out.png"]
    assert [path.name for path in written] == names
    assert all(path.is_file() for path in written)
    assert matplotlib.image.imread(written[1]).shape[1] == 960
    assert matplotlib.rcParams["font.size"] == before


def test_length_without_pressure_is_not_compared():
    case_fit = free_contraction()
    ((model,),) = select_lines(plot_prediction(case_fit), "model")
    assert np.nanmax(model.get_ydata()) < 201.0
    ((measured,),) = select_lines(plot_prediction(case_fit), "measured")
    assert measured.get_xdata().size == 60
    figure = plot_residual(case_fit)
    for lines in select_lines(figure, "residual"):
        np.testing.assert_allclose(np.abs(lines[0].get_ydata()), 0.1, rtol=1e-6)
        assert lines[0].get_ydata().size == 59
    for panel in panels(plot_held_out(case_fit)):
        assert panel.get_xlim()[1] < 0.5

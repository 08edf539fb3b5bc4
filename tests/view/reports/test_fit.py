"""The summary of a fit's report: every channel with its noise, parameter names unchanged."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pamjax.infer.fitting.result import Estimate
from pamjax.model.parameters import find_meaning
from pamjax.records.reading.muscle_toml import Sensors
from pamjax.view.reports.fit import (
    _build_score_row,
    _describe_starts,
    _format_prediction_caption,
    _list_assumptions,
    _list_next_steps,
    format_agreement,
)
from pamjax.view.wording import capitalise_sentence
from tests.view.figures.test_fit import free_contraction, lengths, made_up_fit, strokes


def fit(*cases):
    return SimpleNamespace(
        cases=cases,
        estimates={},
        law="elastic",
        mechanisms=(),
        converged=True,
        steps=9,
        starts=4,
        agreeing_starts=4,
        loss="linear",
    )


def test_summary_has_every_channel_with_its_noise():
    assert format_agreement(fit(strokes())) == (
        "The RMS error of the fit is 2 N for force (noise 2 N) and 0.05 mm for diameter (noise 0.05 mm)."
        " The RMS error of held-out isobars is 3 N for force and 0.075 mm for diameter."
    )
    assert format_agreement(fit(lengths(), lengths())).startswith(
        "bench, the worst of 2 fits, has an RMS error of 2 N for force (noise 2 N)."
    )
    assert "(estimated noise 2 N)" in format_agreement(fit(lengths(given=False)))


def test_noise_is_compared_with_the_stated_noise():
    case_fit = strokes()
    muscle_toml = replace(case_fit.case.muscle_toml, sensors=Sensors(force=1.2, diameter=5e-5))
    case_fit = replace(case_fit, case=replace(case_fit.case, muscle_toml=muscle_toml))
    assert [_build_score_row(case_fit, channel)[3] for channel in ("force", "diameter")] == [
        "2 N, 1.2 N stated",
        "0.05 mm, stated",
    ]
    sentences = list(_list_assumptions(fit(case_fit)))
    assert any(
        line.startswith("Noise of force is 2 N per row. Stated in muscle.toml: 1.2 N") for line in sentences
    )
    assert "Noise of diameter is 0.05 mm per row, as stated in muscle.toml." in sentences


@pytest.mark.parametrize(
    ("sd", "words"), [(4.9e9, "does not determine"), (3.0e9, "by less than half"), (1.0e9, None)]
)
def test_next_step_says_how_well_a_parameter_is_determined(sd, words):
    meaning = find_meaning("thread.modulus")
    estimate = Estimate(value=80e9, sd=sd, prior=80e9, prior_sd=5e9, meaning=meaning, at_limit=False)
    sentences = " ".join(_list_next_steps(fit(strokes()), {"thread.modulus": estimate}))
    assert ("--goal thread.modulus` selects further runs" in sentences) == (words is not None)
    assert words is None or words in sentences


def test_every_fit_has_a_next_step():
    (step,) = _list_next_steps(fit(free_contraction()), {})
    assert step == "`pamjax diagnose .` tests whether other mechanisms explain the recording as well."
    noisy = free_contraction()
    noise = replace(noisy.noise["length"], rms_over_noise=5.0, autocorrelation_time=20.0)
    (step,) = _list_next_steps(fit(replace(noisy, noise={"length": noise})), {})
    assert step.startswith("The misfit exceeds the noise. `pamjax diagnose .` identifies")
    assert any("`pamjax sample .`" in step for step in _list_next_steps(fit(strokes()), {}))


def test_names_are_not_capitalised():
    assert capitalise_sentence("muscle.turns and thread.modulus are correlated").startswith("muscle.turns")
    assert capitalise_sentence("no correlation is above 0.8").startswith("No corr")


def test_caption_has_the_marks_of_the_figure():
    assert _format_prediction_caption(strokes()) == (
        "Points: measured values. Lines: fitted model. A line has two branches where the model depends on"
        " the direction of motion, for example by friction."
    )
    scattered = made_up_fit(np.linspace(1e5, 4e5, 9), 0.2 - 0.02 * np.linspace(0, 1, 9) ** 2)
    assert _format_prediction_caption(scattered) == "Points: measured values. Crosses: fitted model."


@pytest.mark.parametrize(("starts", "agreeing", "is_warned"), [(4, 1, True), (4, 2, False), (1, 1, False)])
def test_a_result_of_a_single_start_is_on_the_first_screen(starts, agreeing, is_warned):
    result = fit(lengths())
    result.starts, result.agreeing_starts = starts, agreeing
    warning = f"Only one of {starts} starts found this result: repeat the fit with `--starts {3 * starts}`."
    assert _describe_starts(result) == ((warning,) if is_warned else ())

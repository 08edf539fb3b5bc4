"""Made-up diagnoses with the parts that figures and reports need."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from pamjax.diagnosis.crossval.held_out_errors import (
    build_held_out_mask,
    compute_held_out_errors,
    compute_rmse,
)
from pamjax.diagnosis.detect.locate import MisfitRegion
from pamjax.diagnosis.detect.recording_axes import build_axes
from pamjax.diagnosis.detect.significance import ResidualTest
from pamjax.diagnosis.estimates import ParameterEstimate, ParameterShift
from pamjax.diagnosis.form_errors.prediction import ModelPrediction
from pamjax.diagnosis.next_experiment.experiment import Experiment
from pamjax.diagnosis.result import Diagnosis
from pamjax.diagnosis.select.rivals import NamedMechanism
from pamjax.diagnosis.select.selection import Selection
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.diagnosis.templates.template_fits import Likeness
from pamjax.diagnosis.unexplained import UnexplainedReason
from pamjax.infer.form_errors.parts import FormErrorPart
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.model.parameters import find_meaning
from pamjax.records.blocks import find_blocks
from pamjax.records.case import Case
from pamjax.records.reading.muscle_toml import parse_muscle_toml
from pamjax.records.recording import Recording

SD = np.array([2.0, 5e-5])
NAMES = ("thread.modulus", "muscle.turns", "braid_friction.coefficient")


def strokes():
    """Return four isobars with one stroke each."""
    phase = np.linspace(0, 2 * np.pi, 200)
    length = np.tile(0.19 + 0.01 * np.cos(phase), 4)
    return np.repeat([1e5, 2e5, 3e5, 4e5], 200), length, np.arange(800.0)


def lengths():
    """Return pressure ramps at three lengths."""
    ramp = np.concatenate([np.linspace(2e4, 4e5, 100), np.linspace(4e5, 2e4, 100)])
    return np.tile(ramp, 3), np.repeat([0.18, 0.19, 0.2], 200), np.arange(600.0)


def holds():
    """Return holds of pressure and length."""
    pressure = np.repeat([1e5, 3e5, 3e5, 2e5, 2e5, 1e5], 50)
    return pressure, np.repeat([0.2, 0.2, 0.18, 0.18, 0.19, 0.19], 50), np.arange(300.0)


def table():
    """Return five rows at one length."""
    return np.linspace(1e5, 7e5, 5), np.full(5, 0.2), None


def diagnosis(
    protocol=strokes, named=True, detected=True, unexplained=False, ties=(), experiments=(), diameter=True
):
    """Return a diagnosis of friction: force is 20 N higher while lengthening, 20 N lower while shortening."""
    pressure, length, time = protocol()
    n = len(pressure)
    noise = np.random.default_rng(4).normal(size=(2, n)) * SD[:, None]
    before = np.stack([pressure * 1e-3, np.full(n, 0.02)])
    rate = np.gradient(length) if time is not None else np.zeros(n)
    effect = np.zeros((2, n))
    # Friction has no effect at fixed length. Without strokes the force is 10 % higher instead.
    effect[0] = 20 * np.sign(rate) if np.abs(rate).max() and protocol is strokes else 0.1 * before[0]
    after = before + effect * (named or not detected)
    measured = before + effect * detected + noise
    if not diameter:
        measured[1] = np.nan
    muscle_toml = parse_muscle_toml(
        {
            "muscle": {"rest_length": "200 mm", "thread_length": "214 mm", "turns": 1.2},
            "sensors": {"force": "2 N", "diameter": "0.05 mm"},
        }
    )
    recording = Recording.from_arrays(
        pressure=pressure, length=length, time=time, force=measured[0], diameter=measured[1]
    )
    models = [_model(v, measured) for v in ([80e9, 1.2, 0.0], [92e9, 1.2, 0.21])]
    predictions = {id(models[0].estimate.values): before, id(models[1].estimate.values): after}
    problem = SimpleNamespace(
        settings=DEFAULT_SETTINGS,
        case=Case("bench", Path("lab") / "my bench", muscle_toml, recording, "c0ffee"),
        law="elastic",
        names=NAMES,
        meanings=tuple(find_meaning(name) for name in NAMES),
        start=np.array([85e9, 1.2, 0.3]),
        low=np.array([17e9, 1.1, 0.0]),
        high=np.array([400e9, 1.3, 3.0]),
        prior_sd=np.array([np.inf, 0.01, np.inf]),
        is_baseline=np.array([True, True, False]),
        is_logarithmic=np.zeros(3, dtype=bool),
        n=n,
        channels=recording.model_channels,
        measured=measured,
        dataset=SimpleNamespace(
            history=SimpleNamespace(
                rate=lambda values: np.gradient(values) if time is not None else 0 * values,
                rate_weights=np.zeros((n, 5)),
            ),
            rows=SimpleNamespace(length=length, pressure=pressure),
        ),
        predict=lambda values: predictions[id(values)],
        index=NAMES.index,
    )
    blocks = find_blocks(recording)
    names = [
        NamedMechanism(
            "braid_friction",
            0.98,
            tuple(ties),
            5e4,
            {"viscous_damping": 640.0, "channel_lag": -3.0},
            form_error=0.12,
        )
    ]
    region = _region(build_axes(problem))
    values = problem.predict(models[1].estimate.values)
    prediction = ModelPrediction(values, np.zeros_like(values), has_form_errors=False)
    return Diagnosis(
        problem=problem,
        selection=Selection(models[0], models[1], tuple(names) if named and detected else ()),
        model=models[1] if named and detected else models[0],
        baseline=models[0],
        baseline_test=ResidualTest(1e-40 if detected else 0.43, 30.0, 258, 90.0),
        misfit_regions=[region],
        residual_test=ResidualTest(1e-6 if unexplained else 0.2, 3.0, 258, 1.1),
        unexplained=unexplained,
        likenesses=(Likeness("stop", 0.7, "a stop beyond 12.0 % contraction"),) if unexplained else (),
        residual_regions=[region],
        residual_share=0.12,
        noise_ratios={"force": 1.02, "diameter": None},
        blocks=blocks,
        held_out_errors=compute_held_out_errors(
            problem, blocks, build_held_out_mask(blocks), models[0], models[1], prediction
        ),
        parameters={"braid_friction": {"coefficient": ParameterEstimate(0.21, 0.01, find_meaning(NAMES[2]))}},
        parameter_shifts={
            NAMES[0]: ParameterShift(80e9, 92e9, 8.9, find_meaning(NAMES[0])),
            NAMES[1]: ParameterShift(1.2, 1.2, -0.2, find_meaning(NAMES[1])),
        }
        if named and detected
        else {},
        notes=["turns and thread length are determined only in combination"],
        experiments=list(experiments),
        unexplained_reason=UnexplainedReason.RESIDUAL if unexplained else None,
    )


def add_form_error(result, share=0.1):
    """Return a diagnosis of friction whose form error is 2 N rms, where its effect is 20 N.

    The prediction with form error is 2 N higher than the one without, with an sd of 5 N.
    """
    form = np.zeros_like(result.held_out_errors.model_prediction)
    form[0] = 2.0
    sd = np.zeros_like(form)
    sd[0] = 5.0
    rms = np.array([2.0, 0.0]) if share else np.zeros(2)
    part = FormErrorPart(share, 0.1 if share else 0.0, form, rms, np.array([20.0, 1e-9]))
    prediction = ModelPrediction(result.held_out_errors.model_prediction + form, sd, True) if share else None
    errors = result.held_out_errors
    if prediction is not None:
        rmse = compute_rmse(result.problem, prediction.values, errors.held_out_mask)
        errors = replace(errors, model_prediction=prediction.values, model_rmse=rmse)
    return replace(
        result, form_errors={"braid_friction": part}, form_prediction=prediction, held_out_errors=errors
    )


def planned():
    """Return an experiment that separates two mechanisms."""
    return Experiment("stroke at 1 and at 50 mm/s", ("viscous_damping", "braid_friction"), 0.97)


def _model(values, measured):
    values = np.array(values)
    n = measured.shape[1]
    rows = tuple(np.flatnonzero(np.isfinite(channel)) for channel in measured)
    channel_noise = tuple(
        Ar1Noise(np.full(n, sd), 1.0, 0.3, True) if row.size else None
        for sd, row in zip(SD, rows, strict=True)
    )
    sd = np.array([1.2e9, 0.003, 0.01])
    estimate = SimpleNamespace(values=values, free=(0, 1))
    return SimpleNamespace(
        noise=NoiseModel(channel_noise, rows, tuple(np.zeros((0, 2), int) for _ in rows)),
        estimate=estimate,
        mechanisms=(),
        excess_chi2=0.0,
        within_model_covariance=np.diag(sd[:2] ** 2),
        sd=lambda k: sd[k],
    )


def _region(axes):
    pressure, contraction, time = (
        (float(v.min()), float(v.max())) for v in (axes.pressure, axes.contraction, axes.time)
    )
    description = "Above 100 kPa, force is about 20 N higher while the muscle lengthens."
    return MisfitRegion("force", "lengthening", pressure, contraction, time, 0.63, description)

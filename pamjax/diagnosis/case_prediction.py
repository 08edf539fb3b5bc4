"""Prediction of a loaded muscle, with its form errors, in the rows of a recording."""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.infer.fitting.load import LoadedMuscle
from pamjax.infer.form_errors.form_model import FormRows
from pamjax.infer.problem.dataset import CHANNELS, build_history
from pamjax.infer.problem.informative_samples import find_slack_samples
from pamjax.model.bench import Bench, BenchReading, clip_slack_force, record_bench
from pamjax.model.muscle import Muscle, MuscleReading, predict
from pamjax.records.case import Case


@dataclass(frozen=True, eq=False)
class CasePrediction:
    """Prediction of a model in the rows of a recording.

    Attributes:
        muscle: the muscle, without form errors.
        textbook: (2, n) its force (N) and diameter (m).
        values: (2, n) the same with form errors.
        sd: (2, n) standard deviation by parameters and form errors; zero without form errors.
        status: (n,) a `balance.Status`.
    """

    muscle: Muscle | Bench
    textbook: np.ndarray
    values: np.ndarray
    sd: np.ndarray
    status: np.ndarray


def predict_case(model: LoadedMuscle, case: Case, pressure: np.ndarray, length: np.ndarray) -> CasePrediction:
    """Return the prediction of a model, with its form errors.

    Args:
        model: the model.
        case: a recording with a measured force, for time and slack rows.
        pressure, length: (n,) pressure (Pa) and length (m) of its rows.
    """
    form_errors = model.form_errors
    muscle = model.muscle if form_errors is None else form_errors.muscle
    reading = _predict_reading(muscle, case, pressure, length)
    textbook, status = _stack_channels(reading), np.asarray(reading.status)
    if form_errors is None:
        return CasePrediction(muscle, textbook, textbook, np.zeros_like(textbook), status)

    def predict_bench(bench: Bench) -> np.ndarray:
        return predict_channels(bench, case, pressure, length)

    rate = np.asarray(build_history(case, case.recording.n).rate(jnp.asarray(length)))
    columns = form_errors.build_columns(FormRows(pressure, length, rate), predict_bench)
    values = textbook + form_errors.predict_form(columns)
    return CasePrediction(muscle, textbook, values, form_errors.compute_sd(columns, predict_bench), status)


def predict_channels(
    muscle: Muscle | Bench, case: Case, pressure: np.ndarray, length: np.ndarray
) -> np.ndarray:
    """Return the predicted force (N) and diameter (m) of a muscle without form errors, (2, n)."""
    return _stack_channels(_predict_reading(muscle, case, pressure, length))


def _stack_channels(reading: MuscleReading | BenchReading) -> np.ndarray:
    return np.stack([np.asarray(getattr(reading, channel)) for channel in CHANNELS])


def _predict_reading(
    muscle: Muscle | Bench, case: Case, pressure: np.ndarray, length: np.ndarray
) -> MuscleReading | BenchReading:
    state, loose = (jnp.asarray(pressure), jnp.asarray(length)), jnp.asarray(find_slack_samples(case))
    if isinstance(muscle, Bench):
        return record_bench(muscle, *state, build_history(case, case.recording.n), loose)
    ideal = predict(muscle, *state)
    return eqx.tree_at(lambda r: r.force, ideal, clip_slack_force(ideal.force, loose))

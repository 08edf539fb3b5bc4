"""Form errors in the rows of a schedule, for simulated recordings."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from pamjax.infer.form_errors.form_model import FormErrorModel, FormRows
from pamjax.model.bench import record_bench
from pamjax.records.protocol import Schedule
from pamjax.records.simulate import build_schedule_history


def predict_schedule_form(model: FormErrorModel, schedule: Schedule, settled: bool = False) -> np.ndarray:
    """Return the form errors of force (N) and diameter (m) at every sample of a schedule, (2, n).

    Args:
        model: the form errors.
        schedule: pressure and length at every sample.
        settled: whether the muscle has run the schedule once before.
    """
    history = build_schedule_history(schedule, settled)
    pressure, length = jnp.asarray(schedule.pressure), jnp.asarray(schedule.length)

    def predict(bench):
        reading = record_bench(bench, pressure, length, history)
        return np.stack([np.asarray(reading.force), np.asarray(reading.diameter)])

    rows = FormRows(schedule.pressure, schedule.length, np.asarray(history.rate(length)))
    return model.predict_form(model.build_columns(rows, predict))

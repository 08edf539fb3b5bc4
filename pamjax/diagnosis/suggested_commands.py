"""Commands that use the model of a diagnosis, with numbers of its recording."""

from __future__ import annotations

import numpy as np

from pamjax.diagnosis.result import Diagnosis
from pamjax.records.recording import Recording

#: Name of the file with the improved model.
MODEL_FILE = "model.json"


def list_suggested_commands(diagnosis: Diagnosis, model: str = MODEL_FILE) -> list[tuple[str, str]]:
    """Return uses of the improved model, each with its command.

    Args:
        diagnosis: the diagnosis.
        model: path of model.json, as text for a shell.
    """
    recording = diagnosis.problem.case.recording
    simulate = ("Simulate a protocol", f"pamjax simulate {model} PROTOCOL.toml --out simulated")
    if recording.measures_length:
        return [simulate]
    force, length = _choose_state(recording)
    # No exponent, as 1.49e+03 would have.
    force_text = f"{force:.0f} N" if force >= 100 else f"{force:.3g} N"
    command = f'pamjax inverse {model} --force "{force_text}" --length "{1e3 * length:.4g} mm"'
    return [
        ("Test the model on another recording", f"pamjax validate {model} OTHER"),
        ("Compute the pressure for a force at a length", command),
        simulate,
    ]


def _choose_state(recording: Recording) -> tuple[float, float]:
    """Return force (N) and length (m) of the row closest to half of the largest force."""
    force = np.where(np.isfinite(recording.force), recording.force, np.inf)
    if not np.isfinite(force).any():
        return 0.0, float(np.nanmedian(recording.length))
    row = int(np.argmin(np.abs(force - 0.5 * np.max(force[np.isfinite(force)]))))
    return float(force[row]), float(recording.length[row])

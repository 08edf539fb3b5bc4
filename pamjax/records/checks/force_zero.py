"""Detection of a wrong zero of the load cell, from a slack muscle at a fixed length.

A muscle that is vented and shorter than at rest is slack, and pulls with no force. The median force of these
rows is then the zero error of the load cell. At a low pressure, some muscles are slack and others pull. No
muscle pushes, so that only a negative force is then an error.

Neglects: the push of a thick tube that is compressed between fixed fittings. Hence the result is a warning.
"""

from __future__ import annotations

import numpy as np

from pamjax.records.blocks import find_blocks
from pamjax.records.reading.muscle_toml import MuscleToml
from pamjax.records.recording import Recording
from pamjax.units import format_quantity

#: Largest pressure of a vented row, and of one with a low pressure, as a share of the highest pressure.
_MAX_VENTED_SHARE, _MAX_LOW_PRESSURE_SHARE = 0.03, 0.1

#: Smallest contraction of a slack row.
_MIN_SLACK_CONTRACTION = 0.02

#: A zero error is reported above this number of standard deviations of one row, and this share of the force.
_MIN_ZERO_SD, _MIN_ZERO_SHARE = 4.0, 0.003

#: Smallest number of slack rows.
_MIN_SLACK_ROWS = 5


def check_force_zero(recording: Recording, muscle_toml: MuscleToml, file: str) -> list[str]:
    """Return a warning if the load cell reads a force while the muscle is slack.

    Args:
        recording: the recording, SI.
        muscle_toml: contents of muscle.toml.
        file: name of the CSV file.
    """
    has_force = recording.usable & np.isfinite(recording.force)
    if recording.measures_length or not has_force.any() or find_blocks(recording).kind != "lengths":
        return []
    contraction = 1 - recording.length / muscle_toml.rest_length.value
    share = recording.pressure / np.max(recording.pressure[has_force])
    is_contracted = has_force & (contraction > _MIN_SLACK_CONTRACTION)
    force = recording.force[is_contracted & (share <= _MAX_VENTED_SHARE)]
    is_vented = force.size >= _MIN_SLACK_ROWS
    if not is_vented:
        force = recording.force[is_contracted & (share <= _MAX_LOW_PRESSURE_SHARE)]
    if force.size < _MIN_SLACK_ROWS:
        return []
    zero = float(np.median(force))
    # Half the range of the middle two thirds is the sd of normal noise.
    noise = muscle_toml.sensors.force or 0.5 * float(np.diff(np.quantile(force, [1 / 6, 5 / 6]))[0])
    largest = float(np.max(np.abs(recording.force[has_force])))
    if (zero > 0 and not is_vented) or abs(zero) <= max(_MIN_ZERO_SD * noise, _MIN_ZERO_SHARE * largest):
        return []
    return [
        f"the force is {format_quantity(zero, 'N', 3)} in {force.size} rows of {file} in which the muscle is"
        " slack: no or low pressure, shorter than at rest. Check the zero of the load cell. If it is wrong,"
        " subtract this force: `pamjax import` has the entry `zero` of a column."
    ]

"""Samples at which a recording turns: an input of the model changes its speed between two samples."""

from __future__ import annotations

import numpy as np

from pamjax.records.recording import Recording

#: Deviation of a sample from the line through its neighbours, over its median, above which it is no noise.
_MIN_NOISE_RATIO = 6.0

#: Share of the path of an input below which deviations are rounding, not noise.
_MIN_DEVIATION_SHARE = 1e-6

#: Change of speed at a turn, as a share of the speed.
_MIN_SPEED_CHANGE = 0.25

#: Largest share of turns in a recording with strokes or ramps.
_MAX_TURN_SHARE = 0.1


def find_turns(recording: Recording) -> np.ndarray:
    """Return whether an input of the model changes its speed abruptly at a sample, (n,).

    The inputs are pressure and length, or the pressure alone if the length is measured. The motion between
    two samples is not known. At a turn, therefore, neither the speed nor the flow of the fluid is known: it
    is that before the turn, that after it, or one in between. Without times there is no speed, and no turn. A
    recording with too many such samples has no strokes or ramps, and thus no turn.
    """
    turns = np.zeros(recording.n, dtype=bool)
    if recording.time is None or recording.n < 3:
        return turns
    step, usable, starts = np.diff(recording.time), recording.usable, recording.is_run_start
    is_inside = usable[:-2] & usable[1:-1] & usable[2:] & ~(starts[1:-1] | starts[2:])
    inputs = [recording.pressure] if recording.measures_length else [recording.length, recording.pressure]
    for values in inputs:
        speed = np.divide(np.diff(values), step, out=np.zeros(step.size), where=step > 0)
        turns[1:-1] |= _is_turn(speed, step, is_inside)
    return turns if np.mean(turns) <= _MAX_TURN_SHARE else np.zeros_like(turns)


def _is_turn(speed: np.ndarray, step: np.ndarray, is_inside: np.ndarray) -> np.ndarray:
    """Return whether the speed changes by much more than noise and by a share of the speed, (n - 2,).

    Args:
        speed: (n - 1,) mean speed between two samples.
        step: (n - 1,) time between them, s.
        is_inside: (n - 2,) whether a sample and its neighbours are usable and in one run.
    """
    if not is_inside.any():
        return is_inside
    before, after = speed[:-1], speed[1:]
    change = np.abs(after - before)
    # A sample deviates by this from the line through its neighbours.
    deviation = change * step[:-1] * step[1:] / np.maximum(step[:-1] + step[1:], np.finfo(float).tiny)
    path = float(np.sum(np.abs(speed * step)[:-1][is_inside]))
    noise = max(float(np.median(deviation[is_inside])), _MIN_DEVIATION_SHARE * path)
    fastest = np.maximum(np.abs(before), np.abs(after))
    typical_speed = np.maximum(fastest, np.median(fastest[is_inside]))
    return is_inside & (deviation > _MIN_NOISE_RATIO * noise) & (change > _MIN_SPEED_CHANGE * typical_speed)

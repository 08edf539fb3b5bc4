"""Stand-ins: whether one mechanism could have made what another did, on this recording.

A name that was not concealed is no mistake where the recording cannot tell it from what was. The test is
made on the recording without noise: the true muscle loses the concealed mechanism, gets the other, and is
refitted; what is left, in noise standard deviations with the noise's own correlation, is

    χ² = |W (y_true − y_refit)|²,          y_true what the true bench shows of what was set, as recorded,

the largest expected gain of the truth over the stand-in. Below `ALIKE` no test on one recording of this
length decides between them.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from pamjax.benchmark.inject_effect import Envelope, absent
from pamjax.diagnosis.detect.score_test import signatures
from pamjax.diagnosis.library.candidates import forms
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.noise.estimate import whitening
from pamjax.diagnosis.refit.least_squares import refit

#: χ² below which two mechanisms are alike: odds of e⁶ at most, once, when everything else is known.
ALIKE = 12.0


def stands_in(found: Problem, envelope: Envelope, concealed: str, other: str) -> bool:
    """Whether `other` would explain what `concealed` did, up to noise.

    Args:
        found: the recording, with noise, before the library.
        envelope: what is concealed in it.
        concealed: id of one of the concealed mechanisms.
        other: id of another mechanism, not concealed.
    """
    if other == concealed:
        return True
    # The error that noise made of a held length is as good as none.
    true = np.array([envelope.true.get(name, 0.0) for name in found.names])
    white = whitening(found, true, np.ones(found.n, dtype=bool))
    # Of pressure and length as they were recorded: their noise is no difference between the two.
    clean = dataclasses.replace(found, measured=np.where(np.isnan(found.measured), np.nan, found.shows(true)))
    (gone,) = (form for form in envelope.forms if form.id == concealed)
    values = absent(found, true, gone)
    kept = [name for form in envelope.forms if form is not gone for name in form.moves]
    base = sorted({*np.flatnonzero(found.own).tolist(), *(found.place(name) for name in kept)})
    without = refit(clean, white, base, values)
    scored = signatures(clean, white, without, [form for form in forms(found) if form.id == other])
    if not scored:
        return False
    best = max(scored, key=lambda s: s.gain)
    start = without.values.copy()
    for name, value in best.form.shape.items():
        k = found.place(name)
        start[k] = np.clip(value, found.low[k], found.high[k])
    for name, amplitude in zip(best.form.amplitudes, best.amplitudes, strict=True):
        k = found.place(name)
        inside = 1e-3 * (found.high[k] - found.low[k])
        start[k] = np.clip(found.neutral[k] + amplitude, found.low[k] + 1e-3 * inside, found.high[k] - inside)
    moved = sorted({*base, *(found.place(name) for name in best.form.moves)})
    return bool(refit(clean, white, moved, start).misfit < ALIKE)

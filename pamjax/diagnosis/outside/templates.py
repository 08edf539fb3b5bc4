"""Templates of effects outside the library: what a recording looks like if one of them is present.

A template is not physics of the muscle. It has a known shape and an unknown size, and it competes with the
mechanisms on equal terms. A recording that prefers one is reported as "unexplained: like ...".

A new template is one function that yields its variants, and one entry in `TEMPLATES`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.special import expit

from pamjax.diagnosis.settings import DEFAULT_SETTINGS, DiagnosisSettings
from pamjax.infer.noise.spectral_lines import compute_relative_power, refine_frequency
from pamjax.model.form_error import FormError
from pamjax.records.blocks import Blocks

#: Number of moments and of contractions at which a template may begin.
_MOMENT_COUNT, CONTRACTION_COUNT = 96, 24
#: Pressures below which a muscle bends, and the width of the transition, as shares of the highest pressure.
_BENDING_PRESSURES, _BENDING_TRANSITION = (0.2, 0.3, 0.4, 0.5, 0.6), 0.08
#: Periods over the stroke of a ripple.
_RIPPLE_PERIODS = np.arange(4.0, 20.5, 0.5)
#: Number of frequencies of an interference that are tried, of those that exceed the noise around them most.
_FREQUENCY_COUNT = 3


@dataclass(frozen=True, eq=False)
class Template:
    """An effect outside the library at one place.

    Attributes:
        id: family of the effect.
        description: the effect with its place, to follow "like".
        columns: (k, 2, n) shapes in force (N) and diameter (m), of any size.
        share: share of this place in the prior probability of the family.
        form_error: where its shape may be inexact.
    """

    id: str
    description: str
    columns: np.ndarray
    share: float
    form_error: FormError = field(default_factory=FormError)


@dataclass(frozen=True, eq=False)
class TemplateContext:
    """What a template may depend on, in n rows.

    Attributes:
        time: (n,) time of each sample, s; None without time.
        pressure: (n,) Pa.
        length: (n,) m, as it was read: a fixed length is not averaged.
        rest_length: m.
        force: (n,) measured force, N; NaN where no sample is compared.
        blocks: isobars, holds or cycles of the recording.
        prediction: (2, n) force (N) and diameter (m) of the baseline.
        by_pressure, by_length: (n,) derivatives of the force, N/Pa and N/m.
        by_stiffness: (2, n) derivatives of force and diameter by a number of the threads' stiffness.
        settings: thresholds of the diagnosis.
    """

    time: np.ndarray | None
    pressure: np.ndarray
    length: np.ndarray
    rest_length: float
    force: np.ndarray
    blocks: Blocks
    prediction: np.ndarray
    by_pressure: np.ndarray
    by_length: np.ndarray
    by_stiffness: np.ndarray
    settings: DiagnosisSettings = DEFAULT_SETTINGS

    @property
    def residual(self) -> np.ndarray:
        """Return the force residual of the baseline, (n,) N; zero where none was measured."""
        return np.nan_to_num(self.force - self.prediction[0])

    @property
    def contraction(self) -> np.ndarray:
        """Return the contraction 1 − L/L₀, (n,)."""
        return 1 - self.length / self.rest_length


def build_templates(context: TemplateContext) -> list[Template]:
    """Return every template at every place; those that the recording cannot show are left out."""
    out = []
    for id, family in TEMPLATES.items():
        variants = [
            (says, np.stack([_fill_channels(column) for column in columns]))
            for says, columns in family.build(context)
        ]
        variants = [(says, columns) for says, columns in variants if np.abs(columns).sum() > 0]
        # An interference has one of all frequencies, of which the largest are built.
        places = max(len(variants), context.length.size if id == "interference" else 0)
        out += [Template(id, says, columns, 1 / places, family.form_error) for says, columns in variants]
    return out


def _fill_channels(column: np.ndarray) -> np.ndarray:
    """Return a (2, n) column from the effect on force, (n,), or on both channels."""
    column = np.nan_to_num(column)
    return column if column.ndim == 2 else np.stack([column, np.zeros_like(column)])


Variants = Iterator[tuple[str, list[np.ndarray]]]


def _list_moments(time: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """Return moments, s, and for each the mask of the rows after it."""
    steps = np.linspace(0, time.size, _MOMENT_COUNT + 2)[1:-1].astype(int)
    return [(float(time[k]), np.arange(time.size) >= k) for k in np.unique(steps)]


def _list_contractions(context: TemplateContext) -> np.ndarray:
    low, high = np.quantile(context.contraction, (0.0, 1.0))
    return np.linspace(low, high, CONTRACTION_COUNT + 2)[1:-1]


def _build_zero_steps(context: TemplateContext) -> Variants:
    """Yield a step of the force zero at one moment."""
    if context.time is not None:
        for moment, after in _list_moments(context.time):
            yield f"a step of the force zero after {moment:.0f} s", [after.astype(float)]


def _build_thread_breaks(context: TemplateContext) -> Variants:
    """Yield a loss of stiffness of the threads, or of a share of the force, from one moment."""
    if context.time is not None:
        for moment, after in _list_moments(context.time):
            says = f"broken threads after {moment:.0f} s"
            yield says, [after * context.prediction[0]]
            yield says, [after * context.by_stiffness]


def _build_stops(context: TemplateContext) -> Variants:
    """Yield an elastic stop that the muscle touches beyond a contraction, at either end of the stroke."""
    for x in _list_contractions(context):
        yield f"a stop beyond {x:.1%} contraction", [np.maximum(context.contraction - x, 0)]
        yield f"a stop below {x:.1%} contraction", [np.maximum(x - context.contraction, 0)]


def _build_buckling(context: TemplateContext) -> Variants:
    """Yield a force beyond a contraction that acts at high or at low pressure: the muscle bends sideways."""
    pressure, highest = context.pressure, max(float(np.nanmax(context.pressure)), 1e-9)
    for x in _list_contractions(context):
        beyond = np.maximum(context.contraction - x, 0)
        says = f"bending beyond {x:.1%} contraction"
        yield f"{says} at high pressure", [pressure / highest * beyond]
        # Pressure stiffens a muscle against bending: it bends below an unknown pressure.
        for share in _BENDING_PRESSURES:
            weight = expit((share - pressure / highest) / _BENDING_TRANSITION)
            yield f"{says} below {share * highest / 1e3:.0f} kPa", [weight * beyond]


def _build_clipping(context: TemplateContext) -> Variants:
    """Yield a load cell that does not read above the largest measured force."""
    force, level = context.force, float(np.nanmax(context.force, initial=-np.inf))
    # A converter at its limit repeats the same reading.
    if np.count_nonzero(force == level) >= context.settings.min_clipped_readings:
        yield f"a load cell that clips at {level:.0f} N", [-np.maximum(context.prediction[0] - level, 0)]


def _build_length_ripples(context: TemplateContext) -> Variants:
    """Yield a force that is periodic in length, of one size or in proportion to the force."""
    length = context.length
    stroke = float(np.ptp(length))
    if stroke > 0:
        for k in _RIPPLE_PERIODS:
            phase = 2 * np.pi * k * (length - length.min()) / stroke
            says = f"a force with a period of {1e3 * stroke / k:.2g} mm in length"
            yield says, [np.cos(phase), np.sin(phase)]
            yield (
                f"{says}, proportional to the force",
                [context.prediction[0] * f(phase) for f in (np.cos, np.sin)],
            )


def _build_interference(context: TemplateContext) -> Variants:
    """Yield a periodic disturbance of the force, or of the pressure, at the frequencies that stand out."""
    if context.time is None:
        return
    frequencies, power = compute_relative_power(context.residual, context.time)
    for k in np.argsort(-power)[:_FREQUENCY_COUNT]:
        frequency = refine_frequency(context.residual, context.time, float(frequencies[k]))
        phase = 2 * np.pi * frequency * context.time
        pair = [np.cos(phase), np.sin(phase)]
        says = f"a disturbance with a period of {1 / frequency:.2g} s"
        yield f"{says} in force", pair
        yield f"{says} in pressure", [context.by_pressure * f for f in pair]


def _build_single_blocks(context: TemplateContext) -> Variants:
    """Yield one block that differs from all others, by a force or by a shift of length."""
    label = context.blocks.label
    for k, name in enumerate(context.blocks.names):
        inside = (label == k).astype(float)
        yield f"{name} alone, with another force zero", [inside]
        yield f"{name} alone, with another length", [inside * context.by_length]


def _build_stuck_lengths(context: TemplateContext) -> Variants:
    """Yield a length channel that repeats its reading while the muscle moves on."""
    length = context.length
    is_stuck = _find_repeated_readings(length, context.settings.min_stuck_readings)
    if is_stuck.any() and not is_stuck.all():
        rows = np.arange(length.size)
        length_change = np.interp(rows, rows[~is_stuck], length[~is_stuck]) - length
        yield "a length channel that repeats its reading", [context.by_length * length_change]


def _find_repeated_readings(values: np.ndarray, min_run: int) -> np.ndarray:
    """Return the rows, (n,), that repeat the reading before them, in runs of at least `min_run` readings."""
    number = np.cumsum(np.diff(values, prepend=np.nan) != 0)
    sizes = np.bincount(number)[number]
    first = np.diff(number, prepend=0) != 0
    return (sizes >= min_run) & ~first


@dataclass(frozen=True)
class TemplateFamily:
    """The templates of one effect.

    Attributes:
        build: yields a description and the columns of each variant.
        form_error: where the shape may be inexact; nowhere by default.
    """

    build: Callable[[TemplateContext], Variants]
    form_error: FormError = field(default_factory=FormError)


#: The course of the force of a bent muscle is not known.
_BENDING_FORM_ERROR = FormError(("pressure", "pressure^2", "length", "length^2", "pressure length"))

#: Templates by family.
TEMPLATES = {
    "zero_step": TemplateFamily(_build_zero_steps),
    "thread_break": TemplateFamily(_build_thread_breaks),
    "stop": TemplateFamily(_build_stops),
    "buckling": TemplateFamily(_build_buckling, _BENDING_FORM_ERROR),
    "clipping": TemplateFamily(_build_clipping),
    "length_ripple": TemplateFamily(_build_length_ripples),
    "interference": TemplateFamily(_build_interference),
    "single_block": TemplateFamily(_build_single_blocks),
    "stuck_length": TemplateFamily(_build_stuck_lengths),
}

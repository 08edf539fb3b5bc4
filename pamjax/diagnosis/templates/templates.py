"""Templates of effects outside the library: what a recording looks like if one of them is present.

A template is not physics of the muscle. It has a known shape and an unknown size, and it competes with the
mechanisms on equal terms. A recording that prefers one is reported as "unexplained: like ...".

Many effects begin at a place, which is a moment or a contraction. A family is first tried at the places of a
coarse grid. `Template.refine` gives the same family at finer places around one of them.

A new template is one function that yields its variants at a place, and one entry in `TEMPLATES`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.special import expit

from pamjax.diagnosis.settings import DEFAULT_SETTINGS, DiagnosisSettings
from pamjax.infer.noise.spectral_lines import compute_relative_power, refine_frequency
from pamjax.model.form_error import FormError
from pamjax.records.blocks import Blocks

#: Number of moments and of contractions at which a template may begin, and of finer ones around one of them.
_MOMENT_COUNT, CONTRACTION_COUNT, _FINER_COUNT = 96, 24, 14
#: Pressures below which a muscle bends, and the width of the transition, as shares of the highest pressure.
_BENDING_PRESSURES, _BENDING_TRANSITION = (0.2, 0.3, 0.4, 0.5, 0.6), 0.08
#: Periods over the stroke of a ripple.
_RIPPLE_PERIODS = np.arange(4.0, 20.5, 0.5)
#: Number of frequencies of an interference that are tried, of those that exceed the noise around them most.
_FREQUENCY_COUNT = 3


def _return_nothing() -> list[Template]:
    return []


@dataclass(frozen=True, eq=False)
class Template:
    """An effect outside the library at one place.

    Attributes:
        id: family of the effect.
        description: the effect with its place, to follow "like".
        columns: (k, 2, n) shapes in force (N) and diameter (m), of any size.
        share: share of this place in the prior probability of the family.
        form_error: where its shape may be inexact.
        refine: returns the family at finer places around this one; none if it has no place.
    """

    id: str
    description: str
    columns: np.ndarray
    share: float
    form_error: FormError = field(default_factory=FormError)
    refine: Callable[[], list[Template]] = _return_nothing


#: Returns all templates at all coarse places, at (p,) parameter values, SI.
TemplateBuilder = Callable[[np.ndarray], list[Template]]


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
        prediction: (2, n) force (N) and diameter (m) of the model.
        by_pressure, by_length: (2, n) derivatives of force and diameter by pressure and by length, SI.
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
        """Return the force residual of the model, (n,) N; zero where none was measured."""
        return np.nan_to_num(self.force - self.prediction[0])

    @property
    def contraction(self) -> np.ndarray:
        """Return the contraction 1 − L/L₀, (n,)."""
        return 1 - self.length / self.rest_length

    def find_later_rows(self, row: float) -> tuple[np.ndarray, str]:
        """Return 1 from a row on and 0 before, (n,), and words for the moment of this row."""
        assert self.time is not None
        step = max(float(np.median(np.diff(self.time))), 1e-9)
        decimals = max(-math.floor(math.log10(step)), 0)
        moment = f"after {self.time[int(row)]:.{decimals}f} s"
        return (np.arange(self.time.size) >= row).astype(float), moment


Variants = Iterator[tuple[str, list[np.ndarray]]]


@dataclass(frozen=True)
class TemplateFamily:
    """The templates of one effect.

    Attributes:
        build: yields a description and the columns of each variant at a place.
        list_places: returns the coarse places, (k,); by default a family has no place.
        form_error: where the shape may be inexact; nowhere by default.
        counts_all_frequencies: whether the variants are the largest of all frequencies of the recording.
    """

    build: Callable[[TemplateContext, float], Variants]
    list_places: Callable[[TemplateContext], np.ndarray] | None = None
    form_error: FormError = field(default_factory=FormError)
    counts_all_frequencies: bool = False


def build_templates(context: TemplateContext) -> list[Template]:
    """Return every template at every coarse place; those that the recording cannot show are left out."""
    out = []
    for id, family in TEMPLATES.items():
        places = np.zeros(1) if family.list_places is None else family.list_places(context)
        variants = _list_variants(context, id, places, range(len(places)))
        count = max(len(variants), context.length.size if family.counts_all_frequencies else 0)
        out += [_build_template(context, id, places, variant, 1 / count) for variant in variants]
    return out


@dataclass(frozen=True, eq=False)
class _Variant:
    """A variant of a family at the k-th of some places, with its words and its (m, 2, n) columns."""

    k: int
    description: str
    columns: np.ndarray


def _list_variants(
    context: TemplateContext, id: str, places: np.ndarray, indices: Sequence[int]
) -> list[_Variant]:
    """Return the variants of a family at some places that the recording can show."""
    variants = [
        _Variant(k, says, np.stack([_fill_channels(column) for column in columns]))
        for k in indices
        for says, columns in TEMPLATES[id].build(context, places[k])
    ]
    return [variant for variant in variants if np.abs(variant.columns).sum() > 0]


def _build_template(
    context: TemplateContext, id: str, places: np.ndarray, variant: _Variant, share: float
) -> Template:
    family = TEMPLATES[id]
    refine = (
        partial(_refine, context, id, places, variant.k, share) if family.list_places else _return_nothing
    )
    return Template(id, variant.description, variant.columns, share, family.form_error, refine)


def _refine(context: TemplateContext, id: str, places: np.ndarray, k: int, share: float) -> list[Template]:
    """Return the templates of a family between the neighbours of its k-th place, which divide its share."""
    spacing = np.diff(places, prepend=0 if len(places) == 1 else 2 * places[0] - places[1])
    low, high = places[k] - spacing[k], places[k] + spacing[min(k + 1, len(places) - 1)]
    if TEMPLATES[id].list_places is _list_moments:
        # A change that precedes nearly all samples is a constant property of the muscle or the rig.
        low, high = max(low, places[0] - 1), min(high, places[-1] + 1)
    finer = np.linspace(low, high, _FINER_COUNT + 2)
    finer = np.unique(finer.astype(places.dtype))
    inner = [j for j in range(len(finer)) if low < finer[j] < high and finer[j] != places[k]]
    return [
        _build_template(context, id, finer, variant, share / len(inner))
        for variant in _list_variants(context, id, finer, inner)
    ]


def _fill_channels(column: np.ndarray) -> np.ndarray:
    """Return a (2, n) column from the effect on force, (n,), or on both channels."""
    column = np.nan_to_num(column)
    return column if column.ndim == 2 else np.stack([column, np.zeros_like(column)])


def _list_moments(context: TemplateContext) -> np.ndarray:
    """Return the rows at which an effect may begin; none without time."""
    if context.time is None:
        return np.zeros(0, dtype=int)
    return np.unique(np.linspace(0, context.time.size, _MOMENT_COUNT + 2)[1:-1].astype(int))


def _list_contractions(context: TemplateContext) -> np.ndarray:
    low, high = np.quantile(context.contraction, (0.0, 1.0))
    return np.linspace(low, high, CONTRACTION_COUNT + 2)[1:-1]


def _build_zero_steps(context: TemplateContext, row: float) -> Variants:
    """Yield a step of the zero of force, pressure or length at one moment."""
    after, moment = context.find_later_rows(row)
    yield f"a step of the force zero {moment}", [after]
    yield f"a step of the pressure zero {moment}", [after * context.by_pressure]
    yield f"a step of the length zero {moment}", [after * context.by_length]


def _build_thread_breaks(context: TemplateContext, row: float) -> Variants:
    """Yield a loss of stiffness of the threads, of a share of the force, or of both, from one moment."""
    after, moment = context.find_later_rows(row)
    says = f"broken threads {moment}"
    force_loss, stiffness_loss = _fill_channels(after * context.prediction[0]), after * context.by_stiffness
    yield says, [force_loss]
    yield says, [stiffness_loss]
    yield says, [force_loss, stiffness_loss]


def _build_stops(context: TemplateContext, x: float) -> Variants:
    """Yield an elastic stop that the muscle touches beyond a contraction, at either end of the stroke."""
    yield f"a stop beyond {x:.1%} contraction", [np.maximum(context.contraction - x, 0)]
    yield f"a stop below {x:.1%} contraction", [np.maximum(x - context.contraction, 0)]


def _build_buckling(context: TemplateContext, x: float) -> Variants:
    """Yield a force beyond a contraction that acts at high or at low pressure: the muscle bends sideways."""
    pressure, highest = context.pressure, max(float(np.nanmax(context.pressure)), 1e-9)
    beyond = np.maximum(context.contraction - x, 0)
    says = f"bending beyond {x:.1%} contraction"
    yield f"{says} at high pressure", [pressure / highest * beyond]
    # Pressure stiffens a muscle against bending: it bends below an unknown pressure.
    for share in _BENDING_PRESSURES:
        weight = expit((share - pressure / highest) / _BENDING_TRANSITION)
        yield f"{says} below {share * highest / 1e3:.0f} kPa", [weight * beyond]


def _build_clipping(context: TemplateContext, _: float) -> Variants:
    """Yield a load cell that does not read above the largest measured force."""
    force, level = context.force, float(np.nanmax(context.force, initial=-np.inf))
    # A converter at its limit repeats the same reading.
    if np.count_nonzero(force == level) >= context.settings.min_clipped_readings:
        yield f"a load cell that clips at {level:.0f} N", [-np.maximum(context.prediction[0] - level, 0)]


def _build_length_ripples(context: TemplateContext, _: float) -> Variants:
    """Yield a force that is periodic in length, of one size or in proportion to the force.

    A period is resolved if no two neighbouring lengths are more than half of it apart. With a few fixed
    lengths, a shorter period would be another force zero for each length.
    """
    length = context.length
    stroke, largest_gap = float(np.ptp(length)), float(np.diff(np.sort(length)).max(initial=0.0))
    for k in _RIPPLE_PERIODS:
        if 2 * largest_gap < stroke / k:
            phase = 2 * np.pi * k * (length - length.min()) / stroke
            says = f"a force with a period of {1e3 * stroke / k:.2g} mm in length"
            yield says, [np.cos(phase), np.sin(phase)]
            yield (
                f"{says}, proportional to the force",
                [context.prediction[0] * f(phase) for f in (np.cos, np.sin)],
            )


def _build_interference(context: TemplateContext, _: float) -> Variants:
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


def _build_single_blocks(context: TemplateContext, _: float) -> Variants:
    """Yield one block that differs from all others, by a force or by a shift of length."""
    label = context.blocks.label
    for k, name in enumerate(context.blocks.names):
        inside = (label == k).astype(float)
        yield f"{name} alone, with another force zero", [inside]
        yield f"{name} alone, with another length", [inside * context.by_length]


def _build_stuck_lengths(context: TemplateContext, _: float) -> Variants:
    """Yield a length channel that repeats its reading while the muscle moves on."""
    length = context.length
    is_stuck = _find_repeated_readings(length, context.settings.min_stuck_readings)
    if is_stuck.any() and not is_stuck.all():
        rows = np.arange(length.size)
        length_change = np.interp(rows, rows[~is_stuck], length[~is_stuck]) - length
        yield "a length channel that repeats its reading", [context.by_length * length_change]


def _build_stuck_forces(context: TemplateContext, _: float) -> Variants:
    """Yield a force channel that repeats its reading while the force of the muscle changes."""
    is_stuck = _find_repeated_readings(context.force, context.settings.min_stuck_readings)
    # A load cell that repeats its largest reading clips.
    is_stuck &= context.force < np.nanmax(context.force, initial=-np.inf)
    if is_stuck.any() and not is_stuck.all():
        rows = np.arange(is_stuck.size)
        reading = np.maximum.accumulate(np.where(is_stuck, 0, rows))
        change = context.prediction[0][reading] - context.prediction[0]
        yield "a force channel that repeats its reading", [np.where(is_stuck, change, 0.0)]


def _find_repeated_readings(values: np.ndarray, min_run: int) -> np.ndarray:
    """Return the rows, (n,), that repeat the reading before them, in runs of at least `min_run` readings."""
    number = np.cumsum(np.diff(values, prepend=np.nan) != 0)
    sizes = np.bincount(number)[number]
    first = np.diff(number, prepend=0) != 0
    return (sizes >= min_run) & ~first


#: The course of the force of a bent muscle is not known.
_BENDING_FORM_ERROR = FormError(("pressure", "pressure^2", "length", "length^2", "pressure length"))

#: Templates by family.
TEMPLATES = {
    "zero_step": TemplateFamily(_build_zero_steps, _list_moments),
    "thread_break": TemplateFamily(_build_thread_breaks, _list_moments),
    "stop": TemplateFamily(_build_stops, _list_contractions),
    "buckling": TemplateFamily(_build_buckling, _list_contractions, _BENDING_FORM_ERROR),
    "clipping": TemplateFamily(_build_clipping),
    "length_ripple": TemplateFamily(_build_length_ripples),
    "interference": TemplateFamily(_build_interference, counts_all_frequencies=True),
    "single_block": TemplateFamily(_build_single_blocks),
    "stuck_length": TemplateFamily(_build_stuck_lengths),
    "stuck_force": TemplateFamily(_build_stuck_forces),
}

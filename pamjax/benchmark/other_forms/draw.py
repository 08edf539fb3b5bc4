"""Draw a simulated recording with effects in other forms, from stated distributions.

| drawn                  | from                                                                          |
|------------------------|-------------------------------------------------------------------------------|
| muscle, bench, sensors | `setups.py`; an inelastic baseline states no stiffness                        |
| true braid             | stated values and their sd, within two sd                                     |
| true sensors           | as stated; in a third of the recordings each sd is 0.7 to 1.5 times as large  |
| size of an effect      | 2 to 30 noise standard deviations, log-uniform (`size.py`)                    |
| mechanism              | equal chances, without the pairs that exclude each other                      |
| form                   | equal chances within the mechanism (`library.py`)                             |
| family outside         | equal chances (`outside.py`)                                                  |

A mechanism that cannot reach the drawn size on this bench is replaced by another one. Sizes hold with all
effects of the recording present. A recording that the reader of case folders refuses is drawn again. Nothing
here depends on a diagnosis.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field

import numpy as np

from pamjax.benchmark.other_forms.case_text import build_text_case
from pamjax.benchmark.other_forms.drawn_form import DrawnForm
from pamjax.benchmark.other_forms.library import OTHER_FORMS
from pamjax.benchmark.other_forms.muscle import (
    BenchPlan,
    Effect,
    Readings,
    TrueBraid,
    apply_to_readings,
    simulate_effects,
)
from pamjax.benchmark.other_forms.outside import OUTSIDE_FAMILIES
from pamjax.benchmark.other_forms.scales import BenchScales, build_scales, draw_log_uniform
from pamjax.benchmark.other_forms.size import BaselineFit, compute_size, scale_to_size
from pamjax.benchmark.setups import Setup, draw_setup
from pamjax.errors import BadInput
from pamjax.model.registry import EXCLUSIVE_PAIRS
from pamjax.records.blocks import find_blocks
from pamjax.records.reading.muscle_toml import MuscleToml, Sensors
from pamjax.records.reading.quantity import MeasuredValue
from pamjax.records.recording import Recording
from pamjax.records.simulate import draw_ar1_noise

#: Kinds of recordings: number of mechanisms, and whether a family outside the library is present.
BANK_KINDS = {
    "nothing": (0, False),
    "single": (1, False),
    "pair": (2, False),
    "triple": (3, False),
    "outside": (0, True),
    "mixed": (1, True),
}

#: Smallest and largest size of an effect, in noise standard deviations.
_MIN_BANK_SIZE, _MAX_BANK_SIZE = 2.0, 30.0

#: Share of recordings with misstated sensors, and range of true over stated sd.
_MISSTATED_SHARE, MIN_MISSTATED_RATIO, MAX_MISSTATED_RATIO = 1 / 3, 0.7, 1.5

#: Draws of a recording, and rounds of scaling with all effects present.
_MAX_RECORDING_DRAWS, _JOINT_SCALING_ROUNDS = 50, 6

#: Largest relative difference between a size and its target.
_MAX_TARGET_ERROR = 0.12


@dataclass(frozen=True)
class ConcealedEffect:
    """An effect of a recording.

    Attributes:
        id: id of the mechanism, or family outside the library.
        form: name of the form; "usual" is that of the fit.
        in_library: whether it is a mechanism of the library.
        target: drawn size, in noise standard deviations.
        size: size with all effects present.
        parameters: amplitude and shape, SI.
        amplitude: name of the amplitude.
    """

    id: str
    form: str
    in_library: bool
    target: float
    size: float
    parameters: dict[str, float] = field(default_factory=dict)
    amplitude: str = ""


@dataclass(frozen=True, eq=False)
class BankRecording:
    """A simulated recording with effects in other forms.

    Attributes:
        kind: key of `BANK_KINDS`.
        muscle_toml: stated values, as in muscle.toml.
        recording: the channels with noise.
        effects: concealed effects, mechanisms first.
        braid: true braid.
        sensors: true noise of the sensors.
        misstated: whether the stated noise differs from the true one.
        correlation: noise correlation of neighbouring samples.
        exact: readings without noise.
    """

    kind: str
    muscle_toml: MuscleToml
    recording: Recording
    effects: tuple[ConcealedEffect, ...]
    braid: TrueBraid
    sensors: Sensors
    misstated: bool
    correlation: float
    exact: Readings

    @property
    def sensor_ratios(self) -> dict[str, float]:
        """Return true over stated sd by channel."""
        return {
            name: getattr(self.sensors, name) / getattr(self.muscle_toml.sensors, name)
            for name in ("force", "diameter", "pressure", "length")
        }


@dataclass(eq=False)
class _Slot:
    """A form with its sign, target and present amplitude."""

    form: DrawnForm
    sign: float
    target: float
    amplitude: float

    @property
    def effect(self) -> Effect:
        return self.form.build(self.amplitude)


def draw_bank_recording(
    kind: str, correlation: float, rng: np.random.Generator, setup: Setup | None = None
) -> BankRecording:
    """Draw a recording of a kind.

    Args:
        kind: key of `BANK_KINDS`.
        correlation: noise correlation of neighbouring samples of force and diameter.
        rng: random generator.
        setup: the muscle and its bench; None draws it.
    """
    for _ in range(_MAX_RECORDING_DRAWS):
        drawn = setup or draw_setup(rng)
        plan, block = _build_plan(drawn.plan), find_blocks(drawn.plan).label
        sensors, misstated = _draw_sensors(drawn.muscle_toml.sensors, rng)
        braid = _draw_braid(drawn.muscle_toml, rng)
        scales = build_scales(braid, plan, block, rng)
        baseline = BaselineFit(
            braid, plan, sensors, _get_prior_sd(drawn.muscle_toml), np.isfinite(drawn.plan.diameter)
        )
        slots = _draw_slots(kind, baseline, scales, rng)
        if slots is None or not _scale_together(baseline, slots):
            continue
        effects = [slot.effect for slot in slots]
        clean = baseline.simulate(effects)
        recording = _record(drawn.plan, baseline, effects, sensors, correlation, rng)
        muscle_toml = drawn.muscle_toml
        if muscle_toml.baseline == "inelastic":
            muscle_toml = dataclasses.replace(muscle_toml, stiffness=None)
        if not _is_readable(muscle_toml, recording):
            continue
        return BankRecording(
            kind,
            muscle_toml,
            recording,
            _describe(baseline, slots),
            braid,
            sensors,
            misstated,
            correlation,
            clean,
        )
    raise RuntimeError(f"no recording of kind {kind} in {_MAX_RECORDING_DRAWS} draws")


def _is_readable(muscle_toml: MuscleToml, recording: Recording) -> bool:
    """Return whether pamjax accepts the recording; it refuses a pressure far below zero."""
    try:
        build_text_case(muscle_toml, recording, "drawn")
    except BadInput:
        return False
    return True


def _build_plan(plan: Recording) -> BenchPlan:
    assert plan.time is not None
    return BenchPlan(plan.time, plan.is_run_start, plan.pressure, plan.length)


def _draw_sensors(stated_sensors: Sensors, rng: np.random.Generator) -> tuple[Sensors, bool]:
    """Draw the true noise of the sensors."""
    if rng.random() >= _MISSTATED_SHARE:
        return stated_sensors, False
    ratios = {
        name: getattr(stated_sensors, name) * draw_log_uniform(rng, MIN_MISSTATED_RATIO, MAX_MISSTATED_RATIO)
        for name in ("force", "diameter", "pressure", "length")
    }
    return dataclasses.replace(stated_sensors, **ratios), True


def _draw_braid(muscle_toml: MuscleToml, rng: np.random.Generator) -> TrueBraid:
    """Draw the true braid around its stated values."""
    assert muscle_toml.thread_length is not None
    assert muscle_toml.turns is not None
    thread, turns = _draw_value(muscle_toml.thread_length, rng), _draw_value(muscle_toml.turns, rng)
    stiffness = _draw_value(muscle_toml.stiffness, rng) if muscle_toml.stiffness else math.inf
    is_elastic = muscle_toml.baseline == "elastic"
    return TrueBraid(muscle_toml.rest_length.value, thread, turns, 1 / stiffness if is_elastic else 0.0)


def _draw_value(stated_value: MeasuredValue, rng: np.random.Generator) -> float:
    """Draw a true value from a stated one, within two standard deviations."""
    return stated_value.value + stated_value.sd * float(np.clip(rng.standard_normal(), -2, 2))


def _get_prior_sd(muscle_toml: MuscleToml) -> tuple[float, float, float]:
    assert muscle_toml.thread_length is not None
    assert muscle_toml.turns is not None
    return (
        muscle_toml.thread_length.sd,
        muscle_toml.turns.sd,
        muscle_toml.stiffness.sd if muscle_toml.stiffness else 0.0,
    )


def _draw_slots(
    kind: str, baseline: BaselineFit, scales: BenchScales, rng: np.random.Generator
) -> list[_Slot] | None:
    """Draw the effects of a recording one after the other; None if a family cannot reach its size."""
    count, has_outside = BANK_KINDS[kind]
    slots: list[_Slot] = []
    # An elastic baseline already includes thread stretch.
    ids = [id for id in OTHER_FORMS if id != "braid_elasticity" or baseline.braid.compliance == 0]
    order = rng.permutation(ids).tolist()
    for _ in range(count):
        target = draw_log_uniform(rng, _MIN_BANK_SIZE, _MAX_BANK_SIZE)
        while order:
            id = order.pop(0)
            if any(frozenset({id, slot.form.id}) in EXCLUSIVE_PAIRS for slot in slots):
                continue
            forms = OTHER_FORMS[id]
            slot = _size_form(forms[rng.integers(len(forms))](rng, scales), target, baseline, slots, rng)
            if slot is not None:
                slots.append(slot)
                break
        else:
            return None
    if has_outside:
        target = draw_log_uniform(rng, _MIN_BANK_SIZE, _MAX_BANK_SIZE)
        family = OUTSIDE_FAMILIES[str(rng.choice(list(OUTSIDE_FAMILIES)))]
        slot = _size_form(family(rng, scales), target, baseline, slots, rng)
        if slot is None:
            return None
        slots.append(slot)
    return slots


def _size_form(
    form: DrawnForm, target: float, baseline: BaselineFit, slots: list[_Slot], rng: np.random.Generator
) -> _Slot | None:
    """Return a form with its amplitude in the presence of the others; None if it cannot reach its target."""
    sign = float(rng.choice([-1.0, 1.0])) if form.is_signed else 1.0
    amplitude = _scale(form, sign, target, baseline, [slot.effect for slot in slots])
    return None if amplitude is None else _Slot(form, sign, target, amplitude)


def _scale(
    form: DrawnForm, sign: float, target: float, baseline: BaselineFit, others: list[Effect]
) -> float | None:
    without = baseline.simulate(others)
    return scale_to_size(
        form,
        sign,
        target,
        lambda effect: compute_size(baseline.compute_effect(baseline.simulate([*others, effect]), without)),
    )


def _scale_together(baseline: BaselineFit, slots: list[_Slot]) -> bool:
    """Scale every effect with all others present; return whether all sizes meet their targets."""
    for _ in range(_JOINT_SCALING_ROUNDS):
        sizes = _compute_sizes(baseline, slots)
        off = [abs(math.log(size / slot.target)) for size, slot in zip(sizes, slots, strict=True)]
        if max(off, default=0.0) < _MAX_TARGET_ERROR:
            return True
        for slot, error in zip(slots, off, strict=True):
            if error < _MAX_TARGET_ERROR:
                continue
            others = [other.effect for other in slots if other is not slot]
            amplitude = _scale(slot.form, slot.sign, slot.target, baseline, others)
            if amplitude is None:
                return False
            slot.amplitude = amplitude
    return False


def _compute_sizes(baseline: BaselineFit, slots: list[_Slot]) -> list[float]:
    """Return the size of each effect with all others present."""
    readings = baseline.simulate([slot.effect for slot in slots])
    return [
        max(
            compute_size(
                baseline.compute_effect(
                    readings, baseline.simulate([other.effect for other in slots if other is not slot])
                )
            ),
            1e-12,
        )
        for slot in slots
    ]


def _describe(baseline: BaselineFit, slots: list[_Slot]) -> tuple[ConcealedEffect, ...]:
    return tuple(
        ConcealedEffect(
            slot.form.id, slot.form.form, slot.form.id in OTHER_FORMS, slot.target, size,
            {slot.form.amplitude: slot.amplitude, **slot.form.shape}, slot.form.amplitude,
        )
        for slot, size in zip(slots, _compute_sizes(baseline, slots), strict=True)
    )  # fmt: skip


def _record(
    plan: Recording,
    baseline: BaselineFit,
    effects: list[Effect],
    sensors: Sensors,
    correlation: float,
    rng: np.random.Generator,
) -> Recording:
    """Return the readings with noise, then clipped or stuck."""
    clean, n = simulate_effects(baseline.braid, baseline.plan, effects), plan.n
    noisy = Readings(
        pressure=clean.pressure + (sensors.pressure or 0.0) * rng.standard_normal(n),
        length=clean.length + (sensors.length or 0.0) * rng.standard_normal(n),
        force=clean.force + (sensors.force or 0.0) * draw_ar1_noise(rng, n, correlation),
        diameter=clean.diameter + (sensors.diameter or 0.0) * draw_ar1_noise(rng, n, correlation),
    )
    kept = apply_to_readings(noisy, effects)
    return dataclasses.replace(
        plan, pressure=kept.pressure, length=kept.length, force=kept.force,
        diameter=np.where(baseline.diameter_rows, kept.diameter, np.nan),
    )  # fmt: skip

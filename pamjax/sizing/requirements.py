"""Requirements of a spec: outputs of a candidate with their bounds, each at least or at most."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pamjax.sizing.candidate import POINT_COUNT, OperatingPoints, locate_output
from pamjax.sizing.specification.spec import STROKE_SHARES, Spec, format_force_place
from pamjax.units import format_quantity

#: Upper limit of hoop pull of pressure / stiffness of the threads. At 1 the threads stretch without limit.
MAX_BURST_RATIO = 0.5
#: Lower limit of the inner / outer diameter of the bladder.
MIN_BORE_RATIO = 0.3


#: Output / bound below which the margin is linear instead of logarithmic: a force may be negative.
MIN_LOG_RATIO = 0.1


def compute_margin(y, bounds, sense, scale):
    """Return the margins of outputs to bounds: ±ln(y / bound), nearly linear in logarithmic coordinates.

    Below a tenth of the bound the logarithm is continued by its tangent. For a bound of zero the margin is
    ±y / scale.
    """
    share = y / np.where(bounds > 0, bounds, 1.0)
    logarithm = np.log(np.maximum(share, MIN_LOG_RATIO)) + np.minimum(share / MIN_LOG_RATIO - 1, 0.0)
    return sense * np.where(bounds > 0, logarithm, y / scale)


def compute_margin_slope(y, bounds, scale):
    """Return the derivative of the margin with respect to the output, without the factor `sense`."""
    return np.where(
        bounds > 0, 1 / np.maximum(y, MIN_LOG_RATIO * np.where(bounds > 0, bounds, 1.0)), 1 / scale
    )


@dataclass(frozen=True)
class Requirement:
    """A requirement at one operating point or at several.

    Attributes:
        key: short name, unique in a spec, as "force 1".
        description: text, as "force at least 300 N at 10 % contraction".
        rows: indices of the outputs.
        bounds: bound of each output, SI.
        sense: +1 if the output must be at least its bound, −1 if at most.
        scale: SI; a distance of this size from a bound of zero is a margin of one.
        unit: unit of reports.
        stated: True if the spec states it, False if pamjax assumes it.
        is_safety_factor: whether it is a safety factor; the spec then states 1 / bound.
        fitting_length: length of both fittings, SI; the spec's bound includes it, the output does not.
    """

    key: str
    description: str
    rows: tuple[int, ...]
    bounds: tuple[float, ...]
    sense: int
    scale: float
    unit: str
    stated: bool = True
    is_safety_factor: bool = False
    fitting_length: float = 0.0

    def compute_margins(self, y: np.ndarray) -> np.ndarray:
        """Return the margins, (rows,) or (k, rows); negative if violated, see `compute_margin`."""
        return compute_margin(y[..., list(self.rows)], np.array(self.bounds), self.sense, self.scale)

    def format_amount(self, amount: float) -> str:
        """Return an amount in the unit of reports."""
        return format_quantity(amount, self.unit, 3)


@dataclass(frozen=True)
class SizingTask:
    """The operating points at which a candidate is evaluated, and the requirements on its outputs.

    Attributes:
        points: operating points, padded to `candidate.POINT_COUNT`.
        point_count: number of operating points without padding.
        labels: (point_count,) texts.
        loads: (point_count,) required force, N; NaN if none is required.
        requirements: all requirements.
    """

    points: OperatingPoints
    point_count: int
    labels: tuple[str, ...]
    loads: np.ndarray
    requirements: tuple[Requirement, ...]

    def find_requirement(self, key: str) -> Requirement | None:
        """Return the requirement with a key, or None if the spec has no such requirement."""
        return next((requirement for requirement in self.requirements if requirement.key == key), None)


@dataclass(frozen=True)
class _Point:
    label: str
    contraction: float = 0.0
    shortening: float = 0.0
    pressure: float | None = None
    load: float = math.nan


def build_task(spec: Spec) -> SizingTask:
    """Return the operating points and the requirements of a spec."""
    entries = spec.entries
    points = [_Point("at rest length and supply pressure", pressure=spec.supply)]
    for demand in entries.force:
        point = _Point(
            format_force_place(demand),
            demand.contraction or 0.0,
            demand.shortening or 0.0,
            demand.pressure,
            demand.at_least,
        )
        points.append(point)
    if entries.stroke:
        stroke, k = entries.stroke, entries.stroke.stiffness or 0.0
        for share in STROKE_SHARES:
            x = share * stroke.length
            required_force = (stroke.load or 0.0) + k * x
            points.append(
                _Point(f"after {format_quantity(x, 'mm')} of the stroke", shortening=x, load=required_force)
            )
    if entries.free_contraction is not None:
        free_contraction = entries.free_contraction
        points.append(
            _Point(f"at {100 * free_contraction:g} % contraction without load", free_contraction, load=0.0)
        )
    point_count = len(points)
    requirements = (
        *_require_forces(spec, points),
        *_list_stated_requirements(spec, point_count),
        *_list_assumed_requirements(spec, point_count),
    )
    padded_points = points + [points[1]] * (POINT_COUNT - point_count)
    return SizingTask(
        points=OperatingPoints(
            np.array([p.contraction for p in padded_points]),
            np.array([p.shortening for p in padded_points]),
            np.array([float(p.pressure is None) for p in padded_points]),
            np.array([p.pressure or 0.0 for p in padded_points]),
        ),
        point_count=point_count,
        labels=tuple(p.label for p in points),
        loads=np.array([p.load for p in points]),
        requirements=requirements,
    )


def _require_forces(spec: Spec, points: list[_Point]) -> list[Requirement]:
    entries = spec.entries
    positive_forces = [p.load for p in points if p.load > 0]
    # A required force of zero needs a scale: the supply pressure on an area of 1e-5 m².
    force_scale = max(positive_forces) if positive_forces else 1e-5 * spec.supply
    requirements = []
    for k, demand in enumerate(entries.force, 1):
        description = f"force at least {format_quantity(demand.at_least, 'N')} {format_force_place(demand)}"
        row = (locate_output("force", k),)
        requirements.append(
            Requirement(f"force {k}", description, row, (demand.at_least,), 1, demand.at_least, "N")
        )
    next_point = 1 + len(entries.force)
    if entries.stroke:
        rows = range(next_point, next_point + len(STROKE_SHARES))
        loads = tuple(points[k].load for k in rows)
        description = f"stroke {format_quantity(entries.stroke.length, 'mm')} {_format_load(spec)}"
        all_rows = tuple(locate_output("force", k) for k in rows)
        requirements.append(
            Requirement("stroke", description, all_rows, loads, 1, max(*loads, 0.1 * force_scale), "N")
        )
        next_point += len(STROKE_SHARES)
    if entries.free_contraction is not None:
        description = f"free contraction at least {100 * entries.free_contraction:g} %"
        row = (locate_output("force", next_point),)
        requirements.append(Requirement("free contraction", description, row, (0.0,), 1, force_scale, "N"))
    return requirements


def _format_load(spec: Spec) -> str:
    stroke = spec.entries.stroke
    assert stroke is not None
    parts = [f"load {format_quantity(stroke.load, 'N')}"] if stroke.load else []
    parts += [f"spring {format_quantity(stroke.stiffness, 'N/mm')}"] if stroke.stiffness else []
    return f"with {' and '.join(parts)}" if parts else "without load"


def _require_at_most(key: str, description: str, name: str, bound: float, unit: str, **more) -> Requirement:
    return Requirement(key, description, (locate_output(name),), (bound,), -1, bound, unit, **more)


def _list_stated_requirements(spec: Spec, point_count: int) -> list[Requirement]:
    """Return the limits that the spec states, and that of the supply pressure."""
    entries, envelope = spec.entries, spec.entries.envelope
    requirements = [
        _require_at_most(
            "supply",
            f"working pressure at most {format_quantity(spec.supply, 'kPa')}",
            "pressure",
            spec.supply,
            "kPa",
        )
    ]
    if envelope.length is not None:
        fitting_lengths = 2 * spec.fittings
        description = f"length at most {format_quantity(envelope.length, 'mm')}"
        requirements.append(
            _require_at_most(
                "length",
                description,
                "length",
                envelope.length - fitting_lengths,
                "mm",
                fitting_length=fitting_lengths,
            )
        )
    if envelope.diameter is not None:
        rows = tuple(locate_output("diameter", k) for k in range(point_count))
        suffix = " for each muscle" if max(entries.parallel) > 1 else ""
        description = f"diameter under pressure at most {format_quantity(envelope.diameter, 'mm')}{suffix}"
        bounds = (envelope.diameter,) * point_count
        requirements.append(Requirement("diameter", description, rows, bounds, -1, envelope.diameter, "mm"))
    if envelope.bundle is not None:
        requirements.append(
            _require_at_most(
                "bundle",
                f"diameter of the bundle at most {format_quantity(envelope.bundle, 'mm')}",
                "bundle",
                envelope.bundle,
                "mm",
            )
        )
    if entries.air is not None:
        requirements.append(
            _require_at_most(
                "air",
                f"air per stroke at most {format_quantity(entries.air, 'L')}",
                "air",
                entries.air,
                "L",
            )
        )
    for name in ("thread_length", "turns"):
        limits = getattr(entries.limits, name)
        unit = "mm" if name == "thread_length" else "1"
        if limits is not None:
            low, high = limits
            word = name.replace("_", " ")
            lower_text = f"{word} at least {format_quantity(low, unit)}"
            upper_text = f"{word} at most {format_quantity(high, unit)}"
            requirements.append(_require_at_least(f"least {word}", lower_text, name, low, unit, True))
            requirements.append(_require_at_most(f"most {word}", upper_text, name, high, unit))
    return requirements


def _list_assumed_requirements(spec: Spec, point_count: int) -> list[Requirement]:
    """Return the requirements of every muscle: safety factors, and the limits of the model."""
    safety, limits = spec.entries.safety, spec.entries.limits

    def require_safety(key: str, description: str, name: str) -> Requirement:
        factor, is_stated = getattr(safety, key), key in safety.model_fields_set
        text = f"safety factor at least {factor:g} {description}"
        return _require_everywhere(key, text, name, point_count, 1 / factor, -1, is_stated, True)

    slenderness = limits.slenderness
    return [
        require_safety("thread", "for thread strength", "used"),
        require_safety("mesh", "against bladder bulging", "mesh"),
        require_safety("rubber", "for rubber elongation", "strain"),
        _require_everywhere("fit", "threads fit side by side", "fit", point_count, 1.0, 1),
        _require_everywhere("burst", f"hoop pull at most {MAX_BURST_RATIO:g}"
                                     f" of thread stiffness", "burst", point_count, MAX_BURST_RATIO, -1),
        _require_at_least("bore", f"bore at least {MIN_BORE_RATIO:g} of the bladder's"
                                  f" outer diameter", "bore", MIN_BORE_RATIO),
        _require_at_least("slenderness", f"length at least {slenderness:g} times"
                                         f" the diameter", "slenderness", slenderness,
               stated="slenderness" in limits.model_fields_set),
    ]  # fmt: skip


def _require_everywhere(
    key, description, name, point_count, bound, sense, stated=False, is_safety_factor=False
) -> Requirement:
    """Return a requirement with the same bound at every operating point."""
    rows = tuple(locate_output(name, k) for k in range(point_count))
    return Requirement(
        key, description, rows, (bound,) * point_count, sense, bound, "1", stated, is_safety_factor
    )


def _require_at_least(
    key: str, description: str, name: str, bound: float, unit: str = "1", stated: bool = False
) -> Requirement:
    return Requirement(key, description, (locate_output(name),), (bound,), 1, bound, unit, stated)

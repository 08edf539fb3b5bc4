"""Requirements as rows: each an output of the candidate, a bound, and which side of it is right."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pamjax.sizing.candidate import POINT_COUNT, OperatingPoints, locate_output
from pamjax.sizing.spec import STROKE_SHARES, Spec, format_force_place
from pamjax.units import format_quantity

#: Pull of pressure over the stiffness of the threads, at most: at 1 they stretch without end.
MAX_BURST_RATIO = 0.5
#: Bore of the bladder over its outside, at least.
MIN_BORE_RATIO = 0.3


#: Share of its bound below which the room to it is no longer a logarithm: a force may be negative.
MIN_LOG_RATIO = 0.1


def compute_margin(y, bounds, sense, scale):
    """Room between outputs and bounds: ±ln(y / bound), nearly linear in logarithmic coordinates.

    Below a tenth of the bound the logarithm goes on as its tangent; for a bound of zero it is ±y / scale.
    """
    share = y / np.where(bounds > 0, bounds, 1.0)
    logarithm = np.log(np.maximum(share, MIN_LOG_RATIO)) + np.minimum(share / MIN_LOG_RATIO - 1, 0.0)
    return sense * np.where(bounds > 0, logarithm, y / scale)


def compute_margin_slope(y, bounds, scale):
    """Slope of the room in the output, but for its sense."""
    return np.where(
        bounds > 0, 1 / np.maximum(y, MIN_LOG_RATIO * np.where(bounds > 0, bounds, 1.0)), 1 / scale
    )


@dataclass(frozen=True)
class Requirement:
    """What must hold, at one place or at several.

    Attributes:
        key: short, unique in a spec, as "force 1".
        description: in words, as "pull 300 N at 10 %".
        rows: outputs that it is about.
        bounds: of each, SI.
        sense: +1 where the output must be at least its bound, −1 where at most.
        scale: SI; where the bound is zero a margin of one is this much room.
        unit: in which a person reads it.
        stated: whether the spec says so, or pamjax assumes it.
        is_safety_factor: whether it is a safety factor: 1 / bound is what the spec states.
        fitting_length: what the spec's bound holds besides the output, SI: the fittings.
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
        """(rows,) or (k, rows): room to each bound, see `compute_margin`; negative where it is broken."""
        return compute_margin(y[..., list(self.rows)], np.array(self.bounds), self.sense, self.scale)

    def format_amount(self, amount: float) -> str:
        """An amount of it, as a person reads it."""
        return format_quantity(amount, self.unit, 3)


@dataclass(frozen=True)
class SizingTask:
    """Where a candidate is asked, and what is required of the answers.

    Attributes:
        points: of the outputs.
        point_count: how many of them differ.
        labels: of the used places.
        loads: (used,) force wanted there, N; NaN where none is.
        requirements: of all.
    """

    points: OperatingPoints
    point_count: int
    labels: tuple[str, ...]
    loads: np.ndarray
    requirements: tuple[Requirement, ...]

    def find_requirement(self, key: str) -> Requirement | None:
        """The requirement of a key, or None where the spec has no such."""
        return next((requirement for requirement in self.requirements if requirement.key == key), None)


@dataclass(frozen=True)
class _Point:
    label: str
    contraction: float = 0.0
    shortening: float = 0.0
    pressure: float | None = None
    load: float = math.nan


def build_task(spec: Spec) -> SizingTask:
    """The places and the requirements of a spec."""
    entries = spec.entries
    points = [_Point("proof at rest", pressure=spec.supply)]
    for pull in entries.force:
        point = _Point(
            format_force_place(pull),
            pull.contraction or 0.0,
            pull.shortening or 0.0,
            pull.pressure,
            pull.at_least,
        )
        points.append(point)
    if entries.stroke:
        stroke, k = entries.stroke, entries.stroke.stiffness or 0.0
        for share in STROKE_SHARES:
            x = share * stroke.length
            wanted_force = (stroke.load or 0.0) + k * x
            points.append(
                _Point(f"after {format_quantity(x, 'mm')} of the stroke", shortening=x, load=wanted_force)
            )
    if entries.free_contraction is not None:
        free_contraction = entries.free_contraction
        points.append(_Point(f"free at {100 * free_contraction:g} %", free_contraction, load=0.0))
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
    # A force of nothing needs a scale of its own: a thousandth of a square decimetre under full pressure.
    force_scale = max(positive_forces) if positive_forces else 1e-5 * spec.supply
    requirements = []
    for k, pull in enumerate(entries.force, 1):
        description = f"pull {format_quantity(pull.at_least, 'N')} {format_force_place(pull)}"
        row = (locate_output("force", k),)
        requirements.append(
            Requirement(f"force {k}", description, row, (pull.at_least,), 1, pull.at_least, "N")
        )
    next_point = 1 + len(entries.force)
    if entries.stroke:
        rows = range(next_point, next_point + len(STROKE_SHARES))
        loads = tuple(points[k].load for k in rows)
        description = f"move {_format_load(spec)} by {format_quantity(entries.stroke.length, 'mm')}"
        all_rows = tuple(locate_output("force", k) for k in rows)
        requirements.append(
            Requirement("stroke", description, all_rows, loads, 1, max(*loads, 0.1 * force_scale), "N")
        )
        next_point += len(STROKE_SHARES)
    if entries.free_contraction is not None:
        description = f"contract by {100 * entries.free_contraction:g} % without load"
        row = (locate_output("force", next_point),)
        requirements.append(Requirement("free contraction", description, row, (0.0,), 1, force_scale, "N"))
    return requirements


def _format_load(spec: Spec) -> str:
    stroke = spec.entries.stroke
    assert stroke is not None
    parts = [format_quantity(stroke.load, "N")] if stroke.load else []
    parts += [f"a spring of {format_quantity(stroke.stiffness, 'N/mm')}"] if stroke.stiffness else []
    return " and ".join(parts) or "nothing"


def _require_at_most(key: str, description: str, name: str, bound: float, unit: str, **more) -> Requirement:
    return Requirement(key, description, (locate_output(name),), (bound,), -1, bound, unit, **more)


def _list_stated_requirements(spec: Spec, point_count: int) -> list[Requirement]:
    """Upper bounds that the spec states, and the supply."""
    entries, envelope = spec.entries, spec.entries.envelope
    requirements = [
        _require_at_most(
            "supply", f"work at {format_quantity(spec.supply, 'kPa')} at most", "pressure", spec.supply, "kPa"
        )
    ]
    if envelope.length is not None:
        fitting_lengths = 2 * (envelope.fittings or 0.0)
        description = f"be {format_quantity(envelope.length, 'mm')} long at most"
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
        suffix = ", each" if max(entries.parallel) > 1 else ""
        description = f"be {format_quantity(envelope.diameter, 'mm')} wide at most{suffix}, under pressure"
        bounds = (envelope.diameter,) * point_count
        requirements.append(Requirement("diameter", description, rows, bounds, -1, envelope.diameter, "mm"))
    if envelope.bundle is not None:
        requirements.append(
            _require_at_most(
                "bundle",
                f"fit into {format_quantity(envelope.bundle, 'mm')} together",
                "bundle",
                envelope.bundle,
                "mm",
            )
        )
    if entries.air is not None:
        requirements.append(
            _require_at_most(
                "air",
                f"take {format_quantity(entries.air, 'L')} of air a stroke at most",
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
            description = f"have a {word} of {{}} at {{}}"
            least, most = (
                description.format(format_quantity(low, unit), "least"),
                description.format(format_quantity(high, unit), "most"),
            )
            requirements.append(_require_at_least(f"least {word}", least, name, low, unit, True))
            requirements.append(_require_at_most(f"most {word}", most, name, high, unit))
    return requirements


def _list_assumed_requirements(spec: Spec, point_count: int) -> list[Requirement]:
    """What holds for every muscle: safety factors, and where the model itself holds."""
    safety, limits = spec.entries.safety, spec.entries.limits

    def require_safety(key: str, description: str, name: str) -> Requirement:
        times, stated = getattr(safety, key), key in safety.model_fields_set
        return _require_everywhere(
            key, description.format(f"{times:g}"), name, point_count, 1 / times, -1, stated, True
        )

    slenderness = limits.slenderness
    return [
        require_safety("thread", "threads {} times as strong as their load", "used"),
        require_safety("mesh", "bladder {} times from bulging through", "mesh"),
        require_safety("rubber", "rubber stretched to 1/{} of its break", "strain"),
        _require_everywhere("fit", "threads fit side by side", "fit", point_count, 1.0, 1),
        _require_everywhere("burst", "threads far from stretching"
                                     " without end", "burst", point_count, MAX_BURST_RATIO, -1),
        _require_at_least("bore", f"bore at least {MIN_BORE_RATIO:g} of the bladder's"
                                  f" outside", "bore", MIN_BORE_RATIO),
        _require_at_least("slenderness", f"at least {slenderness:g} times as long"
                                         f" as wide", "slenderness", slenderness,
               stated="slenderness" in limits.model_fields_set),
    ]  # fmt: skip


def _require_everywhere(
    key, description, name, point_count, bound, sense, stated=False, is_safety_factor=False
) -> Requirement:
    """The same bound at every place."""
    rows = tuple(locate_output(name, k) for k in range(point_count))
    return Requirement(
        key, description, rows, (bound,) * point_count, sense, bound, "1", stated, is_safety_factor
    )


def _require_at_least(
    key: str, description: str, name: str, bound: float, unit: str = "1", stated: bool = False
) -> Requirement:
    return Requirement(key, description, (locate_output(name),), (bound,), 1, bound, unit, stated)

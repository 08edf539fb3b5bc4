"""Requirements as rows: each an output of the candidate, a bound, and which side of it is right."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pamjax.sizing.candidate import PLACES, Places, index
from pamjax.sizing.spec import WAY, Spec, at_words
from pamjax.units import show

#: Pull of pressure over the stiffness of the threads, at most: at 1 they stretch without end.
MOST_BURST = 0.5
#: Bore of the bladder over its outside, at least.
LEAST_BORE = 0.3


#: Share of its bound below which the room to it is no longer a logarithm: a force may be negative.
TENTH = 0.1


def room(y, bounds, sense, scale):
    """Room between outputs and bounds: ±ln(y / bound), nearly linear in logarithmic coordinates.

    Below a tenth of the bound the logarithm goes on as its tangent; for a bound of zero it is ±y / scale.
    """
    share = y / np.where(bounds > 0, bounds, 1.0)
    logarithm = np.log(np.maximum(share, TENTH)) + np.minimum(share / TENTH - 1, 0.0)
    return sense * np.where(bounds > 0, logarithm, y / scale)


def steep(y, bounds, scale):
    """Slope of the room in the output, but for its sense."""
    return np.where(bounds > 0, 1 / np.maximum(y, TENTH * np.where(bounds > 0, bounds, 1.0)), 1 / scale)


@dataclass(frozen=True)
class Requirement:
    """What must hold, at one place or at several.

    Attributes:
        key: short, unique in a spec, as "force 1".
        says: in words, as "pull 300 N at 10 %".
        rows: outputs that it is about.
        bounds: of each, SI.
        sense: +1 where the output must be at least its bound, −1 where at most.
        scale: SI; where the bound is zero a margin of one is this much room.
        unit: in which a person reads it.
        stated: whether the spec says so, or pamjax assumes it.
        factor: whether it is a safety factor: 1 / bound is what the spec states.
        beside: what the spec's bound holds besides the output, SI: the fittings.
    """

    key: str
    says: str
    rows: tuple[int, ...]
    bounds: tuple[float, ...]
    sense: int
    scale: float
    unit: str
    stated: bool = True
    factor: bool = False
    beside: float = 0.0

    def margins(self, y: np.ndarray) -> np.ndarray:
        """(rows,) or (k, rows): room to each bound, see `room`; negative where it is broken."""
        return room(y[..., list(self.rows)], np.array(self.bounds), self.sense, self.scale)

    def shown(self, amount: float) -> str:
        """An amount of it, as a person reads it."""
        return show(amount, self.unit, 3)


@dataclass(frozen=True)
class Asked:
    """Where a candidate is asked, and what is required of the answers.

    Attributes:
        places: of the outputs.
        used: how many of them differ.
        labels: of the used places.
        loads: (used,) force wanted there, N; NaN where none is.
        requirements: of all.
    """

    places: Places
    used: int
    labels: tuple[str, ...]
    loads: np.ndarray
    requirements: tuple[Requirement, ...]

    def get(self, key: str) -> Requirement | None:
        """The requirement of a key, or None where the spec has no such."""
        return next((one for one in self.requirements if one.key == key), None)


@dataclass(frozen=True)
class _Place:
    label: str
    contraction: float = 0.0
    shortening: float = 0.0
    pressure: float | None = None
    load: float = math.nan


def ask(spec: Spec) -> Asked:
    """The places and the requirements of a spec."""
    words = spec.words
    places = [_Place("proof at rest", pressure=spec.supply)]
    for pull in words.force:
        at = _Place(
            at_words(pull), pull.contraction or 0.0, pull.shortening or 0.0, pull.pressure, pull.at_least
        )
        places.append(at)
    if words.stroke:
        stroke, k = words.stroke, words.stroke.stiffness or 0.0
        for share in WAY:
            x = share * stroke.length
            load = (stroke.load or 0.0) + k * x
            places.append(_Place(f"after {show(x, 'mm')} of the stroke", shortening=x, load=load))
    if words.free_contraction is not None:
        free = words.free_contraction
        places.append(_Place(f"free at {100 * free:g} %", free, load=0.0))
    used = len(places)
    requirements = (*_forces(spec, places), *_stated(spec, used), *_assumed(spec, used))
    filled = places + [places[1]] * (PLACES - used)
    return Asked(
        places=Places(
            np.array([p.contraction for p in filled]),
            np.array([p.shortening for p in filled]),
            np.array([float(p.pressure is None) for p in filled]),
            np.array([p.pressure or 0.0 for p in filled]),
        ),
        used=used,
        labels=tuple(p.label for p in places),
        loads=np.array([p.load for p in places]),
        requirements=requirements,
    )


def _forces(spec: Spec, places: list[_Place]) -> list[Requirement]:
    words = spec.words
    wanted = [p.load for p in places if p.load > 0]
    # A force of nothing needs a scale of its own: a thousandth of a square decimetre under full pressure.
    usual = max(wanted) if wanted else 1e-5 * spec.supply
    found = []
    for k, pull in enumerate(words.force, 1):
        says = f"pull {show(pull.at_least, 'N')} {at_words(pull)}"
        row = (index("force", k),)
        found.append(Requirement(f"force {k}", says, row, (pull.at_least,), 1, pull.at_least, "N"))
    first = 1 + len(words.force)
    if words.stroke:
        rows = range(first, first + len(WAY))
        loads = tuple(places[k].load for k in rows)
        says = f"move {_load(spec)} by {show(words.stroke.length, 'mm')}"
        all_rows = tuple(index("force", k) for k in rows)
        found.append(Requirement("stroke", says, all_rows, loads, 1, max(*loads, 0.1 * usual), "N"))
        first += len(WAY)
    if words.free_contraction is not None:
        says = f"contract by {100 * words.free_contraction:g} % without load"
        row = (index("force", first),)
        found.append(Requirement("free contraction", says, row, (0.0,), 1, usual, "N"))
    return found


def _load(spec: Spec) -> str:
    stroke = spec.words.stroke
    assert stroke is not None
    said = [show(stroke.load, "N")] if stroke.load else []
    said += [f"a spring of {show(stroke.stiffness, 'N/mm')}"] if stroke.stiffness else []
    return " and ".join(said) or "nothing"


def _most(key: str, says: str, name: str, bound: float, unit: str, **more) -> Requirement:
    return Requirement(key, says, (index(name),), (bound,), -1, bound, unit, **more)


def _stated(spec: Spec, used: int) -> list[Requirement]:
    """Upper bounds that the spec states, and the supply."""
    words, room = spec.words, spec.words.envelope
    found = [_most("supply", f"work at {show(spec.supply, 'kPa')} at most", "pressure", spec.supply, "kPa")]
    if room.length is not None:
        ends = 2 * (room.fittings or 0.0)
        says = f"be {show(room.length, 'mm')} long at most"
        found.append(_most("length", says, "length", room.length - ends, "mm", beside=ends))
    if room.diameter is not None:
        rows = tuple(index("diameter", k) for k in range(used))
        each = ", each" if max(words.parallel) > 1 else ""
        says = f"be {show(room.diameter, 'mm')} wide at most{each}, under pressure"
        bounds = (room.diameter,) * used
        found.append(Requirement("diameter", says, rows, bounds, -1, room.diameter, "mm"))
    if room.bundle is not None:
        found.append(
            _most("bundle", f"fit into {show(room.bundle, 'mm')} together", "bundle", room.bundle, "mm")
        )
    if words.air is not None:
        found.append(
            _most("air", f"take {show(words.air, 'L')} of air a stroke at most", "air", words.air, "L")
        )
    for name in ("thread_length", "turns"):
        limits = getattr(words.limits, name)
        unit = "mm" if name == "thread_length" else "1"
        if limits is not None:
            low, high = limits
            word = name.replace("_", " ")
            says = f"have a {word} of {{}} at {{}}"
            least, most = says.format(show(low, unit), "least"), says.format(show(high, unit), "most")
            found.append(_least(f"least {word}", least, name, low, unit, True))
            found.append(_most(f"most {word}", most, name, high, unit))
    return found


def _assumed(spec: Spec, used: int) -> list[Requirement]:
    """What holds for every muscle: safety factors, and where the model itself holds."""
    safety, limits = spec.words.safety, spec.words.limits

    def factor(key: str, says: str, name: str) -> Requirement:
        times, said = getattr(safety, key), key in safety.model_fields_set
        return _each(key, says.format(f"{times:g}"), name, used, 1 / times, -1, said, True)

    slender = limits.slenderness
    return [
        factor("thread", "threads {} times as strong as their load", "used"),
        factor("mesh", "bladder {} times from bulging through", "mesh"),
        factor("rubber", "rubber stretched to 1/{} of its break", "strain"),
        _each("fit", "threads fit side by side", "fit", used, 1.0, 1),
        _each("burst", "threads far from stretching without end", "burst", used, MOST_BURST, -1),
        _least("bore", f"bore at least {LEAST_BORE:g} of the bladder's outside", "bore", LEAST_BORE),
        _least("slenderness", f"at least {slender:g} times as long as wide", "slenderness", slender,
               stated="slenderness" in limits.model_fields_set),
    ]  # fmt: skip


def _each(key, says, name, used, bound, sense, stated=False, factor=False) -> Requirement:
    """The same bound at every place."""
    rows = tuple(index(name, k) for k in range(used))
    return Requirement(key, says, rows, (bound,) * used, sense, bound, "1", stated, factor)


def _least(
    key: str, says: str, name: str, bound: float, unit: str = "1", stated: bool = False
) -> Requirement:
    return Requirement(key, says, (index(name),), (bound,), 1, bound, unit, stated)

"""Test protocols: pressure and length of a bench over time, and their TOML file."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pamjax.errors import BadInput, suggest_word
from pamjax.records.files import read_bytes
from pamjax.records.reading import toml_errors
from pamjax.records.reading.quantity import EntryLocation, read_load
from pamjax.records.toml_text import parse_toml
from pamjax.units import parse_quantity


@dataclass(frozen=True, eq=False)
class Schedule:
    """Pressure and length at every sample.

    Attributes:
        time: (n,) s.
        pressure: (n,) gauge, Pa.
        length: (n,) m.
        cycle: (n,) number of the stroke, ramp or hold.
        diameter_measured: (n,) bool, whether the diameter is measured at this sample.
        load: (n,) set force, N, if the length follows from it; None if the length is set.
    """

    time: np.ndarray
    pressure: np.ndarray
    length: np.ndarray
    cycle: np.ndarray
    diameter_measured: np.ndarray
    load: np.ndarray | None = None


#: Largest number of samples of a protocol.
_MAX_SAMPLES = 1_000_000

#: Remedy for a wrong entry.
_KEY_HINTS = {
    "kind": 'Write "strokes", "ramps" or "holds".',
    "pressures": 'Write a list, as ["100 kPa", "3 bar"].',
    "loads": 'Write a list, as ["0 N", "2 kgf"].',
    "contractions": "Write a list of shares of the rest length, as [0.1, 0.2].",
    "speed": 'Write a number and its unit, as "1 mm/s".',
    "duration": 'Write a number and its unit, as "10 s".',
    "rate": 'Write a number and its unit, as "1 Hz".',
}


class Protocol(BaseModel):
    """A protocol as in a TOML file, table `[protocol]`.

    Attributes:
        kind: "strokes" moves the length at each pressure; "ramps" fills and vents at each length; "holds"
            keeps each pair of pressure and length constant.
        pressures: the pressures with units; for "ramps" the maximum of each ramp.
        contractions: 1 − length/rest length; for "strokes" the maximum of each stroke (one number, or
            one for each pressure).
        loads: the set forces of an isotonic test, with units, in place of `contractions`; only for "ramps".
        cycles: number of strokes or ramps at each pressure or length.
        speed: speed of a stroke, with its unit.
        duration: duration of a ramp up or of a hold, with its unit.
        rate: sampling rate, as "1 Hz".
        diameter_every: samples from one diameter measurement to the next; 0 for no diameter.
    """

    model_config = ConfigDict(extra="forbid")

    kind: Literal["strokes", "ramps", "holds"]
    pressures: Annotated[list[str], Field(min_length=1)]
    contractions: list[Annotated[float, Field(gt=-0.2, lt=0.9)]] = Field(default_factory=list, min_length=1)
    loads: list[str] = Field(default_factory=list, min_length=1)
    cycles: Annotated[int, Field(ge=1, le=1000)] = 3
    speed: str = "1 mm/s"
    duration: str = "10 s"
    rate: str = "1 Hz"
    diameter_every: Annotated[int, Field(ge=0)] = 1

    def build_schedule(self, rest_length: float) -> Schedule:
        """Return the schedule for a muscle of this rest length, m.

        Raises:
            BadInput: for a wrong unit, a negative pressure, or a wrong number of contractions.
        """
        where = "[protocol]"
        self._check_set_channel(where)
        pressures = [parse_quantity(p, "pressure", where) for p in self.pressures]
        speed, duration = (
            parse_quantity(self.speed, "speed", where),
            parse_quantity(self.duration, "time", where),
        )
        step = 1 / _check_positive("rate", parse_quantity(self.rate, "frequency", where))
        for p in pressures:
            if p < 0:
                raise BadInput.from_rule(
                    "`pressures` must be gauge pressures of at least 0",
                    f"{p / 1e3:g} kPa",
                    where,
                    "Check the sign.",
                )
        _check_size(self._compute_duration(rest_length, len(pressures), speed, duration) / step)
        pieces = {"strokes": self._build_strokes, "ramps": self._build_ramps, "holds": self._build_holds}[
            self.kind
        ](
            np.array(pressures),
            rest_length,
            _check_positive("speed", speed),
            _check_positive("duration", duration),
            step,
        )
        schedule = _join_pieces(pieces, step, self.diameter_every)
        if not self.loads:
            return schedule
        loads = [read_load(load, EntryLocation("loads", where)) for load in self.loads]
        return replace(schedule, load=np.repeat(loads, schedule.time.size // len(loads)))

    def _check_set_channel(self, where: str) -> None:
        """Refuse a protocol without a set length or force, or with both."""
        if bool(self.contractions) == bool(self.loads):
            got = "both" if self.loads else "neither"
            remedy = "The first list sets the length, the second the force."
            raise BadInput.from_rule("a protocol must have `contractions` or `loads`", got, where, remedy)
        if self.loads and self.kind != "ramps":
            raise BadInput.from_rule(
                "`loads` need the kind `ramps`", f"`{self.kind}`", where, 'Write kind = "ramps".'
            )

    def _compute_duration(self, rest: float, pressures: int, speed: float, duration: float) -> float:
        """Return the duration of the protocol, s."""
        _check_positive("speed", speed)
        repeats = {"strokes": pressures * self.cycles, "ramps": pressures * self.cycles, "holds": pressures}
        longest_stroke = 2 * rest * max(map(abs, self.contractions), default=0.0) / speed
        each = longest_stroke if self.kind == "strokes" else duration * len(self.contractions or self.loads)
        return repeats[self.kind] * each * (2 if self.kind == "ramps" else 1)

    def _build_strokes(self, pressures, rest, speed, duration, step):
        max_contractions = self.contractions * (len(pressures) if len(self.contractions) == 1 else 1)
        if len(max_contractions) != len(pressures):
            raise BadInput.from_rule(
                "`contractions` of strokes must have one number, or one for each pressure",
                f"{len(max_contractions)} for {len(pressures)} pressures",
                "[protocol]",
                "Check the number of entries of both lists.",
            )
        for pressure, contraction in zip(pressures, max_contractions, strict=True):
            cycle_contraction = contraction * _build_ramp_cycle(rest * abs(contraction) / speed, step)
            for cycle in range(self.cycles):
                yield np.full(cycle_contraction.size, pressure), rest * (1 - cycle_contraction), cycle + 1

    def _build_ramps(self, pressures, rest, speed, duration, step):
        cycle_share = _build_ramp_cycle(duration, step)
        for contraction in self.contractions or [0.0] * len(self.loads):
            for cycle, pressure in enumerate(np.tile(pressures, self.cycles)):
                yield pressure * cycle_share, np.full(cycle_share.size, rest * (1 - contraction)), cycle + 1

    def _build_holds(self, pressures, rest, speed, duration, step):
        size = max(round(duration / step), 1)
        for pressure in pressures:
            for cycle, contraction in enumerate(self.contractions):
                yield np.full(size, pressure), np.full(size, rest * (1 - contraction)), cycle + 1


def _build_ramp_cycle(duration: float, step: float) -> np.ndarray:
    """Return a ramp from 0 to 1 and back; the duration of each is rounded up to whole steps."""
    up = np.linspace(0.0, 1.0, max(math.ceil(duration / step - 1e-9), 1) + 1)
    return np.concatenate([up, up[-2::-1]])


def _check_size(samples: float) -> None:
    """Refuse a schedule that is too long to simulate, before its arrays are made."""
    if not samples <= _MAX_SAMPLES:
        rule = f"a protocol must have at most {_MAX_SAMPLES} samples"
        raise BadInput.from_rule(
            rule, f"{samples:.3g}", "[protocol]", "Reduce `rate`, `duration` or `cycles`."
        )


def _check_positive(name: str, value: float) -> float:
    if value <= 0:
        raise BadInput.from_rule(f"`{name}` must be positive", f"{value:g}", "[protocol]")
    return value


def _join_pieces(pieces, step: float, every: int) -> Schedule:
    pieces = list(pieces)
    pressure = np.concatenate([p for p, _, _ in pieces])
    cycle = np.concatenate([np.full(p.size, c) for p, _, c in pieces])
    n = pressure.size
    diameter_measured = np.arange(n) % every == 0 if every else np.zeros(n, dtype=bool)
    length = np.concatenate([x for _, x, _ in pieces])
    return Schedule(step * np.arange(n), pressure, length, cycle, diameter_measured)


def read_protocol(path: Path) -> Protocol:
    """Return the protocol of a TOML file.

    Raises:
        BadInput: if the file is missing or not TOML, or if an entry is invalid.
    """
    document = parse_toml(read_bytes(path), path.name)
    if set(document) != {"protocol"}:
        raise BadInput.from_rule(
            "a protocol must have one table, [protocol]",
            ", ".join(document) or "none",
            path.name,
            "Write [protocol] above all entries.",
        )
    try:
        return Protocol.model_validate(document["protocol"])
    except ValidationError as error:
        first = error.errors()[0]
        key = str(first["loc"][0])
        if first["type"] == "extra_forbidden":
            hint = suggest_word(key, Protocol.model_fields)
            raise BadInput.from_rule(
                f"unknown entry `{key}` in [protocol]", where=path.name, remedy=hint
            ) from error
        hint = "" if first["type"] == "literal_error" else _KEY_HINTS.get(key, "")
        raise BadInput.from_rule(
            toml_errors.format_rule(first, key), toml_errors.format_input(first), path.name, hint
        ) from error


#: The protocol of the paper: ten isobars, three strokes each at 1 mm/s, one photograph per second.
#: The strokes end at the free contraction of the paper's muscle, rounded down to a hundredth.
PAPER_PROTOCOL = Protocol(
    kind="strokes",
    pressures=[f"{10 * k} psi" for k in range(1, 11)],
    contractions=[0.38] * 10,
    cycles=3,
)

"""Means: what a rig can do, how well it measures, and for how long it is there."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pamjax.errors import nearest, refuse
from pamjax.model.parameters import RULER
from pamjax.records.files import decode, read_bytes
from pamjax.records.reading.muscle_toml import Entry
from pamjax.units import number_in, parse

#: What a zero or a gain may be off by, and how much the rig may give, where it does not say: a bench of
#: 20 kN/mm that was calibrated some time ago. Numbers of the plan like any other, and priors of a fit.
USUAL = {
    "force_offset.offset": 5.0,
    "force_gain.gain": 0.01,
    "pressure_offset.offset": 3e3,
    "pressure_gain.gain": 0.01,
    "length_offset.offset": 2e-4,
    "diameter_offset.offset": 3e-4,
    "rig_compliance.compliance": 5e-8,
}

#: Their names in a rig's file, with their units.
WORDS = {
    "force_zero": ("force_offset.offset", "N"),
    "force_gain": ("force_gain.gain", "1"),
    "pressure_zero": ("pressure_offset.offset", "Pa"),
    "pressure_gain": ("pressure_gain.gain", "1"),
    "length_zero": ("length_offset.offset", "m"),
    "diameter_zero": ("diameter_offset.offset", "m"),
    "give": ("rig_compliance.compliance", "m/N"),
}

#: Its other entries, with their kinds.
KINDS = {
    "pressure": "pressure", "speed": "speed", "rate": "frequency", "minutes": "count", "setup": "time",
    "correlation_time": "time", "contraction": "count", "force": "force", "diameter": "length",
    "gauge": "pressure", "ruler": "length",
}  # fmt: skip


#: No muscle contracts so far.
DEEPEST = 0.9


@dataclass(frozen=True)
class Means:
    """What a rig can do.

    Attributes:
        pressure: highest, Pa.
        contraction: largest.
        speed: of a stroke, m/s.
        rate: samples a second.
        minutes: that it is there for.
        setup: between two runs, s.
        correlation_time: of the noise, s.
        force, diameter: noise of one sample, N and m; None where the channel is not there.
        gauge, ruler: noise of one sample of pressure and length, Pa and m.
        setting: error of each length that is set, one for all samples there, m; 0 where there is none.
        off: standard deviation of zeros, gains and give, SI, by name of the number.
    """

    pressure: float = 600e3
    contraction: float = 0.3
    speed: float = 1e-3
    rate: float = 1.0
    minutes: float = 60.0
    setup: float = 30.0
    correlation_time: float = 0.0
    force: float | None = 2.0
    diameter: float | None = 1e-4
    gauge: float = 700.0
    ruler: float = 2e-5
    setting: float = 0.0
    off: dict[str, float] = field(default_factory=lambda: dict(USUAL))

    @property
    def assumed(self) -> dict[str, float]:
        """Standard deviations of the rig's own numbers, SI; the error of each set length among them."""
        return self.off | ({f"{RULER}each": self.setting} if self.setting else {})

    @property
    def worth(self) -> float:
        """How many independent samples one is worth: (1 − ρ) / (1 + ρ) for what changes slowly."""
        from math import exp

        rho = exp(-1 / (self.rate * self.correlation_time)) if self.correlation_time > 0 else 0.0
        return (1 - rho) / (1 + rho)

    def alone(self, channel: str) -> Means:
        """The same rig with one channel only, "force" or "diameter"."""
        other = {"force": "diameter", "diameter": "force"}[channel]
        return replace(self, **{other: None})

    @property
    def channels(self) -> tuple[str, ...]:
        """What is measured beside pressure and length."""
        return tuple(c for c in ("force", "diameter") if getattr(self, c) is not None)


def means_of(
    entry: Entry,
    rig: Path | None = None,
    recorded: tuple[str, ...] = ("force", "diameter"),
    highest: float | None = None,
    **said: Any,
) -> Means:
    """What a rig can do, from its file, else from the sensors of muscle.toml, else as usual.

    Lengths with one error per setting in muscle.toml have it on this rig too, and no noise of a sample. A
    `ruler` in the rig's file is the noise of a sample, and takes its place.

    Args:
        entry: what muscle.toml says.
        rig: a TOML file with a table [rig], as `pressure = "690 kPa"`, `force = "2 N"` (noise of a sample),
            `diameter = "none"`, `force_zero = "5 N"`, `minutes = 60`.
        recorded: channels of what this rig has recorded so far: it has no other, unless one is stated.
        highest: pressure of what it has recorded so far, Pa: the muscle is not asked for more, unless
            that is stated.
        said: entries that override the file's.

    Raises:
        BadInput: for an unknown entry, a wrong unit, or a rig that measures nothing.
    """
    sensors = entry.sensors
    known = {
        "force": sensors.force, "diameter": sensors.diameter,
        "gauge": sensors.pressure, "pressure": highest,
        "setting" if sensors.length_per_setting else "ruler": sensors.length,
    }  # fmt: skip
    absent = dict.fromkeys({"force", "diameter"} - set(recorded))
    found = replace(Means(), **absent | {name: value for name, value in known.items() if value})
    written = (_read(rig) if rig else {}) | {k: v for k, v in said.items() if v is not None}
    found = replace(found, setting=0.0) if "ruler" in written else found
    found = replace(found, ruler=0.0) if found.setting else found
    file, off, plain = rig.name if rig else "the rig", dict(found.off), {}
    for name, value in written.items():
        if name in WORDS:
            number, unit = WORDS[name]
            if unit != "1" and not isinstance(value, str):
                raise refuse(f"`{name}` of a rig needs a unit", str(value), file, f'Write "{value} {unit}".')
            off[number] = number_in(str(value), unit, f"{name} of {file}")
        elif name in KINDS:
            plain[name] = _plain(name, value, file)
        else:
            raise refuse(f"a rig has no entry {name!r}", where=file, remedy=nearest(name, [*WORDS, *KINDS]))
    found = replace(found, off={name: sd for name, sd in off.items() if sd > 0}, **plain)
    if not found.channels:
        raise refuse("a rig measures force or diameter", "neither", file, "Name the noise of one.")
    return found


def _plain(name: str, value: Any, file: str) -> float | None:
    if name in ("force", "diameter") and value == "none":
        return None
    if name == "contraction" and str(value).strip().endswith("%"):
        value = float(parse(str(value).strip().removesuffix("%"), "count", f"{name} of {file}")) / 100
    if name == "minutes" and isinstance(value, str):
        value = parse(value, "time", f"{name} of {file}") / 60
    number = parse(value, KINDS[name], f"{name} of {file}")
    if name == "contraction" and number >= DEEPEST:
        raise refuse(f"`contraction` of a rig is a share below {DEEPEST:g}", f"{value}", file)
    if number < 0 or (number == 0 and name not in ("setup", "correlation_time")):
        raise refuse(f"`{name}` of a rig must be positive", f"{value}", file)
    return number


def _read(path: Path) -> dict[str, Any]:
    try:
        written = tomllib.loads(decode(read_bytes(path), path.name))
    except tomllib.TOMLDecodeError as error:
        raise refuse("a rig is a TOML file", str(error), path.name) from error
    if set(written) != {"rig"} or not isinstance(written["rig"], dict):
        raise refuse("a rig has one table, [rig]", ", ".join(written) or "none", path.name)
    return written["rig"]

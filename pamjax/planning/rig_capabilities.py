"""Capabilities of a test rig: limits, speed, sensor noise, errors of zeros and gains, available time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.diagnosis.next_experiment.rig import compute_usual_load
from pamjax.errors import BadInput, suggest_word
from pamjax.model.parameters import LENGTH_ERROR_PREFIX
from pamjax.records.files import read_bytes
from pamjax.records.reading.muscle_toml import MuscleToml
from pamjax.records.toml_text import parse_toml
from pamjax.units import parse_number, parse_quantity

#: Default standard deviations of sensor zeros, sensor gains and rig compliance, SI: a bench of 20 kN/mm that
#: was not calibrated recently. They are unknown parameters of the plan, and priors of a fit.
DEFAULT_ERROR_SDS = {
    "force_offset.offset": 5.0,
    "force_gain.gain": 0.01,
    "pressure_offset.offset": 3e3,
    "pressure_gain.gain": 0.01,
    "length_offset.offset": 2e-4,
    "diameter_offset.offset": 3e-4,
    "rig_compliance.compliance": 5e-8,
}

#: Names of these parameters in a rig file, with their units.
ERROR_ENTRIES = {
    "force_zero": ("force_offset.offset", "N"),
    "force_gain": ("force_gain.gain", "1"),
    "pressure_zero": ("pressure_offset.offset", "Pa"),
    "pressure_gain": ("pressure_gain.gain", "1"),
    "length_zero": ("length_offset.offset", "m"),
    "diameter_zero": ("diameter_offset.offset", "m"),
    "give": ("rig_compliance.compliance", "m/N"),
}

#: Other entries of a rig file, with their kinds of quantity.
ENTRY_KINDS = {
    "pressure": "pressure", "speed": "speed", "rate": "frequency", "minutes": "count", "setup": "time",
    "correlation_time": "time", "contraction": "count", "force": "force", "diameter": "length",
    "gauge": "pressure", "ruler": "length", "load": "force",
}  # fmt: skip

#: Fields of `RigCapabilities` for the entries of a rig file; the other entries have the name of their field.
_FIELDS = {
    "pressure": "max_pressure", "contraction": "max_contraction", "setup": "setup_seconds",
    "force": "force_sd", "diameter": "diameter_sd", "gauge": "pressure_sd", "ruler": "length_sd",
    "load": "max_load",
}  # fmt: skip

#: Entries that only a rig with a measured force has, and those that only an isotonic rig has.
_FORCE_RIG_ENTRIES, _ISOTONIC_RIG_ENTRIES = ("contraction", "speed", "force_zero", "force_gain"), ("load",)

#: Default standard deviations of one sample by channel, SI.
DEFAULT_CHANNEL_SDS = {"force": 2.0, "diameter": 1e-4}

#: Upper limit of contraction: no muscle contracts this far.
_MAX_RIG_CONTRACTION = 0.9

#: Number of set forces of an isotonic rig.
_LOAD_LEVELS = 3


@dataclass(frozen=True)
class RigCapabilities:
    """Capabilities of a test rig.

    Attributes:
        max_pressure: highest pressure, Pa.
        max_contraction: largest contraction, a fraction.
        speed: speed of a stroke, m/s.
        rate: sampling rate, Hz.
        minutes: available time, min.
        setup_seconds: time between two runs, s.
        correlation_time: correlation time of the noise, s.
        force_sd, diameter_sd: standard deviation of one sample, N and m; None without this channel. On an
            isotonic rig, `force_sd` is that of the set force; None if it is exact.
        pressure_sd, length_sd: standard deviation of one sample of pressure and length, Pa and m.
        length_level_sd: standard deviation of each set length, common to all its samples, m; 0 for none.
        error_sds: standard deviation of zeros, gains and compliance, SI, by parameter name.
        load: smallest set force of an isotonic rig, N; None if the rig sets the length and measures the
            force.
        max_load: largest set force of an isotonic rig, N.
    """

    max_pressure: float = 600e3
    max_contraction: float = 0.3
    speed: float = 1e-3
    rate: float = 1.0
    minutes: float = 60.0
    setup_seconds: float = 30.0
    correlation_time: float = 0.0
    force_sd: float | None = DEFAULT_CHANNEL_SDS["force"]
    diameter_sd: float | None = DEFAULT_CHANNEL_SDS["diameter"]
    pressure_sd: float = 700.0
    length_sd: float = 2e-5
    length_level_sd: float = 0.0
    error_sds: dict[str, float] = field(default_factory=lambda: dict(DEFAULT_ERROR_SDS))
    load: float | None = None
    max_load: float = 0.0

    @property
    def measures_length(self) -> bool:
        """Return whether the rig sets the force and measures the length (isotonic test)."""
        return self.load is not None

    @property
    def loads(self) -> np.ndarray:
        """Return the set forces of the runs of an isotonic rig, N."""
        return np.unique(np.linspace(min(self.load or 0.0, self.max_load), self.max_load, _LOAD_LEVELS))

    @property
    def assumed_sds(self) -> dict[str, float]:
        """Return the standard deviations of the rig's parameters, SI, with that of a set length."""
        return self.error_sds | (
            {f"{LENGTH_ERROR_PREFIX}each": self.length_level_sd} if self.length_level_sd else {}
        )

    @property
    def independent_share(self) -> float:
        """Return the number of independent samples per sample, (1 − ρ) / (1 + ρ) for AR(1) noise."""
        from math import exp

        rho = exp(-1 / (self.rate * self.correlation_time)) if self.correlation_time > 0 else 0.0
        return (1 - rho) / (1 + rho)

    def keep_channel(self, channel: str) -> RigCapabilities:
        """Return the rig with one channel only, "force" (or "length" on an isotonic rig) or "diameter"."""
        first, second = self.model_channels
        return replace(self, **{_FIELDS[second if channel == first else first]: None})

    @property
    def model_channels(self) -> tuple[str, str]:
        """Return the channels that a model predicts: force, or length on an isotonic rig, and diameter."""
        return ("length" if self.measures_length else "force", "diameter")

    @property
    def channel_sds(self) -> dict[str, float | None]:
        """Return the standard deviation of one sample by channel, SI; None for an absent channel."""
        first_sd = self.length_sd if self.measures_length else self.force_sd
        return {self.model_channels[0]: first_sd, "diameter": self.diameter_sd}

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the measured channels that a model predicts."""
        return tuple(channel for channel, sd in self.channel_sds.items() if sd is not None)


def read_capabilities(
    muscle_toml: MuscleToml,
    rig: Path | None = None,
    recorded_channels: tuple[str, ...] | None = None,
    max_recorded_pressure: float | None = None,
    recorded_loads: tuple[float, float] | None = None,
    **overrides: Any,
) -> RigCapabilities:
    """Return the capabilities of a rig: from its file, else from the sensors of muscle.toml, else defaults.

    If muscle.toml states one length error for each level, it is also valid for this rig, and length has no
    noise of a sample. A `ruler` in the rig file is the noise of a sample and replaces that error.

    If `[test]` of muscle.toml states a measured length, the rig is isotonic: it sets the force. It can add a
    weight that the muscle can lift, unless `load` in the rig file states another limit.

    Args:
        muscle_toml: content of muscle.toml.
        rig: TOML file with a table [rig], such as `pressure = "690 kPa"`, `force = "2 N"` (noise of a
            sample), `diameter = "none"`, `force_zero = "5 N"`, `minutes = 60`.
        recorded_channels: channels of the existing recording; the rig has only these, unless others are
            stated. None is force and diameter, and length on an isotonic rig.
        max_recorded_pressure: highest pressure of the existing recording, Pa; upper limit, unless another
            one is stated.
        recorded_loads: smallest and largest set force of an existing isotonic recording, N.
        overrides: entries that replace those of the file, by their names in the file.

    Raises:
        BadInput: for an unknown entry, one of another kind of rig, a wrong unit, or a rig without force and
            diameter.
    """
    sensors = muscle_toml.sensors
    if recorded_channels is None:
        recorded_channels = ("length",) if muscle_toml.measures_length else ("force", "diameter")
    stated_fields = {
        "force_sd": sensors.force, "diameter_sd": sensors.diameter,
        "pressure_sd": sensors.pressure, "max_pressure": max_recorded_pressure,
        "length_level_sd" if sensors.length_per_level else "length_sd": sensors.length,
    }  # fmt: skip
    absent_channels = dict.fromkeys(_FIELDS[c] for c in ("force", "diameter") if c not in recorded_channels)
    capabilities = replace(
        RigCapabilities(),
        **absent_channels | {name: value for name, value in stated_fields.items() if value},
    )
    rig_entries = (_read_rig_file(rig) if rig else {}) | {k: v for k, v in overrides.items() if v is not None}
    capabilities = replace(capabilities, length_level_sd=0.0) if "ruler" in rig_entries else capabilities
    capabilities = replace(capabilities, length_sd=0.0) if capabilities.length_level_sd else capabilities
    file, error_sds, plain_fields = rig.name if rig else "the rig", dict(capabilities.error_sds), {}
    _check_kind_of_rig(rig_entries, muscle_toml.measures_length, file)
    for name, value in rig_entries.items():
        if name in ERROR_ENTRIES:
            parameter, unit = ERROR_ENTRIES[name]
            if unit != "1" and not isinstance(value, str):
                raise BadInput.from_rule(
                    f"rig entry `{name}` needs a unit", str(value), file, f'Write "{value} {unit}".'
                )
            error_sds[parameter] = parse_number(str(value), unit, f"{name} of {file}")
        elif name in ENTRY_KINDS:
            plain_fields[_FIELDS.get(name, name)] = _parse_entry(name, value, file)
        else:
            raise BadInput.from_rule(
                f"unknown rig entry {name!r}",
                where=file,
                remedy=suggest_word(name, [*ERROR_ENTRIES, *ENTRY_KINDS]),
            )
    capabilities = replace(
        capabilities, error_sds={name: sd for name, sd in error_sds.items() if sd > 0}, **plain_fields
    )
    if muscle_toml.measures_length:
        capabilities = _set_loads(capabilities, muscle_toml, recorded_loads, "load" in rig_entries)
    if not capabilities.channels:
        raise BadInput.from_rule(
            "a rig must measure force or diameter", "neither", file, "State the noise of one."
        )
    return capabilities


def _check_kind_of_rig(rig_entries: Iterable[str], measures_length: bool, file: str) -> None:
    """Refuse entries of another kind of rig."""
    foreign_entries = _FORCE_RIG_ENTRIES if measures_length else _ISOTONIC_RIG_ENTRIES
    for name in rig_entries:
        if name in foreign_entries:
            kind = "sets the force" if measures_length else "measures the force"
            remedy = "Remove it, or check [test] of muscle.toml."
            rule = f"rig entry `{name}` has no meaning on a rig that {kind}"
            raise BadInput.from_rule(rule, where=file, remedy=remedy)


def _set_loads(
    capabilities: RigCapabilities,
    muscle_toml: MuscleToml,
    recorded_loads: tuple[float, float] | None,
    is_limited: bool,
) -> RigCapabilities:
    """Return the isotonic rig with its set forces."""
    smallest, largest = recorded_loads or (muscle_toml.load or 0.0,) * 2
    usual = compute_usual_load(muscle_toml, capabilities.max_pressure)
    max_load = capabilities.max_load if is_limited else max(largest, usual)
    error_sds = {n: sd for n, sd in capabilities.error_sds.items() if not n.startswith("force_")}
    return replace(capabilities, load=min(smallest, max_load), max_load=max_load, error_sds=error_sds)


def _parse_entry(name: str, value: Any, file: str) -> float | None:
    if name in ("force", "diameter") and value == "none":
        return None
    if name == "contraction" and str(value).strip().endswith("%"):
        value = (
            float(parse_quantity(str(value).strip().removesuffix("%"), "count", f"{name} of {file}")) / 100
        )
    if name == "minutes" and isinstance(value, str):
        value = parse_quantity(value, "time", f"{name} of {file}") / 60
    quantity = parse_quantity(value, ENTRY_KINDS[name], f"{name} of {file}")
    if name == "contraction" and quantity >= _MAX_RIG_CONTRACTION:
        raise BadInput.from_rule(
            f"rig entry `contraction` must be a fraction below {_MAX_RIG_CONTRACTION:g}",
            f"{value}",
            file,
            'Write 0.3 or "30 %".',
        )
    if quantity < 0 or (quantity == 0 and name not in ("setup", "correlation_time", "load")):
        raise BadInput.from_rule(f"rig entry `{name}` must be positive", f"{value}", file)
    return quantity


def _read_rig_file(path: Path) -> dict[str, Any]:
    document = parse_toml(read_bytes(path), path.name)
    if set(document) != {"rig"} or not isinstance(document["rig"], dict):
        raise BadInput.from_rule(
            "a rig file must have one table, [rig]",
            ", ".join(document) or "none",
            path.name,
            "Write [rig] above all entries.",
        )
    return document["rig"]

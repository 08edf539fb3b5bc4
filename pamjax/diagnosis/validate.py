"""Hold a model against a recording that it never saw, and say where it still fits."""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.channels import DISPLAY_UNIT, to_display
from pamjax.infer.fitting.load import Loaded
from pamjax.infer.problem.dataset import CHANNELS, case_history, counts, slack, starting_sd
from pamjax.model.balance import Status
from pamjax.model.bench import Bench, Shown, record, unpushed
from pamjax.model.muscle import Reading, predict
from pamjax.records.blocks import blocks
from pamjax.records.case import Case
from pamjax.records.files import read_bytes
from pamjax.records.fixed_length import held
from pamjax.units import many

#: Rmse over the channel's noise up to which a block counts as fitted: a quarter more than noise.
FITS = 1.25


@dataclass(frozen=True)
class Block:
    """How one block is predicted: rmse and noise by channel, SI."""

    name: str
    rmse: dict[str, float]
    noise: dict[str, float]

    @property
    def missed(self) -> str:
        """The channel that is missed by most, and by how much."""
        worst = max(self.rmse, key=lambda channel: self.rmse[channel] / self.noise[channel])
        return f"{worst} by {self.rmse[worst] / self.noise[worst]:.3g} of noise"


@dataclass(frozen=True)
class Validation:
    """A model against a recording that it never saw.

    Attributes:
        case: name of the recording.
        rmse: by channel, SI, over all rows that count.
        noise: standard deviation of a sample by channel, SI: the sensor's (one percent of the range where
            none is stated), with what the noise of pressure and length does to the prediction.
        blocks: the recording's blocks.
        failed: rows where the model has no answer.
        seen: whether the model was fitted to this very recording, which makes it no test.
        outside: sentences on pressures and lengths beyond those it was calibrated on.
    """

    case: str
    rmse: dict[str, float]
    noise: dict[str, float]
    blocks: tuple[Block, ...]
    failed: int
    outside: tuple[str, ...]
    seen: bool = False

    def fits(self, block: Block) -> bool:
        """Whether a block is predicted as well as noise allows."""
        return all(rmse <= FITS * block.noise[channel] for channel, rmse in block.rmse.items())

    def __str__(self) -> str:
        told = "fitted to this very recording, which is no test of it" if self.seen else "that never saw it"
        lines = [f"{self.case}: a model {told}"]
        for channel, rmse in self.rmse.items():
            unit, noise = DISPLAY_UNIT[channel], to_display(channel, self.noise[channel])
            rmse = to_display(channel, rmse)
            lines.append(f"  {channel}: rmse {rmse:.3g} {unit}, noise {noise:.3g} {unit}")
        good = [block.name for block in self.blocks if self.fits(block)]
        head = f"  fits {len(good)} of {len(self.blocks)} blocks, to {FITS} of noise"
        lines.append(head + (f": {', '.join(good)}" if good else ""))
        missed = [f"{block.name} ({block.missed})" for block in self.blocks if not self.fits(block)]
        lines += [f"  misses {', '.join(missed)}"] if missed else []
        if self.failed:
            lines.append(f"  no answer in {many(self.failed, 'row')}")
        return "\n".join(lines + [f"  {sentence}" for sentence in self.outside])

    def as_dict(self) -> dict[str, Any]:
        """For programs, SI."""
        blocks = [
            {"name": b.name, "rmse": b.rmse, "noise": b.noise, "fits": self.fits(b)} for b in self.blocks
        ]
        return {
            "case": self.case,
            "seen": self.seen,
            "rmse": self.rmse,
            "noise": self.noise,
            "blocks": blocks,
            "failed": self.failed,
            "outside": list(self.outside),
        }


def fitted_to(file: Path) -> frozenset[str]:
    """Checksums of all recordings that a fit.json or model.json was fitted to; none if it does not know."""
    if file.suffix != ".json":
        return frozenset()
    cases = json.loads(read_bytes(file)).get("cases", {})
    return frozenset(one["checksum"] for one in cases.values() if one.get("checksum"))


def validate(model: Loaded, case: Case, fitted: Collection[str] = ()) -> Validation:
    """Predict a recording with a model as it is.

    Args:
        model: as `load_muscle` reads it from a fit.json or a model.json.
        case: the recording.
        fitted: checksums of the recordings that the model was fitted to, as `fitted_to` reads them; its own
            recording is among them where it was calibrated.
    """
    case = held(case)
    recording = case.recording
    good = recording.usable
    rest = case.entry.rest_length.value
    pressure = np.where(good, recording.pressure, 0.0)
    length = np.where(good, recording.length, rest)
    reading = _read(model, case, pressure, length)
    sensors = case.entry.sensors
    # A reading at another pressure or length by one sd: what that channel's noise does to it.
    moved = [
        _read(model, case, pressure + by_pressure, length + by_length)
        for by_pressure, by_length in ((sensors.pressure or 0.0, 0.0), (0.0, sensors.length or 0.0))
    ]
    found, misfit, noise = blocks(recording), {}, {}
    for channel, sd in zip(CHANNELS, starting_sd(case), strict=True):
        there, said = counts(case, channel), np.asarray(getattr(reading, channel))
        if there.any():
            off = getattr(recording, channel) - said
            carried = [np.asarray(getattr(other, channel)) - said for other in moved]
            misfit[channel] = np.where(there, off, np.nan)
            noise[channel] = np.where(there, np.sqrt(sd**2 + sum(x**2 for x in carried)), np.nan)
    failed = good & (np.asarray(reading.status) != Status.OK)
    return Validation(
        case=case.name,
        rmse={c: _rms(v) for c, v in misfit.items()},
        noise={c: _rms(v) for c, v in noise.items()},
        blocks=tuple(
            Block(name, *(_of(values, found.mask(k)) for values in (misfit, noise)))
            for k, name in enumerate(found.names)
        ),
        failed=int(np.count_nonzero(failed)),
        outside=tuple(_outside(model.calibrated, pressure[good], length[good])),
        seen=case.checksum in fitted or (bool(model.calibrated) and case.checksum == model.checksum),
    )


def _read(model: Loaded, case: Case, pressure: np.ndarray, length: np.ndarray) -> Reading | Shown:
    at, loose = (jnp.asarray(pressure), jnp.asarray(length)), jnp.asarray(slack(case))
    if isinstance(model.muscle, Bench):
        return record(model.muscle, *at, case_history(case, case.recording.n), loose)
    ideal = predict(model.muscle, *at)
    return eqx.tree_at(lambda r: r.force, ideal, unpushed(ideal.force, loose))


def _of(values: dict[str, np.ndarray], rows: np.ndarray) -> dict[str, float]:
    """Rms over some rows of every channel that was measured there."""
    return {c: _rms(v[rows]) for c, v in values.items() if np.isfinite(v[rows]).any()}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def _outside(calibrated: dict[str, tuple[float, float]], pressure, length) -> list[str]:
    said = []
    for name, values, unit, per in (("pressure", pressure, "kPa", 1e-3), ("length", length, "mm", 1e3)):
        if name not in calibrated or not values.size:
            continue
        low, high = calibrated[name]
        far = max(low - values.min(), values.max() - high)
        if far > 0.01 * max(high - low, 1e-12):
            said.append(f"{name} goes {far * per:.3g} {unit} beyond what the model was calibrated on")
    return said

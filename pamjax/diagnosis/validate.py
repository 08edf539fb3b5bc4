"""Validation of a model on a recording that it was not fitted to, block by block."""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.channels import DISPLAY_UNIT, to_display
from pamjax.diagnosis.case_prediction import predict_case, predict_channels
from pamjax.errors import BadInput
from pamjax.infer.fitting.load import LoadedMuscle, load_muscle
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.infer.problem.informative_samples import estimate_starting_sd, find_informative_samples
from pamjax.infer.problem.rms import compute_rms
from pamjax.model.balance import Status
from pamjax.notebook import NotebookText
from pamjax.records.blocks import find_blocks
from pamjax.records.case import Case, ensure_case
from pamjax.records.files import read_bytes
from pamjax.records.fixed_length import average_fixed_lengths
from pamjax.text import join_words
from pamjax.units import format_count, format_number

#: Rmse over the channel's noise up to which a block counts as fitted: a quarter more than noise.
_MAX_RMSE_NOISE_RATIO = 1.25


@dataclass(frozen=True)
class BlockValidation:
    """Prediction error of one block: rmse and noise by channel, SI."""

    name: str
    rmse: dict[str, float]
    noise: dict[str, float]

    @property
    def worst_misfit(self) -> str:
        """Return the channel with the largest rmse over noise, in words."""
        worst = max(self.rmse, key=lambda channel: self.rmse[channel] / self.noise[channel])
        return f"{worst} {self.rmse[worst] / self.noise[worst]:.3g} times the noise"


@dataclass(frozen=True, repr=False)
class Validation(NotebookText):
    """Prediction errors of a model on one recording.

    Attributes:
        case: name of the recording.
        rmse: root mean square error by channel, SI, over all compared rows.
        noise: standard deviation of a sample by channel, SI. It includes the sensor's noise (one percent of
            the range if none is stated) and the effect of pressure and length noise on the prediction.
        blocks: errors of each block.
        failed_rows: number of rows in which the model has no solution.
        extrapolations: sentences on pressures and lengths outside the calibrated range.
        is_training_recording: whether the model was fitted to this recording; it is then no validation.
        form_errors: ids of the mechanisms whose form errors are part of the prediction.
        model_sd: rms standard deviation of the prediction by parameters and form errors, SI, by channel;
            empty for a model without form errors.
    """

    case: str
    rmse: dict[str, float]
    noise: dict[str, float]
    blocks: tuple[BlockValidation, ...]
    failed_rows: int
    extrapolations: tuple[str, ...]
    is_training_recording: bool = False
    form_errors: tuple[str, ...] = ()
    model_sd: dict[str, float] = field(default_factory=dict)

    def fits_block(self, block: BlockValidation) -> bool:
        """Return whether every channel of a block is predicted to its noise."""
        return all(
            rmse <= _MAX_RMSE_NOISE_RATIO * block.noise[channel] for channel, rmse in block.rmse.items()
        )

    def __str__(self) -> str:
        description = (
            "the model was fitted to this recording, so this is no validation"
            if self.is_training_recording
            else "the model was not fitted to this recording"
        )
        lines = [f"{self.case}: {description}"]
        for channel, rmse in self.rmse.items():
            unit, noise = DISPLAY_UNIT[channel], to_display(channel, self.noise[channel])
            rmse = to_display(channel, rmse)
            lines.append(
                f"  {channel}: rmse {format_number(rmse, 3)} {unit}, noise {format_number(noise, 3)} {unit}"
            )
        if self.form_errors:
            lines.append(self._describe_form_errors())
        fitted_names = [block.name for block in self.blocks if self.fits_block(block)]
        count = f"{len(fitted_names)} of {len(self.blocks)} blocks"
        head = f"  {count} are predicted to {_MAX_RMSE_NOISE_RATIO} times the noise"
        lines.append(head + (f": {', '.join(fitted_names)}" if fitted_names else ""))
        missed_blocks = [
            f"{block.name} ({block.worst_misfit})" for block in self.blocks if not self.fits_block(block)
        ]
        lines += [f"  larger errors: {', '.join(missed_blocks)}"] if missed_blocks else []
        if self.failed_rows:
            lines.append(f"  no solution in {format_count(self.failed_rows, 'row')}")
        return "\n".join(lines + [f"  {sentence}" for sentence in self.extrapolations])

    def _describe_form_errors(self) -> str:
        sds = [f"{format_number(to_display(c, sd), 2)} {DISPLAY_UNIT[c]}" for c, sd in self.model_sd.items()]
        return (
            f"  the prediction includes form errors of {join_words(self.form_errors)};"
            f" the noise includes its sd, {join_words(sds)}"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the validation as a dictionary for JSON, SI."""
        blocks = [
            {"name": b.name, "rmse": b.rmse, "noise": b.noise, "fits": self.fits_block(b)}
            for b in self.blocks
        ]
        return {
            "case": self.case,
            "seen": self.is_training_recording,
            "rmse": self.rmse,
            "noise": self.noise,
            "blocks": blocks,
            "failed": self.failed_rows,
            "outside": list(self.extrapolations),
            "form_errors": list(self.form_errors),
            "model_sd": self.model_sd,
        }


def read_training_checksums(file: Path) -> frozenset[str]:
    """Return the checksums of the cases, and of their recordings, that a model was fitted to, if stated."""
    if file.suffix != ".json":
        return frozenset()
    cases = json.loads(read_bytes(file)).get("cases", {})
    return frozenset(
        case[key]
        for case in cases.values()
        if isinstance(case, dict)
        for key in ("checksum", "recording_checksum")
        if case.get(key)
    )


def validate(
    model: LoadedMuscle | str | Path, case: Case | str | Path, training_checksums: Collection[str] = ()
) -> Validation:
    """Return the errors of a fitted model on a recording that its fit did not use.

    Args:
        model: a fit.json or a model.json, or the result of `load_muscle` for it.
        case: the recording, or its folder.
        training_checksums: checksums of the cases or recordings that the model was fitted to. Those that the
            file of the model states are always included.

    Returns:
        the `Validation` with rmse and noise by channel and block, SI; `print` shows its summary.

    Raises:
        BadInput: if a file cannot be read, or if the recording has a measured length.

    Example:
        print(pamjax.validate("out/mine/model.json", "again"))
    """
    if not isinstance(model, LoadedMuscle):
        training_checksums = {*training_checksums, *read_training_checksums(Path(model))}
        model = load_muscle(model)
    case = ensure_case(case)
    if case.recording.measures_length:
        rule, got = "a validation needs a measured force", "a measured length ([test] of muscle.toml)"
        raise BadInput.from_rule(rule, got, case.name, "Diagnose this recording: it tests held-out blocks.")
    case = average_fixed_lengths(case)
    recording = case.recording
    usable = recording.usable
    rest_length = case.muscle_toml.rest_length.value
    pressure = np.where(usable, recording.pressure, 0.0)
    length = np.where(usable, recording.length, rest_length)
    prediction = predict_case(model, case, pressure, length)
    sensors = case.muscle_toml.sensors
    # Readings with pressure or length changed by one sd give the effect of their noise.
    input_noise_changes = [
        predict_channels(prediction.muscle, case, pressure + by_pressure, length + by_length)
        - prediction.textbook
        for by_pressure, by_length in ((sensors.pressure or 0.0, 0.0), (0.0, sensors.length or 0.0))
    ]
    recording_blocks, misfit, noise = find_blocks(recording), {}, {}
    model_sd: dict[str, np.ndarray] = {}
    for c, (channel, sd) in enumerate(zip(CHANNELS, estimate_starting_sd(case), strict=True)):
        compared_rows = find_informative_samples(case, channel)
        if compared_rows.any():
            difference = getattr(recording, channel) - prediction.values[c]
            variance = sd**2 + prediction.sd[c] ** 2 + sum(change[c] ** 2 for change in input_noise_changes)
            misfit[channel] = np.where(compared_rows, difference, np.nan)
            noise[channel] = np.where(compared_rows, np.sqrt(variance), np.nan)
            model_sd[channel] = np.where(compared_rows, prediction.sd[c], np.nan)
    is_failed = usable & (prediction.status != Status.OK)
    return Validation(
        case=case.name,
        rmse={c: compute_rms(v) for c, v in misfit.items()},
        noise={c: compute_rms(v) for c, v in noise.items()},
        blocks=tuple(
            BlockValidation(
                name,
                *(_compute_channel_rms(values, recording_blocks.build_mask(k)) for values in (misfit, noise)),
            )
            for k, name in enumerate(recording_blocks.names)
        ),
        failed_rows=int(np.count_nonzero(is_failed)),
        extrapolations=tuple(
            _describe_extrapolation(model.calibrated_range, pressure[usable], length[usable])
        ),
        # The same recording with another muscle.toml is no new recording.
        is_training_recording=not {case.checksum, case.recording_checksum}.isdisjoint(training_checksums)
        or (bool(model.calibrated_range) and case.checksum == model.checksum),
        form_errors=tuple(model.form_errors.forms) if model.form_errors else (),
        model_sd={c: compute_rms(v) for c, v in model_sd.items()} if model.form_errors else {},
    )


def _compute_channel_rms(values: dict[str, np.ndarray], rows: np.ndarray) -> dict[str, float]:
    """Return the rms over some rows, for every channel measured there."""
    return {c: compute_rms(v[rows]) for c, v in values.items() if np.isfinite(v[rows]).any()}


def _describe_extrapolation(calibrated_range: dict[str, tuple[float, float]], pressure, length) -> list[str]:
    sentences = []
    for name, values, unit, per in (("pressure", pressure, "kPa", 1e-3), ("length", length, "mm", 1e3)):
        if name not in calibrated_range or not values.size:
            continue
        low, high = calibrated_range[name]
        distance = max(low - values.min(), values.max() - high)
        if distance > 0.01 * max(high - low, 1e-12):
            sentences.append(f"{name} is up to {distance * per:.3g} {unit} outside the calibrated range")
    return sentences

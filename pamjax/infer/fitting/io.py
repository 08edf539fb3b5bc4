"""Files of a fit: fit.json with the parameters, and fit.nc with every row."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pamjax.channels import DISPLAY_UNIT, SI_UNIT, to_display
from pamjax.errors import BadInput
from pamjax.infer.form_errors.form_model_file import FORM_MODEL_KEY, build_form_model_entry
from pamjax.records.files import write_atomically
from pamjax.units import compute_si_factor

if TYPE_CHECKING:
    import xarray as xr

    from pamjax.infer.fitting.result import CaseFit, Estimate, Fit
    from pamjax.infer.form_errors.parts import FormErrorPart

FIT_SCHEMA = "pamjax.fit/1"


def build_fit_document(fit: Fit) -> dict[str, Any]:
    """Return the fit as a JSON document, in display units; "muscle" and "calibrated" in SI."""
    return {
        "schema": FIT_SCHEMA,
        "versions": {name: version(name) for name in ("pamjax", "jax", "optimistix", "numpy")},
        "law": fit.law,
        "mechanisms": list(fit.mechanisms),
        "loss": fit.loss,
        "seed": fit.seed,
        "converged": fit.converged,
        "steps": fit.steps,
        "starts": {"agreeing": fit.agreeing_starts, "tried": fit.starts},
        "parameters": {name: _build_estimate_entry(e) for name, e in fit.estimates.items()},
        "correlation": {"names": list(fit.estimates), "matrix": np.round(fit.correlation, 6).tolist()},
        "cases": {
            case_fit.case.name: _build_case_entry(case_fit, fit.law, fit.mechanisms) for case_fit in fit.cases
        },
    }


def list_result_names(cases: Sequence[str]) -> list[str]:
    """Return the names of the files that `save` writes, fit.json first.

    Args:
        cases: names of the cases.
    """
    return ["fit.json", *(["fit.nc"] if len(cases) == 1 else [f"{case}.nc" for case in cases])]


def _build_estimate_entry(e: Estimate) -> dict[str, Any]:
    scale = compute_si_factor(e.meaning.show)
    prior_sd = e.prior_sd / scale if math.isfinite(e.prior_sd) else None
    return {
        "value": e.value / scale,
        "sd": None if e.sd is None else e.sd / scale,
        "unit": e.meaning.show,
        "prior": {"value": e.prior / scale, "sd": prior_sd},
        "at_limit": e.at_limit,
    }


def _build_case_entry(case_fit: CaseFit, law: str, mechanisms: tuple[str, ...]) -> dict[str, Any]:
    recording = case_fit.case.recording
    return {
        "checksum": case_fit.case.checksum,
        "recording_checksum": case_fit.case.recording_checksum,
        "rows": int(recording.n),
        "rmse": {c: _build_quantity_entry(c, v) for c, v in case_fit.rmse.items()},
        "noise": {
            c: _build_quantity_entry(c, n.sd, "sd")
            | {
                "given": n.is_stated,
                "excess": n.rms_over_noise,
                "inflation": n.autocorrelation_time,
                "correlation_time_s": n.correlation_time,
            }
            for c, n in case_fit.noise.items()
        },
        "held_out": {}
        if case_fit.held_out_score is None
        else {
            "blocks": case_fit.held_out_score.kind,
            "folds": [list(f) for f in case_fit.held_out_score.folds],
            "rmse": {c: _build_quantity_entry(c, v) for c, v in case_fit.held_out_score.rmse.items()},
        },
        "calibrated": {
            name: {"low": low, "high": high} for name, (low, high) in case_fit.calibrated_range.items()
        },
        "memory": {"gaps": case_fit.case.gaps, "before": case_fit.case.before},
        "muscle": {"law": law, "mechanisms": list(mechanisms), "numbers": case_fit.numbers},
        "muscle_toml": case_fit.case.text,
        "form_errors": {id: _build_form_entry(case_fit, part) for id, part in case_fit.form_errors.items()},
        **_build_form_model(case_fit),
        "failed": {status.name: rows.tolist() for status, rows in case_fit.failed_rows.items()},
        "set_aside": [str(aside) for aside in recording.outliers],
        "warnings": list(case_fit.case.warnings),
    }


def _build_form_model(case_fit: CaseFit) -> dict[str, Any]:
    """Return the form errors for other recordings under their key; empty if there are none."""
    model = case_fit.form_error_model
    return {} if model is None else {FORM_MODEL_KEY: build_form_model_entry(model)}


def _build_form_entry(case_fit: CaseFit, part: FormErrorPart) -> dict[str, Any]:
    """Return the form error of a mechanism; a channel without an effect is absent."""
    channels = case_fit.case.recording.model_channels
    return {
        "share": part.share,
        "ratio": part.ratio,
        **{
            key: {c: _build_quantity_entry(c, float(v)) for c, v in zip(channels, rms, strict=True) if v > 0}
            for key, rms in (("rms", part.form_rms), ("textbook_rms", part.effect_rms))
        },
    }


def _build_quantity_entry(channel: str, value: float, key: str = "value") -> dict[str, Any]:
    return {key: to_display(channel, value), "unit": DISPLAY_UNIT[channel]}


def build_xarray_dataset(case_fit: CaseFit) -> xr.Dataset:
    """Return every row of a case as an xarray Dataset: measurement, prediction and residual, with units."""
    import xarray as xr

    variables = {name: ("row", *variable) for name, variable in _collect_variables(case_fit).items()}
    return xr.Dataset(variables, coords={"row": variables.pop("row")}, attrs=_collect_attributes(case_fit))


def _collect_attributes(case_fit: CaseFit) -> dict[str, str]:
    return {"case": case_fit.case.name, "checksum": case_fit.case.checksum, "pamjax": version("pamjax")}


def _collect_variables(case_fit: CaseFit) -> dict[str, tuple[np.ndarray, dict[str, str]]]:
    """Return values, (n,), and attributes of each variable of fit.nc."""
    recording = case_fit.case.recording
    columns: dict[str, tuple[np.ndarray, str, str]] = {
        "pressure": (recording.pressure, "Pa", "gauge pressure"),
        "length": (recording.length, "m", "distance between the fittings"),
        "cycle": (recording.cycle, "1", "stroke, step or test"),
    }
    if recording.time is not None:
        columns["time"] = (recording.time, "s", "time")
    if recording.measures_length:
        columns["force"] = (recording.force, "N", "set force")
    for channel in recording.model_channels:
        unit = SI_UNIT[channel]
        measured, model = getattr(recording, channel), case_fit.prediction[channel]
        columns |= {
            channel: (measured, unit, f"measured {channel}"),
            f"{channel}_model": (model, unit, f"{channel} of the fitted muscle"),
            f"{channel}_residual": (measured - model, unit, "measured minus model"),
            f"{channel}_unseen": (
                case_fit.held_out_prediction[channel],
                unit,
                "prediction by a fit without the row's block",
            ),
        }
    for channel, sd in case_fit.prediction_sd.items():
        index = recording.model_channels.index(channel)
        form = sum((part.form[index] for part in case_fit.form_errors.values()), np.zeros(recording.n))
        columns |= {
            f"{channel}_form_error": (form, SI_UNIT[channel], "form errors, part of the model"),
            f"{channel}_model_sd": (sd, SI_UNIT[channel], "standard deviation of the model"),
        }
    block = np.array(case_fit.block, dtype=object).astype(str)
    return {
        **{n: (v, {"units": unit, "long_name": text}) for n, (v, unit, text) in columns.items()},
        "block": (block, {"long_name": "block held out together"}),
        "row": (recording.row, {"long_name": "line of recording.csv"}),
    }


def _write_netcdf(case_fit: CaseFit, path: Path) -> None:
    """Write `build_xarray_dataset` as netCDF.

    Without xarray, which takes half a second to load, and a whole one together with Dask.
    """
    import h5netcdf
    import h5py

    with h5netcdf.File(path, "w") as file:
        file.attrs.update(_collect_attributes(case_fit))
        file.dimensions = {"row": case_fit.case.recording.n}
        for name, (values, attributes) in _collect_variables(case_fit).items():
            is_text, is_float = values.dtype.kind == "U", values.dtype.kind == "f"
            stored = values.astype(object) if is_text else values
            variable = file.create_variable(
                name,
                ("row",),
                h5py.string_dtype() if is_text else values.dtype,
                data=stored,
                fillvalue=np.nan if is_float else None,
            )
            variable.attrs.update(attributes)


def save(fit: Fit, folder: str | Path) -> list[Path]:
    """Write fit.json and fit.nc atomically, and return their paths.

    With several cases, each has a file with the case's name instead of fit.nc.

    Args:
        fit: the fit.
        folder: the folder; it is created if necessary.

    Returns:
        the files written.

    Raises:
        BadInput: if `fit` is not a fit.
        OSError: if the folder cannot be written.

    Example:
        fit = pamjax.fit("mine")
        pamjax.save(fit, "out")
    """
    if not hasattr(fit, "estimates"):
        raise BadInput.from_rule(
            "`save` writes a fit",
            f"a {type(fit).__name__}",
            remedy="Call `pamjax.save_posterior` for a posterior, `diagnosis.save(folder)` for a diagnosis.",
        )
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    names = list_result_names([case_fit.case.name for case_fit in fit.cases])
    paths = [folder / name for name in names]
    with write_atomically(paths[0]) as path:
        path.write_text(
            json.dumps(build_fit_document(fit), indent=2, allow_nan=False) + "\n", encoding="utf-8"
        )
    for case_fit, target in zip(fit.cases, paths[1:], strict=True):
        with write_atomically(target) as path:
            _write_netcdf(case_fit, path)
    return paths

"""A fit on disk: fit.json for people and programs, fit.nc for every row."""

from __future__ import annotations

import json
import math
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pamjax.channels import DISPLAY_UNIT, to_display
from pamjax.records.files import write_beside
from pamjax.units import in_unit

if TYPE_CHECKING:
    from pamjax.infer.fitting.result import CaseFit, Estimate, Fit

SCHEMA = "pamjax.fit/1"


def as_dict(fit: Fit) -> dict[str, Any]:
    """The fit as plain numbers, in the units a person reads; "muscle" and "calibrated" in SI."""
    return {
        "schema": SCHEMA,
        "versions": {name: version(name) for name in ("pamjax", "jax", "optimistix", "numpy")},
        "law": fit.law,
        "mechanisms": list(fit.mechanisms),
        "loss": fit.loss,
        "seed": fit.seed,
        "converged": fit.converged,
        "steps": fit.steps,
        "starts": {"agreeing": fit.agreeing, "tried": fit.starts},
        "parameters": {name: _estimate(e) for name, e in fit.estimates.items()},
        "correlation": {"names": list(fit.estimates), "matrix": np.round(fit.correlation, 6).tolist()},
        "cases": {one.case.name: _case(one, fit.law, fit.mechanisms) for one in fit.cases},
    }


def _estimate(e: Estimate) -> dict[str, Any]:
    scale = in_unit(e.meaning.show)
    prior_sd = e.prior_sd / scale if math.isfinite(e.prior_sd) else None
    return {
        "value": e.value / scale,
        "sd": None if e.sd is None else e.sd / scale,
        "unit": e.meaning.show,
        "prior": {"value": e.prior / scale, "sd": prior_sd},
        "at_limit": e.at_limit,
    }


def _case(one: CaseFit, law: str, mechanisms: tuple[str, ...]) -> dict[str, Any]:
    recording = one.case.recording
    return {
        "checksum": one.case.checksum,
        "rows": int(recording.n),
        "rmse": {c: _shown(c, v) for c, v in one.rmse.items()},
        "noise": {
            c: _shown(c, n.sd, "sd")
            | {"given": n.given, "excess": n.excess, "inflation": n.inflation, "correlation_time_s": n.time}
            for c, n in one.noise.items()
        },
        "held_out": {}
        if one.held_out is None
        else {
            "blocks": one.held_out.kind,
            "folds": [list(f) for f in one.held_out.folds],
            "rmse": {c: _shown(c, v) for c, v in one.held_out.rmse.items()},
        },
        "calibrated": {name: {"low": low, "high": high} for name, (low, high) in one.calibrated.items()},
        "memory": {"gaps": one.case.gaps, "before": one.case.before},
        "muscle": {"law": law, "mechanisms": list(mechanisms), "numbers": one.numbers},
        "muscle_toml": one.case.text,
        "failed": {status.name: rows.tolist() for status, rows in one.failed.items()},
        "set_aside": [str(aside) for aside in recording.aside],
        "warnings": list(one.case.warnings),
    }


def _shown(channel: str, value: float, key: str = "value") -> dict[str, Any]:
    return {key: to_display(channel, value), "unit": DISPLAY_UNIT[channel]}


def as_dataset(one: CaseFit):
    """Every row of a case: what was measured, predicted, and left over, with units (xarray)."""
    import xarray as xr

    recording = one.case.recording
    columns: dict[str, tuple[np.ndarray, str, str]] = {
        "pressure": (recording.pressure, "Pa", "gauge pressure"),
        "length": (recording.length, "m", "distance between the fittings"),
        "cycle": (recording.cycle, "1", "stroke, step or test"),
    }
    if recording.time is not None:
        columns["time"] = (recording.time, "s", "time")
    for channel, unit in (("force", "N"), ("diameter", "m")):
        measured, model = getattr(recording, channel), one.prediction[channel]
        columns |= {
            channel: (measured, unit, f"measured {channel}"),
            f"{channel}_model": (model, unit, f"{channel} of the fitted muscle"),
            f"{channel}_residual": (measured - model, unit, "measured minus model"),
            f"{channel}_unseen": (
                one.unseen[channel],
                unit,
                "predicted by a fit that never saw the row's block",
            ),
        }
    data = {
        name: ("row", v, {"units": unit, "long_name": about}) for name, (v, unit, about) in columns.items()
    }
    data["block"] = (
        "row",
        np.array(one.block, dtype=object).astype(str),
        {"long_name": "block held out together"},
    )
    return xr.Dataset(
        data,
        coords={"row": ("row", recording.row, {"long_name": "line of recording.csv"})},
        attrs={"case": one.case.name, "checksum": one.case.checksum, "pamjax": version("pamjax")},
    )


def save(fit: Fit, folder: str | Path) -> list[Path]:
    """Write fit.json, and fit.nc (under the case's name where there are several), each whole or not at all.

    Args:
        fit: the fit.
        folder: where to; made if it is not there.

    Returns:
        the files written.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / "fit.json"]
    with write_beside(written[0]) as path:
        path.write_text(json.dumps(as_dict(fit), indent=2, allow_nan=False) + "\n", encoding="utf-8")
    for one in fit.cases:
        name = "fit.nc" if len(fit.cases) == 1 else f"{one.case.name}.nc"
        written.append(folder / name)
        with write_beside(folder / name) as path:
            as_dataset(one).to_netcdf(path, engine="h5netcdf")
    return written

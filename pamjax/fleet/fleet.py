"""A fleet in Python: its tables as pandas frames, and the results of each case."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from pamjax.errors import BadInput, suggest_word
from pamjax.fleet.frames import select_rows
from pamjax.fleet.store import FleetStore
from pamjax.fleet.tables import FleetTables, read_tables

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False)
class Fleet:
    """Results of a fleet.

    Attributes:
        folder: folder of the store.
        name: name of the fleet.
        cases: one row for each case: origin, state, errors and noise, unexplained part.
        numbers: one row for each calibrated parameter of a case, in its display unit.
        mechanisms: one row for each identified mechanism of a case.
        regions: one row for each region with unexplained misfit.
        tasks: one row for each task, with its computing time in s.
        settings: settings and versions of the last run.
    """

    folder: Path
    name: str
    cases: pd.DataFrame
    numbers: pd.DataFrame
    mechanisms: pd.DataFrame
    regions: pd.DataFrame
    tasks: pd.DataFrame
    settings: dict[str, Any] = field(repr=False, default_factory=dict)

    def to_xarray(self, source: str = "fit") -> xr.Dataset:
        """Return value and sd of the calibrated parameters as an xarray Dataset over case and number.

        Args:
            source: "fit"; "sample" for mean and sd of the posterior; "diagnose" for the baseline of a
                diagnosis; or "mechanism".

        Returns:
            `value` and `sd` (case, number) in the unit of the coordinate `unit`; NaN where a case has none.
        """
        table = select_rows(self.numbers, self.numbers["source"] == source)
        data = table.pivot(index="case", columns="name", values=["value", "sd"])
        units = dict(zip(table["name"], table["unit"], strict=True))
        import xarray as xr

        names = list(data["value"].columns) if len(table) else []
        columns = {
            column: (("case", "number"), data[column].to_numpy(float))
            for column in ("value", "sd")
            if len(table)
        }
        coordinates = {
            "case": [str(case) for case in data.index],
            "number": [str(name) for name in names],
            "unit": ("number", [str(units[name]) for name in names]),
        }
        return xr.Dataset(columns, coordinates)

    def read_rows(self, case: str) -> xr.Dataset:
        """Return every row of a fitted case: measurement, prediction and residual, SI, as in fit.nc.

        Raises:
            BadInput: for an unknown case, or one without a fit.
        """
        import xarray as xr

        return xr.load_dataset(self._find_file(case, "fit", "fit.nc"), engine="h5netcdf")

    def read_posterior(self, case: str) -> xr.DataTree:
        """Return the posterior of a case for ArviZ, with draws over chain and draw, SI, as in posterior.nc.

        Raises:
            BadInput: for an unknown case, or one without a posterior.
        """
        import xarray as xr

        return xr.load_datatree(self._find_file(case, "sample", "posterior.nc"), engine="h5netcdf")

    def _find_file(self, case: str, stage: str, name: str) -> Path:
        """Return the path of a result file."""
        names = list(self.cases["case"])
        if case not in names:
            raise BadInput.from_rule(
                f"unknown case {case!r}", where=str(self.folder), remedy=suggest_word(case, names[:20])
            )
        file = FleetStore(self.folder).locate_stage(case, stage) / name
        if not file.is_file():
            remedy = f"Run `pamjax fleet` with the stage {stage}."
            raise BadInput.from_rule(f"the case {case!r} has no file {name}", remedy=remedy)
        return file


def open_fleet(store: str | Path) -> Fleet:
    """Return the results of a fleet from its store.

    Needs the optional packages: `pip install -e '.[fleet]'` in the repository.

    Args:
        store: folder that `pamjax fleet` wrote.

    Returns:
        the `Fleet`, whose tables are pandas frames.

    Raises:
        BadInput: if the folder is no store, or pyarrow is not installed.

    Example:
        fleet = pamjax.open_fleet("store")
        print(fleet.cases)
    """
    from importlib.util import find_spec

    if find_spec("pyarrow") is None:
        remedy = "Run `pip install -e '.[fleet]'` in the folder of the pamjax repository."
        raise BadInput.from_rule("a fleet needs 1 more package: pyarrow", remedy=remedy)
    return build_fleet(Path(store), read_tables(Path(store)))


def build_fleet(folder: Path, tables: FleetTables) -> Fleet:
    """Return the results of a fleet from its tables."""
    document = tables.document
    settings = {name: document[name] for name in ("settings", "versions", "stages", "folder")}
    return Fleet(folder, document["name"], settings=settings, **tables.frames)

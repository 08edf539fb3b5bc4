"""Cases from tables in memory: a pandas or xarray object instead of recording.csv."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomlkit

from pamjax.errors import BadInput, suggest_word
from pamjax.records.case import MUSCLE_FILE, Case, build_case
from pamjax.records.files import read_bytes
from pamjax.records.reading.header import COLUMN_KINDS

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def case_from(
    table: pd.DataFrame | xr.Dataset,
    muscle: Mapping[str, Any] | str | Path,
    *,
    name: str = "table",
    gaps: str = "carry",
    before: str = "relaxed",
) -> Case:
    """Return a case from a table in memory, with the same checks as for a case folder.

    Args:
        table: a DataFrame with columns `name [unit]` as in recording.csv, or a Dataset whose variables have
            those names and an attribute `units`.
        muscle: path of a muscle.toml, or its contents as nested dictionaries.
        name: name of the case.
        gaps, before: as for `read_case`.

    Returns:
        the `Case`, as `read_case` returns it.

    Raises:
        BadInput: if the table cannot be used; rows are counted as in a file whose header is line 1.

    >>> import pandas as pd
    >>> table = pd.DataFrame({"pressure [kPa]": [200.0], "length [mm]": [200.0], "force [N]": [779.1]})
    >>> braid = {"rest_length": "200 mm", "thread_length": "214 mm", "turns": 1.2}
    >>> case_from(table, {"muscle": braid}).recording.pressure
    array([200000.])
    """
    if isinstance(muscle, Mapping):
        toml_bytes = tomlkit.dumps(muscle).encode()
    else:
        path = Path(muscle)
        toml_bytes = read_bytes(path / MUSCLE_FILE if path.is_dir() else path)
    csv_bytes = _convert_to_frame(table).to_csv(index=False).encode()
    return build_case(toml_bytes, csv_bytes, Path(name), gaps, before, "the table")


def _convert_to_frame(table: Any) -> pd.DataFrame:
    """Return the table with headers `name [unit]`."""
    if hasattr(table, "to_csv"):
        return table
    if not hasattr(table, "data_vars"):
        got = type(table).__name__
        remedy = "Convert the table to one of them."
        raise BadInput.from_rule(
            "a table must be a pandas DataFrame or an xarray Dataset", got, remedy=remedy
        )
    frame = table.to_dataframe().reset_index()
    known_names = [name for name in frame.columns if name in COLUMN_KINDS]
    if not known_names:
        remedy = suggest_word("pressure", [str(name) for name in frame.columns])
        raise BadInput.from_rule(
            "a Dataset must have `pressure`, and `force` or `diameter`", "none of them", remedy=remedy
        )
    units = {name: table[name].attrs.get("units", "") for name in known_names}
    return frame[known_names].rename(
        columns={n: f"{n} [{u}]" if u and n != "cycle" else n for n, u in units.items()}
    )

"""A data frame gives the same case as a folder."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from pamjax.errors import BadInput
from pamjax.records.case import read_case
from pamjax.records.dataframe import case_from
from pamjax.records.writing.template import write_template
from pamjax.units import compute_si_factor

CHANNELS = ("time", "pressure", "length", "force", "diameter", "cycle")
BRAID = {"rest_length": "200 mm", "thread_length": {"value": "214 mm", "sd": "0.5 mm"}, "turns": 1.2}


@pytest.fixture
def folder(tmp_path):
    write_template(tmp_path / "case")
    return tmp_path / "case"


def assert_same(case, other):
    for name in CHANNELS:
        np.testing.assert_allclose(
            getattr(case.recording, name), getattr(other.recording, name), rtol=1e-12, err_msg=name
        )
    assert case.muscle_toml.rest_length == other.muscle_toml.rest_length


def test_dataframe_gives_the_same_case(folder):
    case = read_case(folder)
    assert_same(case_from(case.recording.to_frame(), folder, name="again"), case)
    assert_same(case_from(case.recording.to_frame(), folder / "muscle.toml"), case)
    assert (
        case_from(case.recording.to_frame(), {"muscle": BRAID}).muscle_toml.rest_length
        == case.muscle_toml.rest_length
    )


def test_xarray_dataset_gives_the_same_case(folder):
    case = read_case(folder)
    units = {"time": "s", "pressure": "psi", "length": "in", "force": "lbf", "diameter": "mm", "cycle": "1"}
    data = {
        name: ("row", getattr(case.recording, name) / compute_si_factor(unit), {"units": unit})
        for name, unit in units.items()
    }
    assert_same(case_from(xr.Dataset(data), folder), case)


def test_error_is_reported_with_its_row():
    table = pd.DataFrame(
        {"pressure [kPa]": [200.0, 200.0], "length [mm]": [200.0, -1.0], "force [N]": [779.1, 1]}
    )
    with pytest.raises(BadInput, match=r"`length` must be positive; got -1 mm in row 3 of the table\."):
        case_from(table, {"muscle": BRAID})
    with pytest.raises(BadInput, match="its unit"):
        case_from(table.rename(columns={"force [N]": "force"}), {"muscle": BRAID})
    with pytest.raises(BadInput, match="a pandas DataFrame"):
        case_from([1, 2], {"muscle": BRAID})

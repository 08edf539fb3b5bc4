"""A fit on disk: complete, without NaN, and unchanged after reading."""

import json
import pickle
from html import escape

import h5netcdf
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from pamjax.errors import BadInput
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.io import FIT_SCHEMA, build_fit_document, build_xarray_dataset, save
from pamjax.infer.fitting.load import load_muscle
from pamjax.model.muscle import predict
from pamjax.records.case import read_case
from pamjax.records.writing.case_folder import write_case
from pamjax.units import format_estimate
from tests.agreement import ROUNDING, agree
from tests.infer.made import made

MUSCLE = """\
[muscle]
rest_length = "235.7 mm"
thread_length = {value = "251.8 mm", sd = "0.8 mm"}
turns = {value = 1.087, sd = 0.005}
threads = 144
thread_area = "0.0858 mm^2"

[thread]
modulus = {value = "48 GPa", sd = "8 GPa"}

[sensors]
force = "2 N"
diameter = "0.05 mm"
pressure = "0.7 kPa"
length = "0.02 mm"
"""


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Return a case on disk and its fit."""
    folder = tmp_path_factory.mktemp("cases") / "hose"
    write_case(folder, made().recording, MUSCLE)
    return fit(read_case(folder), starts=1, fold_count=2)


@pytest.fixture(scope="module")
def written(fitted, tmp_path_factory):
    folder = tmp_path_factory.mktemp("out")
    assert [path.name for path in save(fitted, folder)] == ["fit.json", "fit.nc"]
    return folder


def no_constant(name):
    raise AssertionError(f"{name} is no JSON")


def test_document_is_complete(fitted, written):
    document = json.loads((written / "fit.json").read_text("utf-8"), parse_constant=no_constant)
    assert document == json.loads(json.dumps(build_fit_document(fitted)))
    assert document["schema"] == FIT_SCHEMA == "pamjax.fit/1"
    assert set(document) >= {
        "schema", "versions", "law", "mechanisms", "loss", "seed", "converged", "steps", "starts",
        "parameters", "correlation", "cases",
    }  # fmt: skip
    modulus = document["parameters"]["thread.modulus"]
    assert set(modulus) == {"value", "sd", "unit", "prior", "at_limit"}
    assert modulus["unit"] == "GPa"
    assert modulus["prior"] == {"value": pytest.approx(48.0), "sd": pytest.approx(8.0)}
    assert np.shape(document["correlation"]["matrix"]) == (3, 3)
    case = document["cases"]["hose"]
    assert set(case) >= {
        "checksum", "rows", "rmse", "noise", "held_out", "calibrated", "muscle", "muscle_toml", "failed",
        "set_aside", "warnings",
    }  # fmt: skip
    assert case["rmse"]["force"]["unit"] == "N"
    assert case["rmse"]["diameter"]["unit"] == "mm"
    assert case["calibrated"]["pressure"]["high"] == pytest.approx(690e3, rel=0.01)


def test_saved_muscle_is_unchanged_after_reading(fitted, written):
    loaded = load_muscle(written / "fit.json")
    (case_fit,) = fitted.cases
    reading = predict(loaded.muscle, case_fit.case.recording.pressure, case_fit.case.recording.length)
    for channel in ("force", "diameter"):
        agree(getattr(reading, channel), case_fit.prediction[channel], ROUNDING)
    assert loaded.calibrated_range == case_fit.calibrated_range
    assert loaded.text == MUSCLE


def test_loaded_muscle_predicts_as_its_muscle(written):
    loaded = load_muscle(written / "fit.json")
    pressure, length = jnp.array([1e5, 3e5]), jnp.array([0.19, 0.18])
    agree(predict(loaded, pressure, length).force, predict(loaded.muscle, pressure, length).force, ROUNDING)


def test_prediction_of_a_loaded_muscle_with_mechanisms_is_refused(written):
    loaded = load_muscle(written / "fit.json", settings={"force_offset.offset": 3.0})
    with pytest.raises(
        BadInput, match="`predict` needs a muscle without mechanisms; got braid_elasticity, force_offset"
    ):
        predict(loaded, jnp.array([3e5]), jnp.array([0.18]))


def test_every_row_is_saved_with_its_unit(fitted, written):
    (case_fit,) = fitted.cases
    with xr.open_dataset(written / "fit.nc", engine="h5netcdf") as data:
        assert data.sizes == {"row": case_fit.case.recording.n}
        units = {n: data[n].attrs["units"] for n in ("time", "pressure", "length", "force", "diameter_model")}
        assert units == {"time": "s", "pressure": "Pa", "length": "m", "force": "N", "diameter_model": "m"}
        agree(data["force_residual"] + data["force_model"], case_fit.case.recording.force, ROUNDING)
        assert list(data["block"].values) == case_fit.block
        assert data.attrs["case"] == "hose"
        np.testing.assert_array_equal(data["force_unseen"], case_fit.held_out_prediction["force"])


def test_netcdf_file_is_that_of_xarray(fitted, written, tmp_path):
    expected = build_xarray_dataset(fitted.cases[0])
    expected.to_netcdf(tmp_path / "xarray.nc", engine="h5netcdf")
    with (
        xr.open_dataset(written / "fit.nc", engine="h5netcdf") as ours,
        xr.open_dataset(tmp_path / "xarray.nc", engine="h5netcdf") as theirs,
    ):
        xr.testing.assert_identical(ours.load(), theirs.load())
        for name in theirs.variables:
            assert ours[name].dtype == theirs[name].dtype
            fills = [data[name].encoding.get("_FillValue") for data in (ours, theirs)]
            assert fills[0] is fills[1] is None or np.isnan(fills).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "a calibrated muscle is a fit.json; got"),
        ("[]", "a calibrated muscle is a file of schema pamjax.fit/1; got no object in fit.json."),
        ("{}", "a calibrated muscle is a file of schema pamjax.fit/1; got no schema in fit.json."),
        ('{"schema": "pamjax.fit/1"}', "a fit.json must be complete; got no 'cases' in fit.json."),
        ('{"schema": "pamjax.fit/1", "cases": {"a": {}}}', "a fit.json must be complete; got no 'muscle'"),
        (
            '{"schema": "pamjax.fit/1", "cases": {}}',
            "a fit.json must be complete; got no 'case' in fit.json.",
        ),
    ],
)
def test_invalid_fit_file_is_refused(tmp_path, text, message):
    (tmp_path / "fit.json").write_text(text)
    with pytest.raises(BadInput, match=message):
        load_muscle(tmp_path / "fit.json")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"case": "pipe"}, "unknown case 'pipe' in fit.json. Valid names are `hose`."),
        ({"law": "toe"}, "the thread law of a calibrated muscle cannot be changed; got toe in fit.json."),
        ({"settings": {"thread.modulus": 1e9}}, "only parameters of mechanisms can be set here"),
    ],
)
def test_missing_case_of_a_fit_is_refused(written, arguments, message):
    with pytest.raises(BadInput, match=message):
        load_muscle(written / "fit.json", **arguments)


def test_case_folder_is_refused_as_a_fit(fitted):
    with pytest.raises(BadInput, match=r"`case` needs a fit\.json"):
        load_muscle(fitted.cases[0].case.folder, case="a")


def test_interrupted_save_leaves_no_partial_file(fitted, tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(h5netcdf.File, "create_variable", interrupted)
    with pytest.raises(KeyboardInterrupt):
        save(fitted, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["fit.json"]
    json.loads((tmp_path / "fit.json").read_text("utf-8"))


@pytest.mark.parametrize("value", ["NaN", "Infinity", "1e308", "null", "true", '"3"', "[]"])
@pytest.mark.parametrize("place", ["numbers", "calibrated"])
def test_file_with_a_value_that_is_no_number_is_refused(written, tmp_path, value, place):
    document = json.loads((written / "fit.json").read_text("utf-8"))
    (case,) = document["cases"].values()
    if place == "numbers":
        case["muscle"]["numbers"]["muscle.turns"] = "HERE"
    else:
        case["calibrated"]["pressure"]["high"] = "HERE"
    (tmp_path / "fit.json").write_text(json.dumps(document).replace('"HERE"', value))
    name = "muscle.turns" if place == "numbers" else "pressure.high"
    with pytest.raises(BadInput) as error:
        load_muscle(tmp_path / "fit.json")
    assert str(error.value).startswith(f"`{name}` must be a finite number; got ")
    assert str(error.value).endswith(" in fit.json. Write the file again with the same command.")


def test_deeply_nested_file_is_refused(tmp_path):
    (tmp_path / "fit.json").write_text("[" * 100_000)
    with pytest.raises(BadInput, match=r"a calibrated muscle is a fit\.json; got"):
        load_muscle(tmp_path / "fit.json")


def test_estimates_are_a_table_in_display_units(fitted):
    table = fitted.to_frame()
    assert list(table.index) == list(fitted.estimates)
    assert list(table.columns) == ["value", "sd", "prior", "prior_sd", "unit", "at_limit"]
    for name, estimate in fitted.estimates.items():
        assert table.loc[name, "unit"] == estimate.meaning.show
        assert format_estimate(estimate.value, None, estimate.meaning.show).startswith(
            f"{table.loc[name, 'value']:.5g}"
        )


def test_unknown_estimate_has_a_suggestion(fitted):
    name = next(iter(fitted.estimates))
    with pytest.raises(KeyError, match=rf"no estimate '{name[:-1]}'. Did you mean `{name}`\?"):
        fitted.estimates[name[:-1]]


def test_results_are_short_in_a_notebook(fitted):
    (case_fit,) = fitted.cases
    assert repr(case_fit.case).startswith("<Case: hose: ")
    assert "\n" not in repr(case_fit.case)
    assert "\n" not in repr(fitted)
    assert len(repr(fitted)) < 120
    assert fitted._repr_html_() == f"<pre>{escape(str(fitted))}</pre>"


def test_fit_is_the_same_after_pickling(fitted):
    assert str(pickle.loads(pickle.dumps(fitted))) == str(fitted)

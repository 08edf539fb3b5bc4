"""Tables of a store: rows, missing values, stale files, and the frames of `open_fleet`."""

import json

import numpy as np
import pandas as pd
import pytest

import pamjax
from pamjax.errors import BadInput
from tests.fleet.made_store import write_made_store

pytest.importorskip("pyarrow", reason="needs the extra pamjax[fleet]")

from pamjax.fleet.analysis import analyse_fleet
from pamjax.fleet.plan import FleetCase, FleetPlan, ReferenceModel
from pamjax.fleet.store import FleetStore, TaskOutcome, open_stage_folder, read_outcome, write_outcome
from pamjax.fleet.summary import list_findings
from pamjax.fleet.tables import build_tables, read_tables, write_tables
from pamjax.fleet.validation import ValidationSummary
from pamjax.records.reading.specimen import Specimen


@pytest.fixture
def store(tmp_path):
    mechanisms = [["pressure_gain"], [], ["unexplained"]]
    return write_made_store(tmp_path, [80.0, 90.0, 100.0], benches=["n", "n", "s"], mechanisms=mechanisms)


def test_one_row_a_case_and_one_a_mechanism(store):
    fleet = pamjax.open_fleet(store)
    assert fleet.cases["case"].tolist() == ["case-00", "case-01", "case-02"]
    assert fleet.cases["bench"].tolist() == ["n", "n", "s"]
    assert fleet.cases["unexplained"].tolist() == [False, False, True]
    assert fleet.cases["report"][0] == "cases/case-00/diagnose/report.html"
    assert fleet.mechanisms[["case", "id"]].values.tolist() == [["case-00", "pressure_gain"]]
    assert fleet.numbers["value"].tolist() == [80.0, 1.06, 90.0, 100.0]
    assert str(fleet.cases["date"][1]) == "2026-03-09"
    assert fleet.tasks["seconds"].tolist() == [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]


def test_written_tables_equal_those_in_memory(store):
    built = build_tables(store)
    write_tables(built, store)
    # Only the files of the tables can give these frames.
    for file in store.glob("cases/*/*/*is.json"):
        file.unlink()
    read = read_tables(store)
    for name, frame in built.frames.items():
        pd.testing.assert_frame_equal(frame, read.frames[name])


def test_tables_older_than_their_cases_are_not_used(store):
    write_tables(build_tables(store), store)
    (store / "cases/case-01/fit/task.json").unlink()
    assert pamjax.open_fleet(store).cases["state"].tolist() == ["done", "open", "done"]


def test_each_outcome_is_read_once(store, monkeypatch):
    folders = []

    def read(folder, key):
        folders.append(folder)
        return read_outcome(folder, key)

    monkeypatch.setattr("pamjax.fleet.tables.read_outcome", read)
    write_tables(build_tables(store), store)
    assert len(folders) == len(set(folders)) == 6
    (store / "cases/case-01/fit/task.json").unlink()
    read_tables(store)  # older than their cases, so that they are built again
    assert len(folders) == 12


def test_law_of_the_fit_and_of_the_diagnosis(store):
    file = store / "cases/case-00/diagnose/diagnosis.json"
    document = json.loads(file.read_text())
    document["baseline"]["model"] = "inelastic"
    file.write_text(json.dumps(document))
    cases = pamjax.open_fleet(store).cases
    assert (cases["law"][0], cases["baseline_law"][0]) == ("elastic", "inelastic")


def test_errors_of_an_isotonic_test(store):
    file = store / "cases/case-01/fit/fit.json"
    document = json.loads(file.read_text())
    (entry,) = document["cases"].values()
    length = {"value": 0.4, "unit": "mm"}
    entry |= {
        "rmse": {"length": length},
        "noise": {"length": {"sd": 0.3}},
        "held_out": {"rmse": {"length": length}},
    }
    file.write_text(json.dumps(document))
    row = pamjax.open_fleet(store).cases.iloc[1]
    assert (row["length_rmse_mm"], row["length_noise_mm"], row["length_held_out_mm"]) == (0.4, 0.3, 0.4)
    assert np.isnan(row["force_rmse_N"])


def test_numbers_as_xarray(store):
    data = pamjax.open_fleet(store).to_xarray()
    assert data["value"].sel(number="thread.modulus").values.tolist() == [80.0, 90.0, 100.0]
    assert data["unit"].values.tolist() == ["GPa"]
    gains = pamjax.open_fleet(store).to_xarray("mechanism")
    assert gains["value"].sel(case="case-00", number="pressure_gain.gain") == 1.06
    assert pamjax.open_fleet(store).to_xarray("diagnose").sizes == {"case": 0, "number": 0}


def test_equal_results_give_equal_bytes(store, tmp_path):
    first = {path.name: path.read_bytes() for path in write_tables(build_tables(store), store)}
    for file in store.glob("cases/*/*/time.json"):
        file.write_text('{"seconds": 99}')
    second = {path.name: path.read_bytes() for path in write_tables(build_tables(store), store)}
    assert {name for name in first if first[name] != second[name]} == {"tasks.parquet"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "the store of a fleet must be a folder with fleet.json; got .*, which has none"),
        ("{", "must be readable JSON"),
        ("[]", "must have the schema pamjax.fleet/1; got None"),
        ('{"schema": "pamjax.fleet/9"}', "must have the schema pamjax.fleet/1; got 'pamjax.fleet/9'"),
        ('{"schema": "pamjax.fleet/1"}', "must list the cases with their names and tasks"),
        ('{"schema": "pamjax.fleet/1", "cases": [3]}', "must list the cases with their names and tasks"),
        (
            '{"schema": "pamjax.fleet/1", "cases": [{"name": "a/../../../x", "tasks": {}}]}',
            r"names of cases and stages must lead into the store; got 'a/\.\./\.\./\.\./x' in .*fleet\.json",
        ),
        (
            '{"schema": "pamjax.fleet/1", "cases": [{"name": "a", "tasks": {"/etc": "0"}}]}',
            "must lead into the store; got '/etc' in",
        ),
    ],
)
def test_refused_stores(tmp_path, text, message):
    if text is not None:
        (tmp_path / "fleet.json").write_text(text)
    with pytest.raises(BadInput, match=message):
        pamjax.open_fleet(tmp_path)


def test_unknown_case_is_refused(store):
    with pytest.raises(BadInput, match=r"unknown case 'case-1'.*Did you mean `case-01`"):
        pamjax.open_fleet(store).read_rows("case-1")
    with pytest.raises(BadInput, match=r"the case 'case-01' has no file fit\.nc"):
        pamjax.open_fleet(store).read_rows("case-01")


def test_values_that_are_not_finite_stay_missing(store):
    file = store / "cases/case-00/fit/fit.json"
    document = json.loads(file.read_text())
    document["parameters"]["thread.modulus"]["sd"] = None
    file.write_text(json.dumps(document))
    assert np.isnan(pamjax.open_fleet(store).numbers["sd"][0])


VALIDATION = {"rmse": {"force": 4.2}, "blocks": [{"fits": True}], "failed": 0, "seen": False}
BLOCKS = [{"fits": True}, {"fits": False}]


def build_posterior(value, converged=True):
    """Return a posterior.json with the modulus of the threads and the noise of the force."""
    prior = {"low": 0.0, "high": None, "value": 100.0, "sd": 20.0}
    entries = {"thread.modulus": (value, "GPa"), "noise.force": (value, "N")}
    parameters = {
        name: {"mean": mean, "sd": 0.6, "unit": unit, "prior": prior}
        for name, (mean, unit) in entries.items()
    }
    return {"converged": converged, "parameters": parameters}


def open_made_fleet(folder, documents):
    """Return a fleet from pairs of posterior.json and validation.json, by name of the case."""
    (folder / "model.json").write_text("{}")
    model = ReferenceModel(folder / "model.json", None, b"{}")
    cases = tuple(FleetCase(name, folder / name, Specimen(), name) for name in documents)
    plan = FleetPlan("made", folder, cases, ("validate", "sample"), model=model)
    store = FleetStore(folder / "store")
    store.prepare()
    store.write_plan(plan)
    for case in cases:
        posterior, validation = documents[case.name]
        for task in store.list_tasks(plan, case):
            with open_stage_folder(task) as place:
                (place / "posterior.json").write_text(json.dumps(posterior))
                (place / "validation.json").write_text(json.dumps(validation))
                write_outcome(place, task, TaskOutcome(task.key, "done"))
    return pamjax.open_fleet(store.folder)


def test_posteriors_and_validations_have_rows(tmp_path):
    documents = {
        "a": (build_posterior(81.0), VALIDATION),
        "b": (build_posterior(82.0), VALIDATION | {"blocks": BLOCKS}),
    }
    fleet = open_made_fleet(tmp_path, documents)
    assert fleet.cases["sample_converged"].tolist() == [True, True]
    assert fleet.cases["validation_blocks"].tolist() == [1, 2]
    assert fleet.cases["validation_blocks_within_noise"].tolist() == [1, 1]
    assert fleet.cases["force_validation_N"].tolist() == [4.2, 4.2]
    assert fleet.to_xarray("sample")["value"].sel(number="thread.modulus").values.tolist() == [81.0, 82.0]
    with pytest.raises(BadInput, match=r"no file posterior\.nc\. Run `pamjax fleet` with the stage sample"):
        fleet.read_posterior("a")


def test_recordings_that_the_model_does_not_predict_are_ranked(tmp_path):
    validations = {
        "fitted": {"blocks": BLOCKS[1:], "seen": True},
        "half": {"blocks": BLOCKS},
        "all": {"blocks": BLOCKS[1:]},
        "rows": {"failed": 3},
        "none": {},
    }
    documents = {name: (build_posterior(80.0), VALIDATION | change) for name, change in validations.items()}
    answers = analyse_fleet(open_made_fleet(tmp_path, documents))
    assert answers.validation == ValidationSummary(("all", "half", "rows"), 4)
    sentence = "The tested model has errors above the noise in 3 of 4 recordings: all, half and rows."
    assert sentence in list_findings(answers)


def test_passed_validations_are_reported(tmp_path):
    documents = {name: (build_posterior(80.0), VALIDATION) for name in "abc"}
    findings = list_findings(analyse_fleet(open_made_fleet(tmp_path, documents)))
    assert findings[-1] == "The tested model predicts all 3 recordings to the noise."


def test_converged_posteriors_are_compared_without_their_noise(tmp_path):
    values = {"a": 80.0, "b": 82.0, "c": 84.0, "d": 86.0}
    documents = {name: (build_posterior(value, name != "d"), VALIDATION) for name, value in values.items()}
    answers = analyse_fleet(open_made_fleet(tmp_path, documents))
    (distribution,) = answers.distributions
    assert distribution.name == "thread.modulus"
    assert distribution.estimates.names == ("a", "b", "c")
    assert "1 posterior did not converge: d." in list_findings(answers)

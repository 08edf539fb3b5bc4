"""The force error that a command cannot explain, as read from the files of a fit and of a diagnosis."""

import json

from pamjax.control.command_uncertainty import read_unexplained_force
from tests.agreement import ROUNDING, agree


def write(folder, name, document):
    (folder / name).write_text(json.dumps(document))
    return folder / name


def describe_diagnosis(**rmse):
    return {"improvement": {"held_out": {"force": rmse}}, "noise": {"force": {"sd": 3.0}}}


def test_error_of_a_diagnosis_is_that_of_the_equations(tmp_path):
    # √(5² − 3²) without form errors.
    model = write(tmp_path, "model.json", {})
    write(tmp_path, "diagnosis.json", describe_diagnosis(rmse_after=3.1, rmse_equations=5.0))
    agree(read_unexplained_force(model), 4.0, ROUNDING)


def test_error_of_a_fit_includes_its_form_errors(tmp_path):
    # √(3² + 12² − 3²) with a form error of 12 N.
    entry = {"held_out": {"rmse": {"force": {"value": 3.0}}}, "noise": {"force": {"sd": 3.0}}}
    fit = write(tmp_path, "fit.json", {"cases": {"mine": entry}})
    agree(read_unexplained_force(fit), 0.0, ROUNDING, 1.0)
    entry["form_errors"] = {
        "contact_pressure": {"rms": {"force": {"value": 12.0}}},
        "diameter_offset": {"rms": {"diameter": {"value": 0.1}}},
    }
    write(tmp_path, "fit.json", {"cases": {"mine": entry}})
    agree(read_unexplained_force(fit), 12.0, ROUNDING)


def test_error_is_unknown_without_held_out_rows(tmp_path):
    assert read_unexplained_force(write(tmp_path, "model.json", {})) is None
    assert read_unexplained_force(write(tmp_path, "fit.json", {"cases": {"mine": {"held_out": {}}}})) is None

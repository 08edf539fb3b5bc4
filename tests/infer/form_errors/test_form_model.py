"""Form errors for other recordings: they are those of the fit, and their file is checked."""

import copy
import json
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.infer.fitting.joint_space import build_joint_space
from pamjax.infer.form_errors.dataset_form import build_dataset_form_source, build_form_columns
from pamjax.infer.form_errors.form_model import FormRows, build_form_error_model, is_transferable
from pamjax.infer.form_errors.form_model_file import build_form_model_entry, read_form_model
from pamjax.infer.problem.dataset import build_dataset, build_history
from pamjax.model.bench import record_bench
from tests.agreement import ROUNDING, SOLVED, agree
from tests.infer.made import made

SHARE, FRICTION = 0.3, "braid_friction"


def build_problem(id):
    """Return case, dataset and parameter values of a muscle on which a mechanism acts."""
    case = made()
    space, (renames,) = build_joint_space([case], "elastic", (), (id,))
    # The values are not at their means, where the mechanism may be switched off.
    values = space.to_values(jnp.full(space.size, 0.4))
    return case, build_dataset(case, "elastic", space, renames, (id,)), values


def build_model(id, coefficients=None, covariance=None, parameters=()):
    """Return the model of a mechanism whose columns have given coefficients, and its problem."""
    problem = build_problem(id)
    _, dataset, values = problem
    source = build_dataset_form_source(*problem, id, SHARE)
    count = source.shape.scales.size
    numbers = {name: float(v) for name, v in dataset.collect_parameters(values).items()}
    model = build_form_error_model(
        "elastic", (id,), numbers, numbers, parameters, {id: source}, (id,) * count,
        np.ones(count) if coefficients is None else coefficients(count),
        np.eye(count) if covariance is None else covariance(count),
    )  # fmt: skip
    assert model is not None
    return model, problem


def build_rows(case):
    """Return the rows of a case, and the function that predicts a bench in them."""
    recording, history = case.recording, build_history(case, case.recording.n)
    slack = jnp.zeros(recording.n, dtype=bool)

    def predict(bench):
        reading = record_bench(bench, recording.pressure, recording.length, history, slack)
        return np.stack([np.asarray(reading.force), np.asarray(reading.diameter)])

    rate = np.asarray(history.rate(jnp.asarray(recording.length)))
    return FormRows(recording.pressure, recording.length, rate), predict


@pytest.mark.parametrize("id", ["contact_pressure", FRICTION])
def test_rows_of_the_fit_have_its_form_error(id):
    model, (case, dataset, values) = build_model(id, lambda count: np.arange(1.0, count + 1))
    columns = SHARE * build_form_columns(case, dataset, values, id)[:, :, : case.recording.n]
    expected = np.einsum("r,rcn->cn", np.arange(1.0, len(columns) + 1), columns)
    got = model.predict_form(model.build_columns(*build_rows(case)))
    assert np.abs(expected[0]).max() > 1.0
    agree(got, expected, SOLVED, np.abs(expected).max(axis=1, keepdims=True) + 1e-6)


def test_sd_has_parameters_coefficients_and_their_covariance():
    name, sd, correlation = "contact_pressure.threshold", 1e3, -0.8

    def build_covariance(count):
        covariance = np.diag([sd**2, *np.full(count, 0.25)])
        covariance[0, 1] = covariance[1, 0] = correlation * sd * 0.5
        return covariance

    model, (case, dataset, values) = build_model(
        "contact_pressure", covariance=build_covariance, parameters=[name]
    )
    rows, predict = build_rows(case)
    columns = SHARE * build_form_columns(case, dataset, values, "contact_pressure")[:, :, : case.recording.n]
    low, high = (
        predict(replace(model, numbers={**model.numbers, name: model.numbers[name] + step}).muscle)
        for step in (-1.0, 1.0)
    )
    parts = np.stack([sd * (high - low) / 2, *(0.5 * columns)])
    correlations = np.eye(len(parts))
    correlations[0, 1] = correlations[1, 0] = correlation
    expected = np.sqrt(np.einsum("kcn,kl,lcn->cn", parts, correlations, parts))
    agree(
        model.compute_sd(model.build_columns(rows, predict), predict)[0], expected[0], 1e-4, expected[0].max()
    )


def test_a_course_in_time_is_not_transferred():
    assert is_transferable("contact_pressure", 0.1)
    assert not is_transferable("contact_pressure", 0.0)
    assert not is_transferable("force_drift", 0.3)
    assert not is_transferable("thread_slip", 0.3)


def test_file_has_the_same_form_errors():
    model, (case, _, _) = build_model(FRICTION)
    entry = json.loads(json.dumps(build_form_model_entry(model), allow_nan=False))
    read = read_form_model(entry, "elastic", (FRICTION,), "fit.json")
    rows, predict = build_rows(case)
    form = model.predict_form(model.build_columns(rows, predict))
    agree(read.predict_form(read.build_columns(rows, predict)), form, ROUNDING, np.abs(form).max())
    agree(read.covariance, model.covariance, ROUNDING, 1e-300)


@pytest.fixture(scope="module")
def entry():
    return build_form_model_entry(build_model(FRICTION)[0])


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (("mechanisms", FRICTION, "terms", 0), "colour", "terms as .* got 'colour' in fit.json"),
        (("mechanisms", FRICTION, "terms", 0), "time^2", "without time; got 'time\\^2'"),
        (("mechanisms", FRICTION, "coefficients"), [1.0], "must have 11 numbers in `coefficients`; got 1"),
        (("mechanisms", FRICTION, "coefficients", 0), float("nan"), "finite numbers .* got nan"),
        (("mechanisms", FRICTION, "limits", "pressure"), [2.0, 1.0], "lower and a higher limit of `press"),
        (("mechanisms", FRICTION, "limits", "typical_speed"), 0.0, "positive `typical_speed`; got 0"),
        (("mechanisms", FRICTION, "reshaped", 0), {"colour": 1.0}, "parameters of `braid_friction`; got col"),
        (("mechanisms",), {"end_taper": {}}, "mechanisms of the muscle; got end_taper"),
        (("mechanisms",), {}, "must have a mechanism; got none"),
        (("covariance", "matrix"), [[1.0]], "must have 11 x 11 numbers in `matrix`; got 1"),
        (("covariance", "parameters"), ["a.b"], "covariance in `numbers`; got a.b"),
        (("effect_numbers",), {"muscle.turns": 1.0}, "in `numbers` and `effect_numbers`; got one without"),
        (("numbers", "muscle.turns"), "x", "`muscle.turns` must be a finite number; got 'x'"),
    ],
)
def test_bad_contents_are_refused(entry, keys, value, message):
    spoiled = part = copy.deepcopy(entry)
    for key in keys[:-1]:
        part = part[key]
    part[keys[-1]] = value
    with pytest.raises(BadInput, match=message):
        read_form_model(spoiled, "elastic", (FRICTION,), "fit.json")


def test_another_type_is_refused():
    with pytest.raises(BadInput, match=r"`form_error_model` must be a table; got 3 in fit\.json"):
        read_form_model(3, "elastic", (FRICTION,), "fit.json")

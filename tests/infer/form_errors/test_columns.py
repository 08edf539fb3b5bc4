"""Columns of form errors on variables that are written down by hand."""

import numpy as np

from pamjax.infer.form_errors.columns import build_columns_of_effect, estimate_form_shape
from pamjax.infer.form_errors.coordinates import Coordinates
from pamjax.model.form_error import FormError, list_powers
from tests.agreement import ROUNDING, agree

N = 200
COORDINATES = Coordinates(
    pressure=np.repeat(np.linspace(-1, 1, 4), N // 4),
    length=np.tile(np.linspace(-1, 1, N // 4), 4),
    force=np.linspace(-1, 1, N),
    direction=np.ones(N),
    speed=np.zeros(N),
    time=np.linspace(0, 1, N),
)
EFFECT = np.stack([3.0 + COORDINATES.length + COORDINATES.pressure, np.zeros(N)])


def compute_rms(columns):
    return np.sqrt(np.mean(columns[:, 0] ** 2, axis=1))


def test_columns_have_nothing_that_is_proportional_to_the_effect():
    terms = FormError(("pressure", *list_powers("length", 3)))
    columns = build_columns_of_effect(terms, COORDINATES, EFFECT)
    assert columns.shape == (4, 2, N)
    agree(columns[:, 0] @ EFFECT[0], 0.0, ROUNDING, float(EFFECT[0] @ EFFECT[0]))
    # The four columns together have the rms of the effect.
    agree(compute_rms(columns), np.sqrt(np.mean(EFFECT[0] ** 2)) / 2, 1e-9)


def test_a_constant_factor_is_no_form_error():
    # `direction` is one everywhere: the term only changes the amplitude.
    columns = build_columns_of_effect(FormError(("direction", "length")), COORDINATES, EFFECT)
    assert compute_rms(columns)[0] == 0.0
    assert compute_rms(columns)[1] > 0.1


def test_harmonics_of_a_course_become_smaller_as_in_a_random_walk():
    columns = build_columns_of_effect(
        FormError(list_powers("time", 5), is_additive=True), COORDINATES, EFFECT
    )
    size = compute_rms(columns)
    agree(size / size[0], 1 / np.arange(1, 6), 0.02)
    agree(np.sqrt(np.sum(size**2)), np.sqrt(np.mean(EFFECT[0] ** 2)), 0.02)


def test_other_rows_have_the_constants_of_the_fit():
    form_error, reshaped = FormError(("pressure", "length^2")), [EFFECT * np.exp(COORDINATES.length)]
    local = COORDINATES.rescale(EFFECT[0])
    shape, rows = estimate_form_shape(form_error, local, EFFECT, reshaped), slice(20, 90)
    own_rows = Coordinates(
        **{name: None if name == "time" else values[rows] for name, values in vars(local).items()}
    )
    columns = shape.build_columns(own_rows, EFFECT[:, rows], [reshaped[0][:, rows]])
    expected = build_columns_of_effect(form_error, COORDINATES, EFFECT, reshaped)[:, :, rows]
    agree(columns, expected, ROUNDING, 1.0)
    # Constants of these rows alone are others.
    own_shape = estimate_form_shape(form_error, own_rows, EFFECT[:, rows], [reshaped[0][:, rows]])
    assert np.abs(own_shape.parallel_shares[:, 0] / shape.parallel_shares[:, 0] - 1).max() > 0.1

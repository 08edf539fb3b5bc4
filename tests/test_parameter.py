"""Parameters with a meaning, and access to the parameters of a model by name."""

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

from pamjax.errors import BadInput
from pamjax.model.muscle import Muscle
from pamjax.model.thread import LinearThread
from pamjax.parameter import (
    Meaning,
    Scalar,
    list_field_meanings,
    list_meanings,
    list_values,
    parameter,
    replace_values,
)


class Spring(eqx.Module):
    rate: Scalar = parameter("N/m", show="N/mm", low=1.0, high=1e6, scale="log", about="rate", source="here")


class Damper(eqx.Module):
    id = "damper"
    loss: Scalar = parameter("N*s/m", low=0.0, high=1e3, neutral=0.0, about="loss", source="here")


class Strut(eqx.Module):
    length: Scalar = parameter("m", low=0.0, high=1.0, about="length", source="here")
    spring: Spring
    others: tuple[eqx.Module, ...] = ()
    label: str = eqx.field(static=True, default="strut")


STRUT = Strut(0.5, Spring(100), (Damper(2.0),))


def test_parameter_is_double_precision_and_has_a_meaning():
    assert STRUT.length.dtype == jnp.float64
    assert STRUT.spring.rate.dtype == jnp.float64  # written as an integer
    assert list_field_meanings(Spring) == {
        "rate": Meaning("N/m", "N/mm", 1.0, 1e6, "log", "rate", "here", None)
    }
    assert list_field_meanings(Damper)["loss"].show == "N*s/m"
    assert list_field_meanings(Damper)["loss"].neutral == 0.0


def test_names_use_fields_of_parts_and_ids_of_members():
    assert list(list_meanings(STRUT)) == list(list_values(STRUT)) == ["length", "spring.rate", "damper.loss"]
    assert float(list_values(STRUT)["damper.loss"]) == 2.0


def test_replace_changes_only_the_named_parameters():
    changed = replace_values(STRUT, {"spring.rate": 7.0, "damper.loss": 1})
    assert {k: float(v) for k, v in list_values(changed).items()} == {
        "length": 0.5,
        "spring.rate": 7.0,
        "damper.loss": 1.0,
    }
    assert float(STRUT.spring.rate) == 100.0
    assert replace_values(STRUT, {}) == STRUT


def test_replace_is_differentiable():
    slope = jax.grad(lambda k: replace_values(STRUT, {"spring.rate": k}).spring.rate ** 2)(3.0)
    assert slope == 6.0


def test_equal_values_stay_separate_parameters():
    """Parameters are identified by their path, not by their value."""
    shared_value = jnp.asarray(0.25)
    muscle = Muscle(shared_value, shared_value, 1.0, LinearThread(1e6))
    changed = replace_values(muscle, {"rest_length": 0.2})
    assert (float(changed.rest_length), float(changed.thread_length)) == (0.2, 0.25)


def test_unknown_parameter_is_refused():
    with pytest.raises(BadInput) as error:
        replace_values(STRUT, {"spring.rat": 1.0})
    assert str(error.value) == "this model has no parameter 'spring.rat'. Did you mean `spring.rate`?"

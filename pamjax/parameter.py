"""Declaration of a model's parameters (unit, limits, scale, meaning), and access to them by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from pamjax.errors import BadInput, suggest_word
from pamjax.units import compute_si_factor

# Fits subtract forces of some kN with errors below 1 N: single precision is not sufficient.
jax.config.update("jax_enable_x64", True)

Scalar = Float[Array, ""]
ModelType = TypeVar("ModelType", bound=eqx.Module)


@dataclass(frozen=True)
class Meaning:
    """Unit, limits and description of a parameter; bounds, reports, errors and help use them.

    Attributes:
        unit: SI unit of the stored value.
        show: display unit.
        low, high: physical limits, SI. An estimate is strictly between them.
        scale: "log" for positive parameters whose order of magnitude is uncertain, else "linear".
        about: description, one line.
        source: source of the limits.
        neutral: value at which the parameter has no effect, SI, or None.
        is_refinement: whether `fit` keeps the parameter at its default. A diagnosis may estimate it.
    """

    unit: str
    show: str
    low: float
    high: float
    scale: str
    about: str
    source: str
    neutral: float | None = None
    is_refinement: bool = False


def convert_scalar(value: Any) -> Array:
    """Return a number as a 64-bit array, and any other object (array, tracer) unchanged."""
    return jnp.asarray(value, dtype=float) if isinstance(value, (int, float)) else value


def parameter(
    unit: str,
    *,
    low: float,
    high: float,
    about: str,
    source: str,
    scale: str = "linear",
    show: str = "",
    neutral: float | None = None,
    is_refinement: bool = False,
    **default: Any,
) -> Any:
    """Return an equinox field that declares a parameter and carries its `Meaning`.

    >>> class Spring(eqx.Module):
    ...     rate: Scalar = parameter("N/m", low=1.0, high=1e6, about="stiffness", source="example")
    >>> list_meanings(Spring(2.0))["rate"].unit
    'N/m'
    """
    meaning = Meaning(unit, show or unit, low, high, scale, about, source, neutral, is_refinement)
    return eqx.field(converter=convert_scalar, metadata={"meaning": meaning}, **default)


def _iterate_parameters(model: Any, prefix: str = "") -> Iterator[tuple[str, Meaning, Any]]:
    for field in dataclasses.fields(model):
        value = getattr(model, field.name)
        path = f"{prefix}{field.name}"
        if "meaning" in field.metadata:
            yield path, field.metadata["meaning"], value
        elif dataclasses.is_dataclass(value):
            yield from _iterate_parameters(value, f"{path}.")
        elif isinstance(value, tuple):
            for item in value:
                if dataclasses.is_dataclass(item):
                    yield from _iterate_parameters(item, f"{getattr(item, 'id', type(item).__name__)}.")


def list_field_meanings(kind: type) -> dict[str, Meaning]:
    """Return the parameters that a model class itself declares, by field."""
    return {f.name: f.metadata["meaning"] for f in dataclasses.fields(kind) if "meaning" in f.metadata}


def list_meanings(model: eqx.Module) -> dict[str, Meaning]:
    """Return the meaning of every parameter of a model, by path."""
    return {path: meaning for path, meaning, _ in _iterate_parameters(model)}


def list_values(model: eqx.Module) -> dict[str, Any]:
    """Return the value of every parameter of a model, SI, by path."""
    return {path: value for path, _, value in _iterate_parameters(model)}


def replace_values(model: ModelType, new_values: Mapping[str, Any]) -> ModelType:
    """Return a copy of the model with new values of the named parameters.

    Raises:
        BadInput: if the model has no parameter of a name.
    """
    parameters = list(list_values(model))
    for name in new_values:
        if name not in parameters:
            raise BadInput.from_rule(
                f"this model has no parameter {name!r}", remedy=suggest_word(name, parameters)
            )
    names = list(new_values)
    # `tree_at` compares leaves by identity. `_iterate_parameters` returns the same objects.
    return eqx.tree_at(
        lambda m: [list_values(m)[n] for n in names], model, [convert_scalar(new_values[n]) for n in names]
    )


def get_display_unit(meaning: Meaning) -> tuple[float, str]:
    """Return the display unit in SI and its name; "1" for a pure number."""
    unit = "1" if meaning.unit == "1" else meaning.show
    return compute_si_factor(unit), unit

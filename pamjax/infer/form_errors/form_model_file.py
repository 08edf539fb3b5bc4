"""The key `form_error_model` of fit.json and model.json: form errors that predict other recordings, SI."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import jax.numpy as jnp
import numpy as np

from pamjax.errors import BadInput
from pamjax.infer.form_errors.coordinates import CoordinateScales, Limits
from pamjax.infer.form_errors.form_model import FormErrorModel, MechanismForm
from pamjax.model.assembly import assemble_bench
from pamjax.model.form_error import FORM_VARIABLES, parse_term
from pamjax.model.registry import find_mechanism
from pamjax.parameter import list_field_meanings
from pamjax.records.json_number import check_json_number

#: Key of the entry of a case.
FORM_MODEL_KEY = "form_error_model"


def build_form_model_entry(model: FormErrorModel) -> dict[str, Any]:
    """Return the form errors as a JSON document; law and mechanisms are those of the muscle."""
    return {
        "numbers": dict(model.numbers),
        "effect_numbers": dict(model.effect_numbers),
        "mechanisms": {
            id: {
                "terms": list(form.terms),
                "reshaped": [dict(values) for values in form.reshaped_values],
                "parallel_shares": form.parallel_shares.tolist(),
                "coefficients": form.coefficients.tolist(),
                "limits": {
                    name: list(value) if isinstance(value, tuple) else value
                    for name, value in asdict(form.limits).items()
                },
            }
            for id, form in model.forms.items()
        },
        "covariance": {"parameters": list(model.parameters), "matrix": model.covariance.tolist()},
    }


def read_form_model(entry: Any, law: str, mechanisms: Sequence[str], file: str) -> FormErrorModel:
    """Return the form errors of a file.

    Args:
        entry: contents of the key `form_error_model`.
        law, mechanisms: those of the muscle in the same file.
        file: name of the file.

    Raises:
        BadInput: for a wrong number, an unknown term, or arrays whose sizes disagree.
        KeyError, TypeError, AttributeError: if a key is missing, or of another type.
    """
    if not isinstance(entry, dict):
        _refuse("must be a table", repr(entry), file)
    numbers, effect_numbers = (_read_numbers(entry[key], file) for key in ("numbers", "effect_numbers"))
    _check_numbers(law, mechanisms, numbers, effect_numbers, file)
    forms = {}
    for id, form in entry["mechanisms"].items():
        if id not in mechanisms:
            _refuse("must have mechanisms of the muscle", id, file)
        forms[id] = _read_form(id, form, file)
    parameters = tuple(entry["covariance"]["parameters"])
    for name in parameters:
        if name not in numbers:
            _refuse("must have each parameter of its covariance in `numbers`", name, file)
    if not forms:
        _refuse("must have a mechanism", "none", file)
    size = len(parameters) + sum(form.coefficients.size for form in forms.values())
    covariance = _read_array("matrix", entry["covariance"]["matrix"], (size, size), file)
    return FormErrorModel(law, tuple(mechanisms), numbers, effect_numbers, forms, parameters, covariance)


def _check_numbers(
    law: str,
    mechanisms: Sequence[str],
    numbers: Mapping[str, float],
    effect_numbers: Mapping[str, float],
    file: str,
) -> None:
    """Refuse parameters from which no muscle can be built."""
    different = sorted(numbers.keys() ^ effect_numbers.keys())
    if different:
        rule = "must have the same parameters in `numbers` and `effect_numbers`"
        _refuse(rule, f"one without {', '.join(different)}", file)
    try:
        assemble_bench(law, tuple(mechanisms), {name: jnp.asarray(value) for name, value in numbers.items()})
    except BadInput as error:
        _refuse("must have the parameters of the muscle", str(error), file)


def _read_form(id: str, form: Mapping[str, Any], file: str) -> MechanismForm:
    terms, fields = tuple(form["terms"]), list_field_meanings(find_mechanism(id))
    for term in terms:
        _check_term(term, file)
    reshaped_values = tuple(_read_numbers(values, file) for values in form["reshaped"])
    for field in (name for values in reshaped_values for name in values):
        if field not in fields:
            _refuse(f"must have parameters of `{id}`", field, file)
    count = len(terms) + len(reshaped_values)
    limits = form["limits"]
    return MechanismForm(
        terms,
        reshaped_values,
        _read_array("parallel_shares", form["parallel_shares"], (count, 2), file),
        _read_array("coefficients", form["coefficients"], (count,), file),
        CoordinateScales(
            pressure=_read_limits("pressure", limits["pressure"], file),
            length=_read_limits("length", limits["length"], file),
            force=_read_limits("force", limits["force"], file),
            typical_speed=_read_typical_speed(limits["typical_speed"], file),
            mean_speed=check_json_number("mean_speed", limits["mean_speed"], file),
            speed=_read_limits("speed", limits["speed"], file),
        ),
    )


def _check_term(term: object, file: str) -> None:
    """Refuse a term that is no product of powers of variables, or that depends on time."""
    try:
        factors = parse_term(str(term))
    except ValueError:
        factors = []
    valid_names = set(FORM_VARIABLES) - {"time"}
    if not factors or any(name not in valid_names or degree < 1 for name, degree in factors):
        _refuse('must have terms as "pressure length^2", without time', repr(term), file)


def _read_numbers(values: Mapping[str, Any], file: str) -> dict[str, float]:
    return {name: check_json_number(name, value, file) for name, value in values.items()}


def _read_limits(name: str, limits: Sequence[Any], file: str) -> Limits:
    low, high = _read_array(name, limits, (2,), file).tolist()
    if low > high:
        _refuse(f"must have a lower and a higher limit of `{name}`", f"{low:g} and {high:g}", file)
    return low, high


def _read_typical_speed(value: object, file: str) -> float:
    speed = check_json_number("typical_speed", value, file)
    if speed <= 0:
        _refuse("must have a positive `typical_speed`", f"{speed:g}", file)
    return speed


def _read_array(name: str, values: Sequence[Any], shape: tuple[int, ...], file: str) -> np.ndarray:
    """Return an array of finite numbers; nested lists of the shape are required."""
    rows = list(values) if len(shape) == 1 else [number for row in values for number in row]
    is_rectangular = len(values) == shape[0] and (
        len(shape) == 1 or all(len(row) == shape[1] for row in values)
    )
    if not is_rectangular:
        expected = " x ".join(map(str, shape))
        _refuse(f"must have {expected} numbers in `{name}`", f"{len(rows)}", file)
    # A covariance may be too small for `check_json_number`.
    for number in rows:
        if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number):
            _refuse(f"must have finite numbers in `{name}`", repr(number), file)
    return np.array(rows, dtype=float).reshape(shape)


def _refuse(rule: str, got: str, file: str) -> None:
    raise BadInput.from_rule(
        f"`{FORM_MODEL_KEY}` {rule}", got, file, "Write the file again with the same command."
    )

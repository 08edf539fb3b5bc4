"""Error messages for entries of TOML files, from the errors of pydantic."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

#: Rule for each type of pydantic's errors; fields in braces are in the error's context.
_RULE_BY_ERROR_TYPE = {
    "missing": "must be stated",
    "literal_error": "must be {expected}",
    "greater_than": "must be more than {gt}",
    "greater_than_equal": "must be at least {ge}",
    "less_than": "must be less than {lt}",
    "less_than_equal": "must be at most {le}",
    "too_short": "must not be empty",
    "too_long": "must have at most {max_length} entries",
    "finite_number": "must be a finite number",
    "int": "must be a whole number",
    "float": "must be a number",
    "bool": "must be true or false",
    "string": "must be a text in quotes",
    "list": "must be a list in brackets",
    "dict": "must be a table",
    "model": "must be a table",
}


def format_rule(error: Mapping[str, Any], name: str) -> str:
    """Return the rule for an entry.

    Args:
        error: one of `ValidationError.errors()`.
        name: name of the entry.

    >>> format_rule({"type": "less_than", "ctx": {"lt": 0.9}}, "contractions")
    '`contractions` must be less than 0.9'
    >>> format_rule({"type": "int_parsing"}, "cycles")
    '`cycles` must be a whole number'
    """
    kind = error["type"]
    text = _RULE_BY_ERROR_TYPE.get(kind) or _RULE_BY_ERROR_TYPE.get(kind.partition("_")[0])
    if text is None:
        return f"`{name}`: {error['msg'][:1].lower()}{error['msg'][1:]}"
    return f"`{name}` {text.format(**_format_bounds(error.get('ctx', {})))}"


def format_input(error: Mapping[str, Any]) -> str:
    """Return the wrong value as text; empty if the entry is missing."""
    return "" if error["type"] == "missing" else _format_value(error["input"])


def _format_bounds(context: Mapping[str, Any]) -> dict[str, str]:
    """Return the limits as texts, with double quotes as in TOML."""
    return {
        key: f"{value:g}" if isinstance(value, float) else str(value).replace("'", '"')
        for key, value in context.items()
    }


def _format_value(value: Any) -> str:
    """Return a value as text in TOML's notation."""
    if isinstance(value, bool):
        return str(value).lower()
    return "a table" if isinstance(value, dict) else repr(value)

"""What is wrong with an entry of a TOML file, where the library that checks it says so in its own words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

#: By the kind of complaint, what must hold; in braces what the complaint knows.
COMPLAINT_RULES = {
    "missing": "must be stated",
    "literal_error": "is {expected}",
    "greater_than": "must be more than {gt}",
    "greater_than_equal": "must be at least {ge}",
    "less_than": "must be less than {lt}",
    "less_than_equal": "must be at most {le}",
    "too_short": "must not be empty",
    "too_long": "must have at most {max_length} entries",
    "finite_number": "must be a finite number",
    "int": "is a whole number",
    "float": "is a number",
    "bool": "is true or false",
    "string": "is a text in quotes",
    "list": "is a list in brackets",
    "dict": "is a table",
    "model": "is a table",
}


def format_rule(complaint: Mapping[str, Any], name: str) -> str:
    """What must hold of an entry.

    Args:
        complaint: one of `ValidationError.errors()`.
        name: of the entry.

    >>> format_rule({"type": "less_than", "ctx": {"lt": 0.9}}, "contractions")
    '`contractions` must be less than 0.9'
    >>> format_rule({"type": "int_parsing"}, "cycles")
    '`cycles` is a whole number'
    """
    kind = complaint["type"]
    text = COMPLAINT_RULES.get(kind) or COMPLAINT_RULES.get(kind.partition("_")[0])
    if text is None:
        return f"`{name}`: {complaint['msg'][:1].lower()}{complaint['msg'][1:]}"
    return f"`{name}` {text.format(**_format_bounds(complaint.get('ctx', {})))}"


def format_input(complaint: Mapping[str, Any]) -> str:
    """What was found instead; nothing where nothing was."""
    return "" if complaint["type"] == "missing" else _format_value(complaint["input"])


def _format_bounds(context: Mapping[str, Any]) -> dict[str, str]:
    """Bounds as short as they were written, texts in double quotes as in TOML."""
    return {
        key: f"{value:g}" if isinstance(value, float) else str(value).replace("'", '"')
        for key, value in context.items()
    }


def _format_value(value: Any) -> str:
    """A value as TOML has it."""
    if isinstance(value, bool):
        return str(value).lower()
    return "a table" if isinstance(value, dict) else repr(value)

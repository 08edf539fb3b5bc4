"""Numbers of a JSON file that pamjax wrote; JSON readers of Python also accept NaN and Infinity."""

from __future__ import annotations

from pamjax.errors import BadInput
from pamjax.units import is_representable


def check_json_number(name: str, value: object, file: str) -> float:
    """Return a number of a JSON file.

    Args:
        name: its key, for the message.
        value: its value.
        file: name of the file.

    Raises:
        BadInput: if it is no finite number.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not is_representable(value):
        rule, remedy = f"`{name}` must be a finite number", "Write the file again with the same command."
        raise BadInput.from_rule(rule, repr(value), file, remedy)
    return float(value)

"""Parsing of TOML files, with limits on size, nesting and numbers."""

from __future__ import annotations

import re
import tomllib
from typing import Any

from pamjax.errors import BadInput
from pamjax.records.files import decode_text

#: Largest file, bytes: about 20,000 lines. Python's reader needs seconds for larger ones.
_MAX_TOML_BYTES = 1_000_000
#: Longest line; the reader's time grows with the square of the number of keys in a dotted name.
_MAX_LINE_CHARACTERS = 10_000
#: A number with a decimal comma, as in "turns = 1,45", and the line of an error in the reader's message.
_TOML_COMMA_PATTERN, _LINE_PATTERN = re.compile(r"=\s*([+-]?\d+),(\d+)"), re.compile(r"at line (\d+)")
#: Largest whole number that TOML has.
_MAX_TOML_INTEGER = 2**63 - 1


def parse_toml(
    raw: bytes, file: str, remedy: str = "Write a text in double quotes, and a table name in [brackets]."
) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Args:
        raw: bytes of the file.
        file: name of the file, for the messages.
        remedy: instruction to the user, if the text is not TOML.

    Raises:
        BadInput: if it is not TOML, too large, nested too deeply, or has a whole number of more than 64 bits.
    """
    if len(raw) > _MAX_TOML_BYTES:
        raise BadInput.from_rule(
            f"{file} must have at most 1 MB", f"{len(raw) / 1e6:.1f} MB", remedy="Remove entries."
        )
    text = decode_text(raw, file).replace("\r\n", "\n")
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > _MAX_LINE_CHARACTERS:
            rule = f"a line must have at most {_MAX_LINE_CHARACTERS} characters"
            raise BadInput.from_rule(rule, f"{len(line)}", f"line {number} of {file}", "Break the line.")
    try:
        document = tomllib.loads(text)
    except RecursionError as error:
        rule = f"{file} must not have deeply nested brackets"
        raise BadInput.from_rule(rule, remedy="Close each bracket.") from error
    # TOMLDecodeError is a ValueError; Python refuses numbers of more than 4300 digits with a plain one.
    except ValueError as error:
        got = str(error)[:1].lower() + str(error)[1:].rstrip(".")
        if not isinstance(error, tomllib.TOMLDecodeError):
            got = "a number with thousands of digits"
        remedy = _suggest_point(text, got) or remedy
        raise BadInput.from_rule(f"{file} must be TOML", got, remedy=remedy) from error
    _check_integers(document, "", file)
    return document


def _suggest_point(text: str, message: str) -> str:
    """Return the remedy if the line of an error has a decimal comma; else an empty string."""
    line = _LINE_PATTERN.search(message)
    comma = _TOML_COMMA_PATTERN.search(text.split("\n")[int(line[1]) - 1]) if line else None
    return f"The decimal mark is a point: write {comma[1]}.{comma[2]}." if comma else ""


def _check_integers(value: Any, name: str, file: str) -> None:
    """Refuse a whole number that TOML does not have, and that no float can hold."""
    if isinstance(value, dict):
        for key, part in value.items():
            _check_integers(part, key, file)
    elif isinstance(value, list):
        for part in value:
            _check_integers(part, name, file)
    elif isinstance(value, int) and abs(value) > _MAX_TOML_INTEGER:
        got = f"a number of {len(str(abs(value)))} digits"
        raise BadInput.from_rule(f"`{name}` must be a whole number below 2^63", got, file, "Remove digits.")

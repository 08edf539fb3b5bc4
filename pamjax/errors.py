"""Error messages for bad input: one message with rule, value, place and remedy."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

#: Shortest word that is searched inside the valid names.
MIN_PART_CHARACTERS = 4

#: Longest part of a message; a longer one is cut.
MAX_PART_CHARACTERS = 400

#: Characters that end a line or that a terminal obeys.
_CONTROL_PATTERN = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")


class BadInput(ValueError):
    """An invalid input; its text is the message for the user.

    The command line prints it to standard error and exits with code 2.
    """

    @classmethod
    def from_rule(cls, rule: str, got: str = "", where: str = "", remedy: str = "") -> BadInput:
        """Return the exception for a broken rule; the arguments are those of `compose_message`."""
        return cls(compose_message(rule, got, where, remedy))


class InputWarning(UserWarning):
    """A warning about a doubtful input that is still used."""


def compose_message(rule: str, got: str = "", where: str = "", remedy: str = "") -> str:
    """Return a message with rule, value, place and remedy in this order.

    Args:
        rule: the condition, as "`length` must be shorter than the thread (300 mm)".
        got: the actual value, with its unit.
        where: file, row and column, as "row 41 of recording.csv".
        remedy: instruction to the user, in the imperative; "" if the rule itself states what to write, as
            "`seed` must be at least 0".

    >>> compose_message("`length` must be positive", "-3 mm", "row 4 of a.csv", "Check its sign.")
    '`length` must be positive; got -3 mm in row 4 of a.csv. Check its sign.'

    Control characters are printed as escapes, and long parts are cut.
    """
    rule, got, where, remedy = map(format_printable, (rule, got, where, remedy))
    text = rule
    if got:
        text += f"; got {got}"
    if where:
        text += f" in {where}" if got else f" ({where})"
    text = f"{text.rstrip('.')}. {remedy}".rstrip()
    # A remedy that was cut is a sentence, too.
    return f"{text}." if text.endswith("…") else text


def format_printable(text: str, limit: int = MAX_PART_CHARACTERS) -> str:
    """Return a text without control characters and with at most `limit` characters.

    >>> format_printable("a\\nb"), format_printable("x" * 10, limit=3)
    ('a\\\\nb', 'xxx…')
    """
    if len(text) > limit:
        text = f"{text[:limit]}…"
    return _CONTROL_PATTERN.sub(lambda match: repr(match[0])[1:-1], text)


def check_minimum(name: str, value: int, minimum: int) -> None:
    """Refuse a count that is too small.

    Raises:
        BadInput: with the name of the count.
    """
    if value < minimum:
        raise BadInput.from_rule(f"`{name}` must be at least {minimum}", f"{value}")


def suggest_word(word: str, valid_names: Iterable[str], listing: str = "") -> str:
    """Return a hint with the most similar valid name, or with all valid names.

    Args:
        word: the invalid name.
        valid_names: the valid names.
        listing: command that lists the valid names, if they are too many for a message.

    >>> suggest_word("trheads", ["threads", "turns"])
    'Did you mean `threads`?'
    >>> suggest_word("xyz", ["threads", "turns"], listing="pamjax explain")
    '`pamjax explain` lists all names.'
    """
    valid_names = list(valid_names)
    matches = difflib.get_close_matches(word, valid_names, n=1, cutoff=0.6)
    if not matches and len(word) >= MIN_PART_CHARACTERS:
        matches = sorted((name for name in valid_names if word in name), key=len)[:1]
    if matches:
        return f"Did you mean `{matches[0]}`?"
    if listing:
        return f"`{listing}` lists all names."
    return "Valid names are " + ", ".join(f"`{name}`" for name in valid_names) + "."

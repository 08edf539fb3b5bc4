"""Error messages for bad input: one message with rule, value, place and remedy."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class BadInput(ValueError):
    """An input that cannot be used; its text is the message that the user reads.

    The command line prints it to standard error and exits with code 2.
    """


class InputWarning(UserWarning):
    """A warning about an input that is used nevertheless."""


def compose_message(rule: str, got: str = "", where: str = "", remedy: str = "") -> str:
    """Return a message with rule, value, place and remedy in this order.

    Args:
        rule: what must hold, as "`length` must be shorter than the thread (300 mm)".
        got: the actual value, with its unit.
        where: file, row and column, as "row 41 of recording.csv".
        remedy: what the user should do, in the imperative.

    >>> compose_message("`length` must be positive", "-3 mm", "row 4 of a.csv", "Check its sign.")
    '`length` must be positive; got -3 mm in row 4 of a.csv. Check its sign.'
    """
    text = rule
    if got:
        text += f"; got {got}"
    if where:
        text += f" in {where}" if got else f" ({where})"
    text = text.rstrip(".") + "."
    return f"{text} {remedy}".rstrip()


def refuse(rule: str, got: str = "", where: str = "", remedy: str = "") -> BadInput:
    """Return the exception for a broken rule; the caller raises it."""
    return BadInput(compose_message(rule, got, where, remedy))


def check_minimum(name: str, value: int, least: int) -> None:
    """Refuse a count that is too small.

    Raises:
        BadInput: with the name of the count.
    """
    if value < least:
        raise refuse(f"`{name}` must be at least {least}", f"{value}")


def suggest_word(word: str, known: Iterable[str], listing: str = "") -> str:
    """Return a hint with the most similar valid name, or with all valid names.

    Args:
        word: the name that was written.
        known: the valid names.
        listing: command that lists the valid names, if they are too many for a message.

    >>> suggest_word("trheads", ["threads", "turns"])
    'Did you mean `threads`?'
    >>> suggest_word("xyz", ["threads", "turns"], listing="pamjax explain")
    '`pamjax explain` lists what there is.'
    """
    known = list(known)
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    if close:
        return f"Did you mean `{close[0]}`?"
    if listing:
        return f"`{listing}` lists what there is."
    return "Known are " + ", ".join(f"`{k}`" for k in known) + "."

"""How a bad input is told: one sentence with rule, what was got, where, and what to do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class BadInput(ValueError):
    """An input that cannot be used; its text is the one sentence a user reads.

    The command line prints it to standard error and exits with code 2.
    """


class InputWarning(UserWarning):
    """An input that is used all the same, but about which the user should know."""


def compose_message(rule: str, got: str = "", where: str = "", remedy: str = "") -> str:
    """Put the four parts of a complaint into the one order every complaint has.

    Args:
        rule: what must hold, as "`length` must be shorter than the thread (300 mm)".
        got: what was found instead, with its unit.
        where: file, row and column, as "row 41 of recording.csv".
        remedy: what to do about it, one imperative sentence.

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
    """The exception for a broken rule, to be raised by the caller."""
    return BadInput(compose_message(rule, got, where, remedy))


def check_minimum(name: str, value: int, least: int) -> None:
    """Refuse a count that is too small.

    Raises:
        BadInput: naming it.
    """
    if value < least:
        raise refuse(f"`{name}` must be at least {least}", f"{value}")


def suggest_word(word: str, known: Iterable[str], listing: str = "") -> str:
    """A hint that names the nearest known word, or lists the known ones.

    Args:
        word: what was written.
        known: what could have been.
        listing: command that lists them, where they are too many for a sentence.

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

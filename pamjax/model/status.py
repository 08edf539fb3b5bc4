"""Outcomes: what became of a computation, a number in an array whose text is the help."""

from __future__ import annotations

from enum import IntEnum


class Outcome(IntEnum):
    """A kind of outcome; 0 is success. A member is written `NAME = number, "what it says in a report"`."""

    says: str

    def __new__(cls, value: int, says: str):
        one = int.__new__(cls, value)
        one._value_, one.says = value, says
        return one

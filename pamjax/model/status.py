"""Outcomes: what became of a computation, a number in an array whose text is the help."""

from __future__ import annotations

from enum import IntEnum


class StatusCode(IntEnum):
    """A kind of outcome; 0 is success. A member is written `NAME = number, "what it says in a report"`."""

    message: str

    def __new__(cls, value: int, message: str):
        member = int.__new__(cls, value)
        member._value_, member.message = value, message
        return member

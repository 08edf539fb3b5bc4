"""Status codes: numbers for arrays, each with a message for reports."""

from __future__ import annotations

from enum import IntEnum


class StatusCode(IntEnum):
    """A set of status codes; 0 is success. A member is `NAME = number, "message for reports"`."""

    message: str

    def __new__(cls, value: int, message: str):
        member = int.__new__(cls, value)
        member._value_, member.message = value, message
        return member

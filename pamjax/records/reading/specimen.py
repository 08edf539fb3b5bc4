"""Origin of a recording: rig, serial number, type of the muscle, and day."""

from __future__ import annotations

import datetime
from dataclasses import dataclass, fields, replace
from typing import Any

from pamjax.errors import BadInput

#: Largest number of characters of a name of a bench, a serial number or a type.
_MAX_LABEL_LENGTH = 80


@dataclass(frozen=True)
class Specimen:
    """Origin of a recording; None if not stated.

    Attributes:
        bench: rig that recorded it.
        serial: serial number of the specimen.
        type: type of the muscle.
        date: day of the recording.
    """

    bench: str | None = None
    serial: str | None = None
    type: str | None = None
    date: datetime.date | None = None

    def update(self, other: Specimen) -> Specimen:
        """Return this origin, with the stated entries of another one in place of its own."""
        stated = {f.name: getattr(other, f.name) for f in fields(other) if getattr(other, f.name) is not None}
        return replace(self, **stated)


def read_label(raw: Any) -> str | None:
    """Return a name of a bench, a serial number or a type; a whole number becomes a text.

    Raises:
        BadInput: with the rule alone; the caller adds entry and file.
    """
    if raw is None:
        return None
    if isinstance(raw, bool) or not isinstance(raw, str | int) or not str(raw).strip():
        raise BadInput("must be a text in quotes or a whole number")
    text = " ".join(str(raw).split())
    if len(text) > _MAX_LABEL_LENGTH or not text.isprintable():
        raise BadInput(f"must be one line of at most {_MAX_LABEL_LENGTH} characters")
    return text


def read_date(raw: Any) -> datetime.date | None:
    """Return a day, from TOML's date, or from a text such as "2026-03-02".

    Raises:
        BadInput: with the rule alone; the caller adds entry and file.
    """
    if isinstance(raw, datetime.datetime):
        return raw.date()
    if raw is None or isinstance(raw, datetime.date):
        return raw
    try:
        return datetime.date.fromisoformat(str(raw).strip())
    except ValueError as error:
        raise BadInput("must be a day such as 2026-03-02") from error

"""Channels of a recording: the quantity that each measures, its SI unit and its display unit."""

from __future__ import annotations

from dataclasses import dataclass

from pamjax.units import compute_si_factor, format_quantity


@dataclass(frozen=True)
class Channel:
    """One column of a recording.

    Attributes:
        name: name of the column.
        kind: kind of quantity, a key of `SI_UNITS`.
        si_unit: unit in arrays.
        display_unit: unit in reports, figures and files.
        about: the measured quantity.
    """

    name: str
    kind: str
    si_unit: str
    display_unit: str
    about: str

    @property
    def header(self) -> str:
        """Return the default header of the column."""
        return self.name if self.kind == "count" else f"{self.name} [{self.display_unit}]"


CHANNEL_BY_NAME = {
    channel.name: channel
    for channel in (
        Channel("time", "time", "s", "s", "time"),
        Channel("pressure", "pressure", "Pa", "kPa", "gauge pressure"),
        Channel("length", "length", "m", "mm", "distance between the fittings"),
        Channel("force", "force", "N", "N", "tension"),
        Channel("diameter", "length", "m", "mm", "outer mean diameter"),
        Channel("cycle", "count", "1", "1", "stroke, step or test"),
    )
}

#: SI unit of each channel that has a unit.
SI_UNIT = {c.name: c.si_unit for c in CHANNEL_BY_NAME.values() if c.kind != "count"}

#: Display unit of each channel that has a unit.
DISPLAY_UNIT = {c.name: c.display_unit for c in CHANNEL_BY_NAME.values() if c.kind != "count"}


def to_display(channel: str, value):
    """Return a value or an array, SI, converted to the display unit of the channel.

    >>> to_display("diameter", 0.0254)
    25.4
    """
    return value / compute_si_factor(DISPLAY_UNIT[channel])


def format_channel_value(value: float, channel: str) -> str:
    """Return a value of a channel, SI, as text in the channel's display unit.

    >>> format_channel_value(2.21e-5, "diameter")
    '0.0221 mm'
    """
    return format_quantity(value, DISPLAY_UNIT[channel], 3)

"""Numbers of mechanisms as a person types them: "force_offset.offset=5 N"."""

from __future__ import annotations

from collections.abc import Iterable

from pamjax.check import refuse
from pamjax.model.catalogue import meaning
from pamjax.units import number_in, show


def settings(written: Iterable[str]) -> dict[str, float]:
    """Values by name, SI.

    Args:
        written: each "id.number=value unit"; a bare value is in the number's SI unit.

    Raises:
        BadInput: for an unknown number, a unit of another dimension, or a value outside the limits.
    """
    return dict(_one(text) for text in written)


def _one(text: str) -> tuple[str, float]:
    name, equals, quantity = text.partition("=")
    if not equals:
        raise refuse("a number of a mechanism is written id.number=value", f"{text!r}", "--with")
    about = meaning(name.strip())
    value = number_in(quantity, about.unit, f"--with {name}")
    if not about.low <= value <= about.high:
        rule = f"`{name}` lies between {show(about.low, about.show)} and {show(about.high, about.show)}"
        raise refuse(rule, show(value, about.show), "--with")
    return name.strip(), value

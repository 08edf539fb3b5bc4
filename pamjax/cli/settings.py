"""What a person types as name=value: numbers of mechanisms, and words that hold for one of several cases."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pamjax.errors import nearest, refuse
from pamjax.units import number_in, show

if TYPE_CHECKING:
    from pamjax.records.case import Case


def settings(written: Iterable[str]) -> dict[str, float]:
    """Values by name, SI.

    Args:
        written: each "id.number=value unit"; a bare value where the number has no unit.

    Raises:
        BadInput: for an unknown number, a unit that is missing or of another dimension, or a value outside
            the limits.
    """
    return dict(_one(text) for text in written)


def _one(text: str) -> tuple[str, float]:
    from pamjax.model.parameters import meaning

    name, equals, quantity = text.partition("=")
    if not equals:
        raise refuse("a number of a mechanism is written id.number=value", f"{text!r}", "--with")
    about = meaning(name.strip(), "--with")
    value = number_in(quantity, about.unit, f"--with {name}")
    if not about.low <= value <= about.high:
        rule = f"`{name}` lies between {show(about.low, about.show)} and {show(about.high, about.show)}"
        raise refuse(rule, show(value, about.show), "--with")
    return name.strip(), value


def read_each(cases: Sequence[Path], gaps: Sequence[str] | None, before: Sequence[str] | None) -> list[Case]:
    """Read case folders, with what `--gaps` and `--before` say of each.

    Raises:
        BadInput: as `read_case` and `of_each`.
    """
    from pamjax.records.case import read_case

    jumps = of_each(cases, gaps, "carry", "--gaps")
    begins = of_each(cases, before, "relaxed", "--before")
    return [read_case(f, gaps=g, before=b) for f, g, b in zip(cases, jumps, begins, strict=True)]


def of_each(cases: Sequence[Path], said: Sequence[str] | None, usual: str, option: str) -> list[str]:
    """The word that holds for each case: "word" for all, or "name=word" for one.

    Raises:
        BadInput: for the name of no case.
    """
    words = dict.fromkeys((folder.resolve().name for folder in cases), usual)
    # What is said of one case is heard after what is said of all, wherever it stands.
    for text in sorted(said or (), key=lambda text: "=" in text):
        name, equals, word = text.partition("=")
        if not equals:
            words = dict.fromkeys(words, text)
        elif name not in words:
            raise refuse(f"{name!r} is no case of this fit", where=option, remedy=nearest(name, words))
        else:
            words[name] = word
    return [words[folder.resolve().name] for folder in cases]

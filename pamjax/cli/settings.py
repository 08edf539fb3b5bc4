"""What a person types as name=value: numbers of mechanisms, and words that hold for one of several cases."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pamjax.errors import refuse, suggest_word
from pamjax.units import format_quantity, parse_number

if TYPE_CHECKING:
    from pamjax.records.case import Case


def parse_settings(written: Iterable[str]) -> dict[str, float]:
    """Values by name, SI.

    Args:
        written: each "id.number=value unit"; a bare value where the number has no unit.

    Raises:
        BadInput: for an unknown number, a unit that is missing or of another dimension, or a value outside
            the limits.
    """
    return dict(_parse_setting(text) for text in written)


def _parse_setting(text: str) -> tuple[str, float]:
    from pamjax.model.parameters import find_meaning

    name, equals, quantity = text.partition("=")
    if not equals:
        raise refuse("a number of a mechanism is written id.number=value", f"{text!r}", "--with")
    number_meaning = find_meaning(name.strip(), "--with")
    value = parse_number(quantity, number_meaning.unit, f"--with {name}")
    if not number_meaning.low <= value <= number_meaning.high:
        rule = (
            f"`{name}` lies between {format_quantity(number_meaning.low, number_meaning.show)} and"
            f" {format_quantity(number_meaning.high, number_meaning.show)}"
        )
        raise refuse(rule, format_quantity(value, number_meaning.show), "--with")
    return name.strip(), value


def read_cases(cases: Sequence[Path], gaps: Sequence[str] | None, before: Sequence[str] | None) -> list[Case]:
    """Read case folders, with what `--gaps` and `--before` say of each.

    Raises:
        BadInput: as `read_case` and `assign_to_cases`.
    """
    from pamjax.records.case import read_case

    jumps = assign_to_cases(cases, gaps, "carry", "--gaps")
    begins = assign_to_cases(cases, before, "relaxed", "--before")
    return [
        read_case(folder, gaps=case_gaps, before=case_before)
        for folder, case_gaps, case_before in zip(cases, jumps, begins, strict=True)
    ]


def assign_to_cases(
    cases: Sequence[Path], option_words: Sequence[str] | None, default: str, option: str
) -> list[str]:
    """The word that holds for each case: "word" for all, or "name=word" for one.

    Raises:
        BadInput: for the name of no case.
    """
    words = dict.fromkeys((folder.resolve().name for folder in cases), default)
    # What is said of one case is heard after what is said of all, wherever it stands.
    for text in sorted(option_words or (), key=lambda text: "=" in text):
        name, equals, word = text.partition("=")
        if not equals:
            words = dict.fromkeys(words, text)
        elif name not in words:
            raise refuse(f"{name!r} is no case of this fit", where=option, remedy=suggest_word(name, words))
        else:
            words[name] = word
    return [words[folder.resolve().name] for folder in cases]

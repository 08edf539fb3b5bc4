"""Options of the form name=value: parameters of mechanisms, and words for single cases."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pamjax.errors import BadInput, suggest_word
from pamjax.units import format_quantity, parse_number

if TYPE_CHECKING:
    from pamjax.records.case import Case


def parse_parameter_values(texts: Iterable[str]) -> dict[str, float]:
    """Return values by parameter name, SI.

    Args:
        texts: each "mechanism.parameter=value unit", or without unit if the parameter has none.

    Raises:
        BadInput: for an unknown parameter, a missing or wrong unit, or a value outside the limits.
    """
    return dict(_parse_parameter_value(text) for text in texts)


def _parse_parameter_value(text: str) -> tuple[str, float]:
    from pamjax.model.parameters import find_meaning

    name, equals, quantity = text.partition("=")
    if not equals:
        raise BadInput.from_rule(
            "a value must have the form mechanism.parameter=value",
            f"{text!r}",
            "--with",
            "Write it as braid_friction.coefficient=0.2.",
        )
    meaning = find_meaning(name.strip(), "--with")
    value = parse_number(quantity, meaning.unit, f"--with {name}")
    if not meaning.low <= value <= meaning.high:
        rule = (
            f"`{name}` must be between {format_quantity(meaning.low, meaning.show)} and"
            f" {format_quantity(meaning.high, meaning.show)}"
        )
        raise BadInput.from_rule(rule, format_quantity(value, meaning.show), "--with")
    return name.strip(), value


def read_cases(cases: Sequence[Path], gaps: Sequence[str] | None, before: Sequence[str] | None) -> list[Case]:
    """Read case folders with their words of `--gaps` and `--before`.

    Raises:
        BadInput: as `read_case` and `assign_to_cases`.
    """
    from pamjax.records.case import read_case

    case_gaps = assign_to_cases(cases, gaps, "carry", "--gaps")
    case_states = assign_to_cases(cases, before, "relaxed", "--before")
    return [
        read_case(folder, gaps=gap, before=state)
        for folder, gap, state in zip(cases, case_gaps, case_states, strict=True)
    ]


def assign_to_cases(
    cases: Sequence[Path], option_words: Sequence[str] | None, default: str, option: str
) -> list[str]:
    """Return the word of an option for each case: "word" is for all cases, "name=word" for one.

    Raises:
        BadInput: for an unknown case.
    """
    words = dict.fromkeys((folder.resolve().name for folder in cases), default)
    # A word for one case overrides a word for all cases, in any order.
    for text in sorted(option_words or (), key=lambda text: "=" in text):
        name, equals, word = text.partition("=")
        if not equals:
            words = dict.fromkeys(words, text)
        elif name not in words:
            raise BadInput.from_rule(f"unknown case {name!r}", where=option, remedy=suggest_word(name, words))
        else:
            words[name] = word
    return [words[folder.resolve().name] for folder in cases]

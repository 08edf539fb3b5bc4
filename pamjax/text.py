"""Lists of words in sentences."""

from __future__ import annotations

from collections.abc import Sequence


def join_words(words: Sequence[str]) -> str:
    """Return words as one text, with "and" before the last.

    >>> join_words(["force", "diameter", "time"])
    'force, diameter and time'
    """
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)

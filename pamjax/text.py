"""Lists of words, and p-values, in sentences."""

from __future__ import annotations

from collections.abc import Sequence

#: A smaller p-value is shown as below this one.
_MIN_SHOWN_P_VALUE = 1e-12


def join_words(words: Sequence[str]) -> str:
    """Return words as one text, with "and" before the last.

    >>> join_words(["force", "diameter", "time"])
    'force, diameter and time'
    """
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def format_p_value(p: float) -> str:
    """Return a p-value as text.

    >>> format_p_value(0.4321), format_p_value(1e-40)
    ('p = 0.43', 'p < 1e-12')
    """
    return f"p < {_MIN_SHOWN_P_VALUE:g}" if p < _MIN_SHOWN_P_VALUE else f"p = {p:.2g}"

"""Standard streams and devices of the process: closed streams, narrow encodings, missing devices."""

from __future__ import annotations

import codecs
import os
import sys
import unicodedata

#: Replacements for characters that a narrow encoding lacks.
_PLAIN_TEXTS = {
    "±": "+/-",
    "→": "->",
    "×": "x",
    "−": "-",
    "–": "-",
    "·": "*",
    "²": "^2",
    "³": "^3",
    "°": " deg",
    "…": "...",
    "µ": "u",
    "≤": "<=",
    "≥": ">=",
    "\N{COMBINING CIRCUMFLEX ACCENT}": "",
    "π": "pi",
    "θ": "theta",
    "λ": "lambda",
    "ρ": "rho",
    "√": "sqrt",
    "∞": "infinity",
}


def replace_characters(error: UnicodeError) -> tuple[str, int]:
    """Return a plain text for characters that an encoding lacks, as `codecs.register_error` requires.

    >>> _ = codecs.register_error("pamjax_plain", replace_characters)
    >>> "84.4 ± 3.7 GPa, R\\u0302, Sárosi".encode("ascii", "pamjax_plain")
    b'84.4 +/- 3.7 GPa, R, Sarosi'
    """
    if not isinstance(error, UnicodeEncodeError):
        raise error
    plain = "".join(map(_replace_character, error.object[error.start : error.end]))
    return plain, error.end


def _replace_character(character: str) -> str:
    if character in _PLAIN_TEXTS:
        return _PLAIN_TEXTS[character]
    # The base letter of a letter with an accent.
    letters = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
    return letters or "?"


def prepare_streams() -> None:
    """Give the process two streams that accept every text.

    A closed stream is replaced by one without a reader. A stream with a narrow encoding replaces the
    characters that it lacks, so that no result is lost in an error about an encoding.
    """
    codecs.register_error("pamjax_plain", replace_characters)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="pamjax_plain")


def describe_missing_device() -> str:
    """Return the message for a platform of JAX_PLATFORMS without a device; empty if JAX has its devices."""
    platforms = os.environ.get("JAX_PLATFORMS", "")
    if not platforms or "jax" not in sys.modules:
        return ""
    import jax

    from pamjax.errors import compose_message

    try:
        jax.devices()
    # JAX raises errors of several types here, among them a bare AssertionError.
    except Exception:
        rule = "JAX must have a device of the platform in JAX_PLATFORMS"
        remedy = "Unset JAX_PLATFORMS, or write JAX_PLATFORMS=cpu."
        return compose_message(rule, repr(platforms), "the environment, without such a device", remedy)
    return ""

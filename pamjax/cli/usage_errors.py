"""Messages for unknown commands and options, and names of options in the messages of the library."""

from __future__ import annotations

import difflib
import re

from cyclopts import (
    CycloptsError,
    MissingArgumentError,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
)

from pamjax.errors import compose_message, suggest_word

#: Smallest similarity of an option to be suggested, as `difflib` measures it.
_MIN_SIMILARITY = 0.7

#: Parameters of the library in a message, as patterns, and the options that set them.
_PARAMETER_PATTERNS = {
    r"`(law|case|to)`": r"`--\1`",
    r"`fold_count`": "`folds`",
    r'`mechanisms=\["(\w+)"\]`': r"`--with \1`",
    r'`loss="(\w+)"`': r"`--loss \1`",
}


def name_options(message: str) -> str:
    """Return a message of the library with the options of the command line in place of its parameters.

    >>> name_options("`case` needs a fit.json. Omit `case`.")
    '`--case` needs a fit.json. Omit `--case`.'
    """
    for pattern, option in _PARAMETER_PATTERNS.items():
        message = re.sub(pattern, option, message)
    return message


def format_usage_error(error: CycloptsError) -> str:
    """Return the message for a wrong command line."""
    program = " ".join(["pamjax", *(error.command_chain or ())])
    if isinstance(error, UnknownCommandError):
        return _format_unknown_command((error.unused_tokens or [""])[0], error)
    if isinstance(error, UnknownOptionError):
        return _format_unknown_option(error, program)
    if isinstance(error, UnusedCliTokensError):
        tokens = " ".join(error.unused_tokens or ())
        rule = f"unexpected argument {tokens!r} of `{program}`"
        return compose_message(rule, remedy=f"See `{program} --help`.")
    if isinstance(error, MissingArgumentError) and error.argument is not None:
        name = f"`{error.argument.name}`"
        rule = f"`{program}` needs {name}" if error.argument.required else f"{name} needs a value"
        return compose_message(rule, "none", remedy=f"See `{program} --help`.")
    return str(error)


def _format_unknown_command(token: str, error: CycloptsError) -> str:
    if token.startswith("-"):
        return compose_message(f"unknown option `{token}` of `pamjax`", remedy="See `pamjax --help`.")
    valid_names = [name for name in error.app or () if not name.startswith("-")]
    return compose_message(f"unknown command `{token}` of `pamjax`", remedy=suggest_word(token, valid_names))


def _format_unknown_option(error: UnknownOptionError, program: str) -> str:
    token = error.token.keyword or error.token.value or ""
    valid_options = [
        name for argument in error.argument_collection for name in argument.names if name.startswith("--")
    ]
    close = difflib.get_close_matches(token.partition("=")[0], valid_options, n=1, cutoff=_MIN_SIMILARITY)
    remedy = f"Did you mean `{close[0]}`?" if close else f"See `{program} --help`."
    return compose_message(f"unknown option `{token}` of `{program}`", remedy=remedy)

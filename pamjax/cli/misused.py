"""What a misspelt command or option is told."""

from __future__ import annotations

import difflib

from cyclopts import CycloptsError, UnknownCommandError, UnknownOptionError, UnusedCliTokensError

from pamjax.errors import nearest, sentence

#: How alike two options must be for one to be what was meant: those below share little but a few letters.
ALIKE = 0.7


def told(error: CycloptsError) -> str:
    """What is wrong with a command line, in one sentence."""
    of = " ".join(["pamjax", *(error.command_chain or ())])
    if isinstance(error, UnknownCommandError):
        return _command((error.unused_tokens or [""])[0], error)
    if isinstance(error, UnknownOptionError):
        return _option(error, of)
    if isinstance(error, UnusedCliTokensError):
        got = " ".join(error.unused_tokens or ())
        return sentence(f"`{of}` has no place for {got!r}", remedy=f"See `{of} --help`.")
    return str(error)


def _command(got: str, error: CycloptsError) -> str:
    if got.startswith("-"):
        return sentence(f"`{got}` is no option of `pamjax`", remedy="See `pamjax --help`.")
    known = [name for name in error.app or () if not name.startswith("-")]
    return sentence(f"`{got}` is no command of `pamjax`", remedy=nearest(got, known))


def _option(error: UnknownOptionError, of: str) -> str:
    got = error.token.keyword or error.token.value or ""
    known = [name for one in error.argument_collection for name in one.names if name.startswith("--")]
    close = difflib.get_close_matches(got.partition("=")[0], known, n=1, cutoff=ALIKE)
    remedy = f"Did you mean `{close[0]}`?" if close else f"See `{of} --help`."
    return sentence(f"`{got}` is no option of `{of}`", remedy=remedy)

"""Display of results in a notebook: the same text as `print`, in a fixed-width font."""

from __future__ import annotations

from html import escape


class NotebookText:
    """A result that a notebook shows as its text; `repr` is the text's first line."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {str(self).partition(chr(10))[0]}>"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"

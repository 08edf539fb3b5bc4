"""Options that several words have, each typed in one way."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

#: Answer as one JSON document.
Json = Annotated[bool, Parameter(negative="")]

#: Several words after one option, or the option several times.
Words = Annotated[list[str] | None, Parameter(consume_multiple=True, negative="")]

#: The same as `--with`, which is no name in Python.
With = Annotated[list[str] | None, Parameter(name="--with", consume_multiple=True, negative="")]

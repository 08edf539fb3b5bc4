"""Options that several words have, each typed in one way."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from pamjax.errors import refuse

if TYPE_CHECKING:
    from pamjax.records.case import Case

#: Answer as one JSON document.
Json = Annotated[bool, Parameter(negative="")]

#: Several words after one option, or the option several times.
WordList = Annotated[list[str] | None, Parameter(consume_multiple=True, negative="")]

#: The same as `--with`, which is no name in Python.
MechanismList = Annotated[list[str] | None, Parameter(name="--with", consume_multiple=True, negative="")]


@Parameter(name="*")
@dataclass(frozen=True)
class ModelOptions:
    """What is held against recordings, and what became of the muscle between and before their samples.

    Attributes:
        law: thread law: inelastic, elastic, toe, exponential-toe or recruitment-toe; the case's
            baseline if left out.
        share: numbers that several cases have in common, as thread.modulus.
        with_: mechanisms that act beside the threads, as bladder_elasticity; `pamjax explain` lists them.
        gaps: where the recording jumps, memory goes on ("carry", taken if left out) or begins "anew": a new
            specimen, or a long rest. For one of several cases: name=anew.
        before: before its first sample the muscle was at rest ("relaxed", taken if left out), or "settled":
            it had been through the same once. For one of several cases: name=settled.
    """

    law: str | None = None
    share: WordList = None
    with_: MechanismList = None
    gaps: WordList = None
    before: WordList = None

    def read_cases(self, cases: list[Path]) -> list[Case]:
        """The cases, with what is said of their memory.

        Raises:
            BadInput: as `settings.read_cases`, or where one case alone is to share a number.
        """
        from pamjax.cli.settings import read_cases

        if self.share and len(cases) < 2:
            rule, remedy = (
                "`--share` says what several cases have in common",
                "Name the others, or leave it out.",
            )
            raise refuse(rule, "one case", remedy=remedy)

        return read_cases(cases, self.gaps, self.before)

    @property
    def fit_arguments(self) -> tuple[str | None, list[str], list[str]]:
        """Law, shared numbers, mechanisms: what a fit begins with."""
        return self.law, self.share or [], self.with_ or []


#: Nothing asked: each case's own baseline.
DEFAULT_MODEL = ModelOptions()

"""Options that several commands share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from pamjax.errors import BadInput

if TYPE_CHECKING:
    from pamjax.records.case import Case

#: Print one JSON document.
Json = Annotated[bool, Parameter(negative="")]

#: Several values after one option, or the option several times.
WordList = Annotated[list[str] | None, Parameter(consume_multiple=True, negative="")]

#: The same under the name `--with`, which is a keyword in Python.
MechanismList = Annotated[list[str] | None, Parameter(name="--with", consume_multiple=True, negative="")]

#: The same under two names, the second one of earlier versions.
MechanismPair = Annotated[
    list[str] | None, Parameter(name=("--distinguish", "--tell"), consume_multiple=True, negative="")
]


@Parameter(name="*")
@dataclass(frozen=True)
class ModelOptions:
    """Model of the muscle, and its state before and between the samples of a recording.

    Attributes:
        law: thread law: inelastic, elastic, toe, exponential-toe or recruitment-toe; by default that of the
            case's baseline model.
        share: parameters that several cases share, such as thread.modulus.
        with_: mechanisms to include in the model, such as bladder_elasticity; `pamjax explain` lists them.
        gaps: memory of friction and relaxation at a jump of the recording. "carry" keeps it (default), "anew"
            resets it, for a new specimen or after a long rest. For one of several cases: name=anew.
        before: state before the first sample: "relaxed" (default) for a muscle at rest, "settled" if the
            muscle has run through the same recording once. For one of several cases: name=settled.
    """

    law: str | None = None
    share: WordList = None
    with_: MechanismList = None
    gaps: WordList = None
    before: WordList = None

    def read_cases(self, cases: list[Path]) -> list[Case]:
        """Return the cases, with the state of their memory.

        Raises:
            BadInput: as `name_value_options.read_cases`, or for `--share` with one case only.
        """
        from pamjax.cli.name_value_options import read_cases

        if self.share and len(cases) < 2:
            rule, remedy = "`--share` needs several cases", "Name the other cases, or remove the option."
            raise BadInput.from_rule(rule, "one case", remedy=remedy)

        return read_cases(cases, self.gaps, self.before)

    @property
    def fit_arguments(self) -> tuple[str | None, list[str], list[str]]:
        """Return law, shared parameters and mechanisms."""
        return self.law, self.share or [], self.with_ or []


#: The baseline model of each case.
DEFAULT_MODEL = ModelOptions()

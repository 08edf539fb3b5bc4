"""What to do next: the protocol that separates what this recording cannot tell apart, with its power."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Experiment:
    """A protocol that separates two names.

    Attributes:
        protocol: what to do, one sentence.
        separates: the ids.
        power: chance that it settles which, at a false alarm of one in twenty.
    """

    protocol: str
    separates: tuple[str, ...]
    power: float

    def as_dict(self) -> dict[str, Any]:
        """As it stands in diagnosis.json."""
        return {"protocol": self.protocol, "separates": list(self.separates), "power": self.power}

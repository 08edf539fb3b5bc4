"""Explanation of a parameter or a mechanism, as `pamjax explain` prints it."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from pamjax.drawing import DrawableResult
from pamjax.errors import BadInput, suggest_word
from pamjax.model.parameters import list_meanings_by_law, list_parameters
from pamjax.model.registry import ALTERNATIVE_EQUATIONS, MECHANISMS, list_mechanisms
from pamjax.notebook import NotebookText
from pamjax.parameter import Meaning
from pamjax.units import compute_si_factor

LINE_WIDTH = 96


@dataclass(frozen=True, repr=False)
class Explanation(DrawableResult, NotebookText):
    """Explanation of a parameter or a mechanism, or of all of them; prints as a text.

    `plot` draws the effect of a mechanism on force and diameter.

    Attributes:
        name: the parameter or the mechanism; None for all.
        text: the explanation.
    """

    name: str | None
    text: str

    def as_dict(self) -> dict[str, Any]:
        """Return parameters (SI) and mechanisms by name, as `pamjax explain --json` prints them."""
        parameters, mechanisms = list_parameters(), list_mechanisms()
        if self.name is not None:
            parameters = {
                name: meaning
                for name, meaning in parameters.items()
                if name == self.name or name.startswith(f"{self.name}.")
            }
            mechanisms = {name: kind for name, kind in mechanisms.items() if name == self.name}
        return {
            "numbers": {name: asdict(meaning) for name, meaning in parameters.items()},
            "mechanisms": {name: asdict(kind.about) for name, kind in mechanisms.items()},
        }

    def __str__(self) -> str:
        return self.text


def explain(name: str | None = None) -> Explanation:
    """Return the explanation of a parameter or a mechanism; without a name, the list of all.

    For a parameter: meaning, unit, limits and source. For a mechanism: equation, effect on a recording, what
    it neglects, similar mechanisms, and its parameters.

    Args:
        name: a parameter such as "thread.modulus", or a mechanism such as "braid_friction".

    Returns:
        the `Explanation`; `print` shows its text, `as_dict` returns its numbers in SI.

    Raises:
        BadInput: for an unknown name.

    >>> print(explain("muscle.turns"))
    muscle.turns: turns N of one thread around the muscle
      unit      1
      limits    0.05 to 200, fitted on a log scale
      source    from B cos(angle) / (pi D)
    """
    if name is None:
        lines = _list_everything()
    elif name in list_mechanisms():
        lines = _explain_mechanism(list_mechanisms()[name])
    else:
        lines = _explain_parameter(name)
    return Explanation(name, "\n".join(lines))


def _build_unknown_error(name: str) -> BadInput:
    hint = suggest_word(name, [*list_parameters(), *list_mechanisms()], listing="pamjax explain")
    return BadInput.from_rule(f"unknown parameter or mechanism {name!r}", remedy=hint)


def _list_everything() -> Iterator[str]:
    parameters = list_parameters()
    yield "Parameters of a muscle:"
    yield from _format_lines(
        {
            parameter_name: parameters[parameter_name]
            for parameter_name in sorted(parameters)
            if parameter_name.startswith(("muscle.", "thread."))
        },
        "  ",
    )
    yield "Mechanisms that a model can include, with their parameters:"
    for kind in MECHANISMS:
        yield from _list_mechanism(kind)
    yield "Alternative equations from textbooks, for comparison:"
    for kind in ALTERNATIVE_EQUATIONS:
        yield from _list_mechanism(kind)


def _list_mechanism(kind) -> Iterator[str]:
    yield f"  {kind.id}: {kind.about.title}"
    yield from _format_lines(_select_own_parameters(kind), "    ")


def _select_own_parameters(kind) -> dict[str, Meaning]:
    """Return the parameters of a mechanism by name."""
    return {n: meaning for n, meaning in list_parameters().items() if n.startswith(f"{kind.id}.")}


def _format_lines(parameters: Mapping[str, Meaning], indent: str) -> Iterator[str]:
    """Return lines with name, unit and meaning in aligned columns."""
    name_width, unit_width = (
        max(map(len, texts), default=0) for texts in (parameters, (m.show for m in parameters.values()))
    )
    for n, meaning in parameters.items():
        yield f"{indent}{n:<{name_width}}  {meaning.show:<{unit_width}}  {meaning.about}"


def _explain_parameter(name: str) -> Iterator[str]:
    meanings = list_parameters()
    if name not in meanings:
        raise _build_unknown_error(name)
    laws_by_meaning: dict[tuple[str, ...], list[str]] = {}
    for law, law_meaning in list_meanings_by_law(name).items():
        laws_by_meaning.setdefault(tuple(_format_meaning(law_meaning)), []).append(law)
    if len(laws_by_meaning) < 2:
        first_line, *lines = _format_meaning(meanings[name])
        yield f"{name}: {first_line}"
        yield from lines
        return
    # The meaning of a parameter can depend on the law.
    for (first_line, *lines), laws in laws_by_meaning.items():
        yield f"{name} (law {' or '.join(laws)}): {first_line}"
        yield from lines


def _format_meaning(meaning) -> Iterator[str]:
    """Return the meaning of a parameter, then unit, limits, source and neutral value."""
    scale = compute_si_factor(meaning.show)
    yield meaning.about
    yield (
        f"  unit      {meaning.show} (stored in {meaning.unit})"
        if meaning.show != meaning.unit
        else f"  unit      {meaning.unit}"
    )
    limits = f"{meaning.low / scale:g} to {meaning.high / scale:g}"
    yield f"  limits    {limits}, fitted on a {meaning.scale} scale"
    yield f"  source    {meaning.source}"
    if meaning.neutral is not None:
        yield f"  neutral   {meaning.neutral / scale:g}: the value without effect"
    if meaning.is_refinement:
        yield "  in a fit  fixed at its default; `diagnose` may estimate it"


def _explain_mechanism(kind) -> Iterator[str]:
    about = kind.about
    yield f"{kind.id}: {about.title}"
    yield from textwrap.indent(about.equation, "    ").splitlines()
    for label, text in {
        "signature": about.signature,
        "neglects": about.neglects,
        "confused with": ", ".join(about.confusable) or "nothing in the library",
        "distinguished by": about.experiment,
        "source": about.source,
    }.items():
        yield from textwrap.wrap(
            text, LINE_WIDTH, initial_indent=f"  {label:<18}", subsequent_indent=" " * 20
        )
    yield "  parameters"
    yield from _format_lines(_select_own_parameters(kind), "    ")

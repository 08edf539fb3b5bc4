"""All parameters of a muscle, by their names in muscle.toml, in reports and in `pamjax explain`.

A parameter is declared once, on its class. Parameters that a laboratory states in another form than the model
are declared here. Examples are modulus and thread count instead of their product, or angle and diameter
instead of thread length and turns. `assembly.py` builds a muscle from named parameters.
"""

from __future__ import annotations

from pamjax.errors import BadInput, suggest_word
from pamjax.model.muscle import Muscle
from pamjax.model.registry import list_mechanisms
from pamjax.model.thread import (
    AbstractThread,
    ExponentialToe,
    Inextensible,
    LinearThread,
    RecruitmentToe,
    SmoothToe,
)
from pamjax.parameter import Meaning, list_field_meanings

#: Thread laws by their names on the command line.
THREAD_LAWS: dict[str, type[AbstractThread] | type[Inextensible]] = {
    "inelastic": Inextensible,
    "elastic": LinearThread,
    "toe": SmoothToe,
    "exponential-toe": ExponentialToe,
    "recruitment-toe": RecruitmentToe,
}

#: Prefix of the parameter name of a length error; the index of the length level follows.
LENGTH_ERROR_PREFIX = "length_error."

_LENGTH_ERROR = Meaning(
    "m",
    "mm",
    -1.0,
    1.0,
    "linear",
    "true minus recorded length of one length setting",
    "as for lengths; the standard deviation of the ruler",
)

_STATED_PARAMETERS = {
    "muscle.braid_angle": Meaning(
        "rad",
        "deg",
        0.05,
        1.55,
        "linear",
        "braid angle from the circumference, at rest",
        "0 and 90 deg are not a braid",
    ),
    "muscle.diameter": Meaning("m", "mm", 1e-4, 5.0, "log", "mid-thread diameter at rest", "as for lengths"),
    "muscle.threads": Meaning(
        "1", "1", 2, 1e5, "log", "threads of both families together", "count on the sleeve"
    ),
    "muscle.thread_area": Meaning(
        "m^2",
        "mm^2",
        1e-12,
        1e-3,
        "log",
        "cross-section of one thread",
        "linear density divided by bulk density",
    ),
    "thread.modulus": Meaning(
        "Pa",
        "GPa",
        0.3e9,
        300e9,
        "log",
        "Young's modulus of the thread; only threads × area × modulus is identifiable",
        "rubbery nylon to ultra-high-modulus polyethylene; drawn yarns 3 to 150 GPa",
    ),
}


def list_parameters() -> dict[str, Meaning]:
    """Return the meaning of every parameter of a muscle, by name: unit, limits, source.

    Returns:
        the meanings. `unit` is the SI unit, `show` the display unit; `low` and `high` are limits in SI.

    >>> modulus = list_parameters()["thread.modulus"]
    >>> modulus.unit, modulus.show, modulus.low
    ('Pa', 'GPa', 300000000.0)
    """
    meanings = {f"muscle.{name}": meaning for name, meaning in list_field_meanings(Muscle).items()}
    for law in THREAD_LAWS.values():
        meanings |= {f"thread.{name}": meaning for name, meaning in list_field_meanings(law).items()}
    for kind in list_mechanisms().values():
        meanings |= {f"{kind.id}.{name}": meaning for name, meaning in list_field_meanings(kind).items()}
    return meanings | _STATED_PARAMETERS


def find_meaning(name: str, where: str = "") -> Meaning:
    """Return the meaning of one parameter.

    Args:
        name: a name of `list_parameters`.
        where: place of the name, for the message.

    Raises:
        BadInput: if the name is unknown; the message suggests the most similar name.
    """
    if name.startswith(LENGTH_ERROR_PREFIX):
        return _LENGTH_ERROR
    parameters = list_parameters()
    if name not in parameters:
        hint = suggest_word(name, parameters, listing="pamjax explain")
        raise BadInput.from_rule(f"unknown parameter {name!r}", where=where, remedy=hint)
    return parameters[name]


def list_meanings_by_law(name: str) -> dict[str, Meaning]:
    """Return the meaning of a thread parameter for each law that has it; empty for other parameters.

    >>> {law: meaning.about for law, meaning in
    ... list_meanings_by_law("thread.crimp").items()}["recruitment-toe"]
    'mean slack of the filaments'
    """
    meanings_by_law = {law: list_field_meanings(kind) for law, kind in THREAD_LAWS.items()}
    return {
        law: law_meanings[name[7:]]
        for law, law_meanings in meanings_by_law.items()
        if name[:7] == "thread." and name[7:] in law_meanings
    }


def list_law_parameters(law: str) -> tuple[str, ...]:
    """Return the names of a law's parameters except its stiffness."""
    if law not in THREAD_LAWS:
        raise BadInput.from_rule(f"unknown thread law {law!r}", remedy=suggest_word(law, THREAD_LAWS))
    return tuple(f"thread.{name}" for name in list_field_meanings(THREAD_LAWS[law]) if name != "stiffness")

"""All numbers of a muscle, by their names in muscle.toml, in reports and in `pamjax explain`.

A number is declared once, on its class. Numbers that a lab states in another form than the model uses are
declared here: modulus and thread count instead of their product, angle and diameter instead of thread length
and turns. `assembly.py` builds a muscle from named numbers.
"""

from __future__ import annotations

from pamjax.errors import refuse, suggest_word
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

#: Thread laws by the name a user gives them.
THREAD_LAWS: dict[str, type[AbstractThread] | type[Inextensible]] = {
    "inelastic": Inextensible,
    "elastic": LinearThread,
    "toe": SmoothToe,
    "exponential-toe": ExponentialToe,
    "recruitment-toe": RecruitmentToe,
}

#: Begins the name of what the ruler is off by at one length setting; the setting's number follows.
LENGTH_ERROR_PREFIX = "length_error."

_LENGTH_ERROR = Meaning(
    "m",
    "mm",
    -1.0,
    1.0,
    "linear",
    "true minus written length of one setting",
    "as lengths; the ruler's own sd",
)

_STATED_PARAMETERS = {
    "muscle.braid_angle": Meaning(
        "rad",
        "deg",
        0.05,
        1.55,
        "linear",
        "braid angle from the circumference, at rest",
        "0 and 90 deg are no net",
    ),
    "muscle.diameter": Meaning(
        "m", "mm", 1e-4, 5.0, "log", "diameter of the threads' surface, at rest", "as lengths"
    ),
    "muscle.threads": Meaning(
        "1", "1", 2, 1e5, "log", "threads of both families together", "counted on the sleeve"
    ),
    "muscle.thread_area": Meaning(
        "m^2", "mm^2", 1e-12, 1e-3, "log", "cross-section of one thread", "linear density over bulk density"
    ),
    "thread.modulus": Meaning(
        "Pa",
        "GPa",
        0.3e9,
        300e9,
        "log",
        "Young's modulus of the thread; only threads × area × modulus acts",
        "rubbery nylon to ultra-high-modulus polyethylene; drawn yarns 3 to 150 GPa",
    ),
}


def list_parameters() -> dict[str, Meaning]:
    """Return the meaning of every number of a muscle, by name: unit, limits, source.

    >>> modulus = list_parameters()["thread.modulus"]
    >>> modulus.unit, modulus.show, modulus.low
    ('Pa', 'GPa', 300000000.0)
    """
    named = {f"muscle.{name}": meaning for name, meaning in list_field_meanings(Muscle).items()}
    for law in THREAD_LAWS.values():
        named |= {f"thread.{name}": meaning for name, meaning in list_field_meanings(law).items()}
    for kind in list_mechanisms().values():
        named |= {f"{kind.id}.{name}": meaning for name, meaning in list_field_meanings(kind).items()}
    return named | _STATED_PARAMETERS


def find_meaning(name: str, where: str = "") -> Meaning:
    """Return the meaning of one number.

    Args:
        name: a name of `list_parameters`.
        where: where the name occurred, for the message.

    Raises:
        BadInput: if there is no such number; the message suggests the nearest name.
    """
    if name.startswith(LENGTH_ERROR_PREFIX):
        return _LENGTH_ERROR
    parameters = list_parameters()
    if name not in parameters:
        hint = suggest_word(name, parameters, listing="pamjax explain")
        raise refuse(f"{name!r} is no number pamjax knows", where=where, remedy=hint)
    return parameters[name]


def list_meanings_by_law(name: str) -> dict[str, Meaning]:
    """Return the meaning of a thread number for each law that has it; empty for other numbers.

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
    """Return the names of a law's numbers except its stiffness."""
    if law not in THREAD_LAWS:
        raise refuse(f"{law!r} is no thread law", remedy=suggest_word(law, THREAD_LAWS))
    return tuple(f"thread.{name}" for name in list_field_meanings(THREAD_LAWS[law]) if name != "stiffness")

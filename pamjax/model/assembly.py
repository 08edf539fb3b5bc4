"""Build a muscle or a bench from the named parameters of muscle.toml and fit.json."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from jaxtyping import Array

from pamjax.errors import BadInput
from pamjax.model import braid
from pamjax.model.bench import Bench
from pamjax.model.mechanism import AbstractMechanism
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.muscle import Muscle
from pamjax.model.parameters import THREAD_LAWS, list_law_parameters
from pamjax.model.registry import order_mechanisms
from pamjax.model.thread import AbstractThread, Inextensible
from pamjax.parameter import list_field_meanings

#: Thread laws of a bench. It has no toe law, but the mechanism `thread_crimp`.
_BENCH_LAWS = ("inelastic", "elastic")


def assemble(law: str, numbers: Mapping[str, Array]) -> Muscle:
    """Return the muscle with the given parameters.

    Args:
        law: a key of `parameters.THREAD_LAWS`.
        numbers: values in SI units by name. Required: "muscle.rest_length"; "muscle.thread_length" and
            "muscle.turns", or "muscle.braid_angle" and "muscle.diameter". A law that stretches also
            needs "thread.stiffness", or "thread.modulus" with "muscle.threads" and
            "muscle.thread_area", and the parameters of the law itself.

    Returns:
        the `Muscle`; call it, or `predict` with it.

    Raises:
        BadInput: if the law is unknown, or a parameter is missing.

    >>> numbers = {"muscle.rest_length": 0.2, "muscle.thread_length": 0.214, "muscle.turns": 1.2}
    >>> muscle = assemble("elastic", numbers | {"thread.stiffness": 0.59e6})
    >>> print(f"{float(muscle(200e3, 0.2).force):.0f} N")
    819 N
    """
    law_parameters = list_law_parameters(law)
    try:
        length, turns = _read_braid(numbers)
        return Muscle(
            numbers["muscle.rest_length"], length, turns, _build_thread(law, law_parameters, numbers)
        )
    except KeyError as error:
        raise BadInput.from_rule(
            f"a muscle needs the parameter `{error.args[0]}`",
            ", ".join(numbers),
            remedy="Add its value in SI units.",
        ) from error


def _read_braid(numbers: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return thread length (m) and turns, from either description of the braid."""
    if "muscle.braid_angle" in numbers:
        rest_length = numbers["muscle.rest_length"]
        return braid.from_angle(rest_length, numbers["muscle.diameter"], numbers["muscle.braid_angle"])
    return numbers["muscle.thread_length"], numbers["muscle.turns"]


def _build_thread(
    law: str, law_parameters: Iterable[str], numbers: Mapping[str, Array]
) -> AbstractThread | Inextensible:
    kind = THREAD_LAWS[law]
    if issubclass(kind, Inextensible):
        return Inextensible()
    own_numbers = {name.removeprefix("thread."): numbers[name] for name in law_parameters}
    return kind(**{"stiffness": _compute_thread_stiffness(numbers), **own_numbers})


def resolve_bench_law(law: str, ids: Iterable[str]) -> str:
    """Return the thread law of a bench: the mechanism `braid_elasticity` makes an inelastic braid elastic.

    Raises:
        BadInput: if a bench does not have this law.
    """
    if law not in _BENCH_LAWS:
        raise BadInput.from_rule(
            "a model with mechanisms must have the thread law `inelastic` or `elastic`",
            f"{law!r}",
            remedy="For a toe, add the mechanism `thread_crimp`.",
        )
    return "elastic" if BraidElasticity.id in ids else law


def list_mechanism_parameters(ids: Iterable[str]) -> dict[str, tuple[type[AbstractMechanism], str]]:
    """Return class and field of every parameter of these mechanisms, by its name "id.field".

    The stiffness of the threads is not included: it is a parameter of the muscle, `thread.modulus` or
    `thread.stiffness`.
    """
    kinds = (kind for kind in order_mechanisms(ids) if kind is not BraidElasticity)
    return {f"{kind.id}.{field}": (kind, field) for kind in kinds for field in list_field_meanings(kind)}


def assemble_bench(law: str, ids: tuple[str, ...], numbers: Mapping[str, Array]) -> Bench:
    """Return the bench with the given parameters.

    Args:
        law: "inelastic" or "elastic".
        ids: ids of the mechanisms.
        numbers: SI, as for `assemble`, and those of the mechanisms as "id.field". Missing parameters
            of mechanisms keep their defaults.
    """
    length, turns = _read_braid(numbers)
    if law == "elastic":
        threads = (BraidElasticity(1 / _compute_thread_stiffness(numbers)),)
    else:
        # In the bench with all mechanisms, an inelastic braid is an elastic braid with zero compliance.
        threads = tuple(BraidElasticity(numbers[n]) for n in ("braid_elasticity.compliance",) if n in numbers)
    own_parameters = list_mechanism_parameters(ids)
    kinds: tuple[Any, ...] = order_mechanisms(ids)
    others = tuple(
        kind(**{f: numbers[n] for n, (k, f) in own_parameters.items() if k is kind and n in numbers})
        for kind in kinds
        if kind is not BraidElasticity
    )
    return Bench(length, turns, threads + others)


def _compute_thread_stiffness(numbers: Mapping[str, Array]) -> Array:
    """Return the pull of all threads at unit strain, n E A, in N, from either set of parameters."""
    if "thread.stiffness" in numbers:
        return numbers["thread.stiffness"]
    return numbers["thread.modulus"] * numbers["muscle.threads"] * numbers["muscle.thread_area"]

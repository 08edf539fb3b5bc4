"""A barrier that makes XLA compute an intermediate result once.

XLA's compiler for CPUs fuses an expression into each expression that uses it, and computes it again there.
A solution with ten uses is then solved ten times, with its derivatives, and compiled as often. XLA does not
fuse across a loop. `materialize` is the identity, written as a loop that XLA cannot remove.
"""

from __future__ import annotations

from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array

Tree = TypeVar("Tree")


def materialize(tree: Tree) -> Tree:
    """Return the same arrays, each computed once. All derivatives are those of the identity."""
    leaves, shape = jax.tree.flatten(tree)
    return jax.tree.unflatten(shape, [_materialize.bind(jnp.asarray(leaf)) for leaf in leaves])


def _lower_as_loop(value: Array) -> Array:
    if value.size == 0:
        return value

    def write(carry):
        previous, _ = carry
        return value, previous.ravel()[0] != 0

    return jax.lax.while_loop(lambda carry: carry[1], write, (jnp.zeros_like(value), True))[0]


def _apply_batched(arguments: Any, axes: Any) -> tuple[Array, int]:
    return _materialize.bind(*arguments), *axes


_materialize = Primitive("materialize")
_materialize.def_impl(lambda value: value)
_materialize.def_abstract_eval(lambda value: value)
ad.deflinear2(_materialize, lambda cotangent, _: (_materialize.bind(cotangent),))
batching.primitive_batchers[_materialize] = _apply_batched
mlir.register_lowering(_materialize, mlir.lower_fun(_lower_as_loop, multiple_results=False))

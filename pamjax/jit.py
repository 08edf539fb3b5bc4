"""Just-in-time compilation with the compiler options of pamjax."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar

import equinox as eqx
import jax
from jax.extend.core import get_opaque_trace_state

P = ParamSpec("P")
T = TypeVar("T")

#: Options with which XLA compiles a muscle in two thirds of the time, to code that is as fast: the older
#: generator of code (not in newer versions), and no search for expressions that are constant in a loop.
COMPILER_OPTIONS = {
    "xla_cpu_use_fusion_emitters": False,
    "xla_disable_hlo_passes": "while-loop-invariant-code-motion",
}

_NO_TRACE = get_opaque_trace_state()


def compile_on_call(function: Callable[P, T]) -> Callable[P, T]:
    """Return the function, compiled at its first call for arguments of each shape.

    Like `equinox.filter_jit`, with `list_compiler_options`.
    """
    part = eqx.filter_jit(function)
    program = cache(
        # Equinox passes other options to `jax.jit`, which its types do not say.
        lambda: eqx.filter_jit(function, compiler_options=list_compiler_options())  # pyright: ignore[reportCallIssue]
    )

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        # JAX rejects compiler options within another program.
        return (part if _is_tracing() else program())(*args, **kwargs)

    return call


@cache
def list_compiler_options() -> dict[str, bool | str]:
    """Return the compiler options that the installed XLA knows; none for devices other than the CPU."""
    if jax.default_backend() != "cpu":
        return {}
    return {name: value for name, value in COMPILER_OPTIONS.items() if _is_known({name: value})}


def _is_known(options: dict[str, bool | str]) -> bool:
    try:
        jax.jit(lambda x: x + 1).lower(0.0).compile(compiler_options=options)
    except jax.errors.JaxRuntimeError:
        return False
    return True


def _is_tracing() -> bool:
    return get_opaque_trace_state() != _NO_TRACE

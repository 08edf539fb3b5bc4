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

    @cache
    def build_program(platform: str) -> Callable[P, T]:
        # Equinox passes other options to `jax.jit`, which its types do not say.
        return eqx.filter_jit(function, compiler_options=_list_known_options(platform))  # pyright: ignore[reportCallIssue]

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        # JAX rejects compiler options within another program.
        program = part if _is_tracing() else build_program(get_default_device().platform)
        return program(*args, **kwargs)

    return call


def get_default_device() -> jax.Device:  # pyright: ignore[reportInvalidTypeForm]
    """Return the device on which this thread computes: that of `jax.default_device`, or JAX's first one."""
    device = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
    return device if isinstance(device, jax.Device) else jax.local_devices(backend=device)[0]


def keep_default_device(function: Callable[P, T]) -> Callable[P, T]:
    """Return the function with the default device of this thread, also if another thread calls it."""
    device = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
    if device is None:
        return function

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        with jax.default_device(device):
            return function(*args, **kwargs)

    return call


def list_compiler_options() -> dict[str, bool | str]:
    """Return the compiler options that the installed XLA knows; none for devices other than the CPU."""
    return _list_known_options(get_default_device().platform)


@cache
def _list_known_options(platform: str) -> dict[str, bool | str]:
    if platform != "cpu":
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

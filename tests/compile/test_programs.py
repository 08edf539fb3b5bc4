"""Programs are compiled once, also if several threads request them."""

from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import pytest

from pamjax.compile.programs import run_compiled, start_compilation
from tests.agreement import agree


def test_parallel_threads_compile_once():
    traced = []

    @jax.jit
    def square(x):
        traced.append(x.shape)
        return x**2

    with ThreadPoolExecutor(4) as pool:
        values = list(pool.map(lambda k: run_compiled(square, jnp.full(3, float(k))), range(8)))
    assert traced == [(3,)]
    agree(jnp.stack(values)[:, 0], [k**2 for k in range(8)], to=0.0)
    # Another shape is another program.
    run_compiled(square, jnp.ones(4))
    assert traced == [(3,), (4,)]


def test_compilation_error_reaches_all_waiting_threads():
    @jax.jit
    def wrong(x):
        raise ValueError("no such muscle")

    start_compilation(wrong, jnp.ones(3))
    with pytest.raises(ValueError, match="no such muscle"):
        run_compiled(wrong, jnp.ones(3))

"""Compiled functions give the same results within another program, and with another XLA."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax import jit
from pamjax.jit import compile_on_call, list_compiler_options


@compile_on_call
def double(x, *, name="a"):
    return 2 * x if name == "a" else 3 * x


def test_a_function_runs_within_other_programs():
    x = jnp.arange(3.0)
    assert double(x).tolist() == [0.0, 2.0, 4.0]
    assert jax.jit(lambda x: double(x) + 1)(x).tolist() == [1.0, 3.0, 5.0]
    assert jax.vmap(double)(x).tolist() == [0.0, 2.0, 4.0]
    np.testing.assert_array_equal(jax.jacfwd(double)(x), 2 * np.eye(3))


def test_arguments_that_are_not_arrays_are_static():
    assert double(jnp.ones(1), name="b").tolist() == [3.0]


def test_only_options_that_xla_knows_are_used(monkeypatch):
    known = {"xla_disable_hlo_passes": "while-loop-invariant-code-motion"}
    monkeypatch.setattr(jit, "COMPILER_OPTIONS", {"xla_cpu_of_no_version": False, **known})
    list_compiler_options.cache_clear()
    try:
        assert list_compiler_options() == known
    finally:
        list_compiler_options.cache_clear()


def test_jax_rejects_options_within_another_program():
    """If this fails, `compile_on_call` needs no second program."""
    inner = jax.jit(lambda x: 2 * x, compiler_options=list_compiler_options())
    with pytest.raises(ValueError, match="compiler_options"):
        jax.jit(lambda x: inner(x) + 1)(1.0)

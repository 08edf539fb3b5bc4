"""Compiled functions give the same results within another program, and with another XLA."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax import jit
from pamjax.jit import compile_on_call, get_default_device, list_compiler_options

on_cpu = pytest.mark.skipif("jax.default_backend() != 'cpu'", reason="other devices have no options")


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


@on_cpu
def test_only_options_that_xla_knows_are_used(monkeypatch):
    known = {"xla_disable_hlo_passes": "while-loop-invariant-code-motion"}
    monkeypatch.setattr(jit, "COMPILER_OPTIONS", {"xla_cpu_of_no_version": False, **known})
    jit._list_known_options.cache_clear()
    try:
        assert list_compiler_options() == known
    finally:
        jit._list_known_options.cache_clear()


@on_cpu
def test_jax_rejects_options_within_another_program():
    """If this fails, `compile_on_call` needs no second program."""
    inner = jax.jit(lambda x: 2 * x, compiler_options=list_compiler_options())
    with pytest.raises(ValueError, match="compiler_options"):
        jax.jit(lambda x: inner(x) + 1)(1.0)


def test_default_device_follows_the_setting_of_jax():
    cpu = jax.devices("cpu")[0]
    with jax.default_device(cpu):
        assert get_default_device() == cpu
    with jax.default_device("cpu"):
        assert get_default_device() == cpu
    assert get_default_device() == jax.devices()[0]


TWO_DEVICES = """
import jax, jax.numpy as jnp
import pamjax
from pamjax.compile.parallel import parallel_map
from pamjax.compile.programs import run_compiled

def list_devices(value):
    return [device.id for leaf in jax.tree.leaves(value) for device in leaf.devices()]

program = jax.jit(lambda x: 2 * x)
on_first = jnp.ones(3)
with jax.default_device(jax.devices()[1]):
    on_second = jnp.ones(3)
    print("chosen", list_devices([run_compiled(program, on_second), run_compiled(program, on_first)]))
    print("threads", list_devices(parallel_map(jnp.asarray, [1.0, 2.0])))
print("first", list_devices([run_compiled(program, on_first), run_compiled(program, on_second)]))
"""


def test_other_threads_use_the_default_device_of_the_caller():
    environment = os.environ | {
        "JAX_PLATFORMS": "cpu",
        "XLA_FLAGS": "--xla_force_host_platform_device_count=2",
    }
    command = [sys.executable, "-c", TWO_DEVICES]
    output = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
    assert output == "chosen [1, 1]\nthreads [1, 1]\nfirst [0, 0]\n"

"""Cache of traced programs: a later process reuses a program only if it is valid there."""

import os
import subprocess
import sys
from pathlib import Path
from shutil import copytree, ignore_patterns

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from filelock import FileLock

import pamjax
import pamjax.compile.aot_cache as under_test
from pamjax.compile.aot_cache import load_or_compile
from tests.agreement import agree

pytestmark = pytest.mark.skipif(
    "jax.default_backend() != 'cpu'", reason="traced programs are cached for the CPU only"
)


class Scale(eqx.Module):
    """A factor with a name, which is part of the program."""

    factor: jax.Array
    name: str = eqx.field(static=True)


@pytest.fixture
def program_folder(tmp_path):
    """Store programs in a temporary folder."""
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path / "traced"
    jax.config.update("jax_compilation_cache_dir", before)


def count_traces(arguments, home: str = "pamjax.made_up") -> int:
    """Return how often a function is traced in a process that has not used it."""
    traced = []

    def scaled(by, x):
        traced.append(x)
        return by.factor * x

    scaled.__module__ = home
    program = load_or_compile(jax.jit(scaled), *arguments)
    agree(program(*jax.tree_util.tree_leaves(arguments)), arguments[0].factor * arguments[1], to=0.0)
    return len(traced)


def build_arguments(factor=2.0, name="a", rows=3):
    return Scale(jnp.asarray(factor), name), jnp.arange(float(rows))


def test_stored_program_is_reused(program_folder):
    assert count_traces(build_arguments()) == 1
    assert count_traces(build_arguments()) == 0
    assert count_traces(build_arguments(factor=3.0)) == 0
    assert len(list(program_folder.glob("*.stablehlo"))) == 1


def test_shape_name_and_sources_are_part_of_the_key(program_folder, monkeypatch):
    assert count_traces(build_arguments()) == 1
    assert count_traces(build_arguments(rows=4)) == 1
    assert count_traces(build_arguments(name="b")) == 1
    monkeypatch.setattr(under_test, "_describe_tracer", lambda: "other sources")
    assert count_traces(build_arguments()) == 1
    assert len(list(program_folder.glob("*.stablehlo"))) == 4


def test_functions_of_other_packages_are_not_stored(program_folder):
    assert count_traces(build_arguments(), "mine") == count_traces(build_arguments(), "mine") == 1
    assert not program_folder.exists()


@pytest.mark.parametrize("folder", [None, "gs://bucket/programs"])
def test_without_a_folder_nothing_is_stored(program_folder, folder, monkeypatch):
    monkeypatch.chdir(program_folder.parent)
    jax.config.update("jax_compilation_cache_dir", folder)
    assert count_traces(build_arguments()) == count_traces(build_arguments()) == 1
    assert not Path("gs:").exists()


def test_changed_sources_prevent_storing(program_folder, monkeypatch):
    monkeypatch.setattr(pamjax, "IMPORT_TIME", 0.0)
    assert count_traces(build_arguments()) == count_traces(build_arguments()) == 1
    assert not program_folder.exists()


def test_foreign_mechanism_prevents_storing(program_folder, monkeypatch):
    monkeypatch.setattr(under_test, "MECHANISMS", (Scale,))
    assert count_traces(build_arguments()) == count_traces(build_arguments()) == 1
    assert not program_folder.exists()


@pytest.mark.parametrize("whole", [b"", b"half a program" * 9])
def test_truncated_file_is_written_again(program_folder, whole):
    assert count_traces(build_arguments()) == 1
    (file,) = program_folder.glob("*.stablehlo")
    file.write_bytes(whole)
    assert count_traces(build_arguments()) == 1
    assert count_traces(build_arguments()) == 0


def test_program_of_another_name_is_not_run(program_folder):
    """Programs with the same arguments and other values: a copy under another name is traced again."""
    assert count_traces(build_arguments()) == count_traces(build_arguments(name="b")) == 1
    file, other = program_folder.glob("*.stablehlo")
    file.write_bytes(other.read_bytes())
    other.unlink()
    assert count_traces(build_arguments()) == count_traces(build_arguments(name="b")) == 1


def test_program_of_another_format_is_written_again(program_folder):
    assert count_traces(build_arguments()) == 1
    (file,) = program_folder.glob("*.stablehlo")
    body = b"not a program"
    file.write_bytes(under_test._compute_checksum(file, body) + body)
    assert count_traces(build_arguments()) == 1
    assert count_traces(build_arguments()) == 0


def test_folder_errors_disable_the_cache(program_folder, monkeypatch):
    # A file in place of the folder: the folder cannot be created, locked or written to.
    program_folder.write_text("mine")
    assert count_traces(build_arguments()) == count_traces(build_arguments()) == 1
    assert program_folder.read_text() == "mine"


def test_waiting_for_a_lock_has_a_time_limit(program_folder, monkeypatch):
    assert count_traces(build_arguments()) == 1
    (file,) = program_folder.glob("*.stablehlo")
    file.unlink()
    monkeypatch.setattr(under_test, "LOCK_TIMEOUT", 0.1)
    with FileLock(file.with_suffix(".lock")):
        assert count_traces(build_arguments()) == 1


def test_key_depends_on_the_sources(tmp_path):
    """A process with a changed line in one file of the package has another key."""
    code = "import sys, pamjax.compile.aot_cache as t; print(t._describe_tracer().splitlines()[-1])"

    def of(root):
        environment = {**os.environ, "PYTHONPATH": str(root)}
        return subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            cwd=root,
            capture_output=True,
            text=True,
            check=True,
        ).stdout

    package = Path(pamjax.__file__).parent
    copytree(package, tmp_path / "pamjax", ignore=ignore_patterns("__pycache__"))
    same = of(tmp_path)
    assert same == of(package.parent)
    with (tmp_path / "pamjax" / "model" / "scan.py").open("a") as file:
        file.write("# another line\n")
    assert of(tmp_path) != same


def test_parallel_processes_trace_once(program_folder):
    """Two processes request the same program, and one of them traces it."""
    asks = (
        "import sys, time, jax, pamjax.compile.aot_cache as t\n"
        "jax.config.update('jax_compilation_cache_dir', sys.argv[1])\n"
        "def slow(x):\n    print('traced'); time.sleep(2); return 2 * x\n"
        "slow.__module__ = 'pamjax.made_up'\n"
        "print(t.load_or_compile(jax.jit(slow), jax.numpy.ones(3))(jax.numpy.ones(3)).tolist())"
    )
    command = [sys.executable, "-c", asks, str(program_folder.parent)]
    processes = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    outputs = sorted(process.communicate(timeout=120)[0].split("\n")[:-1] for process in processes)
    assert outputs == [["[2.0, 2.0, 2.0]"], ["traced", "[2.0, 2.0, 2.0]"]]


def test_program_of_another_device_is_not_stored(program_folder, monkeypatch):
    """Arrays of the CPU, but a program of the GPU: JAX refuses to run a trace of the CPU there."""

    class Gpu:
        platform = "gpu"

    monkeypatch.setattr(under_test, "get_default_device", Gpu)
    assert count_traces(build_arguments()) == 1
    assert count_traces(build_arguments()) == 1
    assert not program_folder.exists()

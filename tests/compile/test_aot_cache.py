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


class Scale(eqx.Module):
    """A factor with a name, which is part of the program."""

    factor: jax.Array
    name: str = eqx.field(static=True)


@pytest.fixture
def kept(tmp_path):
    """Store programs in a temporary folder."""
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path / "traced"
    jax.config.update("jax_compilation_cache_dir", before)


def traces(arguments, home: str = "pamjax.made_up") -> int:
    """Return how often a function is traced in a process that has not used it."""
    seen = []

    def scaled(by, x):
        seen.append(x)
        return by.factor * x

    scaled.__module__ = home
    program = load_or_compile(jax.jit(scaled), *arguments)
    agree(program(*jax.tree_util.tree_leaves(arguments)), arguments[0].factor * arguments[1], to=0.0)
    return len(seen)


def asked(factor=2.0, name="a", rows=3):
    return Scale(jnp.asarray(factor), name), jnp.arange(float(rows))


def test_stored_program_is_reused(kept):
    assert traces(asked()) == 1
    assert traces(asked()) == 0
    assert traces(asked(factor=3.0)) == 0
    assert len(list(kept.glob("*.stablehlo"))) == 1


def test_shape_name_and_sources_are_part_of_the_key(kept, monkeypatch):
    assert traces(asked()) == 1
    assert traces(asked(rows=4)) == 1
    assert traces(asked(name="b")) == 1
    monkeypatch.setattr(under_test, "_describe_tracer", lambda: "other sources")
    assert traces(asked()) == 1
    assert len(list(kept.glob("*.stablehlo"))) == 4


def test_functions_of_other_packages_are_not_stored(kept):
    assert traces(asked(), "mine") == traces(asked(), "mine") == 1
    assert not kept.exists()


@pytest.mark.parametrize("folder", [None, "gs://bucket/programs"])
def test_without_a_folder_nothing_is_stored(kept, folder, monkeypatch):
    monkeypatch.chdir(kept.parent)
    jax.config.update("jax_compilation_cache_dir", folder)
    assert traces(asked()) == traces(asked()) == 1
    assert not Path("gs:").exists()


def test_changed_sources_prevent_storing(kept, monkeypatch):
    monkeypatch.setattr(pamjax, "IMPORT_TIME", 0.0)
    assert traces(asked()) == traces(asked()) == 1
    assert not kept.exists()


def test_foreign_mechanism_prevents_storing(kept, monkeypatch):
    monkeypatch.setattr(under_test, "MECHANISMS", (Scale,))
    assert traces(asked()) == traces(asked()) == 1
    assert not kept.exists()


@pytest.mark.parametrize("whole", [b"", b"half a program" * 9])
def test_truncated_file_is_written_again(kept, whole):
    assert traces(asked()) == 1
    (file,) = kept.glob("*.stablehlo")
    file.write_bytes(whole)
    assert traces(asked()) == 1
    assert traces(asked()) == 0


def test_folder_errors_disable_the_cache(kept, monkeypatch):
    # A file in place of the folder: the folder cannot be created, locked or written to.
    kept.write_text("mine")
    assert traces(asked()) == traces(asked()) == 1
    assert kept.read_text() == "mine"


def test_waiting_for_a_lock_has_a_time_limit(kept, monkeypatch):
    assert traces(asked()) == 1
    (file,) = kept.glob("*.stablehlo")
    file.unlink()
    monkeypatch.setattr(under_test, "LOCK_TIMEOUT", 0.1)
    with FileLock(file.with_suffix(".lock")):
        assert traces(asked()) == 1


def test_key_depends_on_the_sources(tmp_path):
    """A process with a changed line in one file of the package has another key."""
    told = "import sys, pamjax.compile.aot_cache as t; print(t._describe_tracer().splitlines()[-1])"

    def of(root):
        environment = {**os.environ, "PYTHONPATH": str(root)}
        return subprocess.run(
            [sys.executable, "-c", told],
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


def test_parallel_processes_trace_once(kept):
    """Two processes request the same program, and one of them traces it."""
    asks = (
        "import sys, time, jax, pamjax.compile.aot_cache as t\n"
        "jax.config.update('jax_compilation_cache_dir', sys.argv[1])\n"
        "def slow(x):\n    print('traced'); time.sleep(2); return 2 * x\n"
        "slow.__module__ = 'pamjax.made_up'\n"
        "print(t.load_or_compile(jax.jit(slow), jax.numpy.ones(3))(jax.numpy.ones(3)).tolist())"
    )
    asked = [sys.executable, "-c", asks, str(kept.parent)]
    both = [subprocess.Popen(asked, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    told = sorted(one.communicate(timeout=120)[0].split("\n")[:-1] for one in both)
    assert told == [["[2.0, 2.0, 2.0]"], ["traced", "[2.0, 2.0, 2.0]"]]

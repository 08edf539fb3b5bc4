"""Imports run one way, and what loads nothing heavy stays so."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import pamjax

#: From left to right; `view` is the last but the words of the command line, so nothing else imports it.
LEFT, RIGHT = ("check", "progress", "units", "parameter", "model"), ("study", "design", "view", "cli")
ROOMS = [*LEFT, "records", "infer", *RIGHT]
HOME = Path(pamjax.__file__).parent
FILES = sorted(HOME.rglob("*.py"))
#: What reads recordings and tables: a typo in a header must not cost the second that JAX takes to load.
LIGHT = ("pamjax.check", "pamjax.units", "pamjax.records.case", "pamjax.records.tables")


def imported(source):
    """(line, module) of everything a file imports, wherever in the file."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            # `from pamjax import model` imports the room as much as `import pamjax.model`.
            yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.lineno, "." * node.level


def room(module):
    parts = module.split(".")
    return parts[1] if parts[0] == "pamjax" and len(parts) > 1 and parts[1] in ROOMS else None


def against_the_arrow(source, here):
    """What a file in room `here` imports from a room to its right, as (line, module)."""
    for line, module in imported(source):
        there = room(module)
        if module.startswith("."):
            yield line, "a relative import"
        elif there and ROOMS.index(there) > ROOMS.index(here):
            yield line, module


def place(path):
    return path.relative_to(HOME).with_suffix("").parts[0]


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.relative_to(HOME).as_posix())
def test_imports_run_one_way(path):
    if place(path) in ROOMS:
        assert list(against_the_arrow(path.read_text("utf-8"), place(path))) == []
    else:
        assert place(path) in ("__init__", "__main__"), "a file outside the rooms"


@pytest.mark.parametrize(
    ("source", "here", "found"),
    [
        ("import pamjax.infer.fit", "model", [(1, "pamjax.infer.fit")]),
        ("from pamjax import view", "study", [(1, "pamjax.view")]),
        ("def f():\n    from pamjax.cli import main", "view", [(2, "pamjax.cli.main")]),
        ("from . import thread", "model", [(1, "a relative import")]),
        ("from pamjax.model import thread\nimport jax", "infer", []),
        ("from pamjax.view import page", "cli", []),
    ],
)
def test_a_planted_violation_is_found(source, here, found):
    assert list(against_the_arrow(source, here)) == found


def loaded_after(statement, package):
    program = f"import sys; {statement}; print({package!r} in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return done.stdout.strip() == "True"


def test_reading_loads_no_jax():
    assert not loaded_after("import " + ", ".join(LIGHT), "jax")


def test_no_room_but_view_loads_matplotlib():
    assert not loaded_after("import pamjax.model.muscle, pamjax.infer, pamjax.study.rivals", "matplotlib")


def test_loading_can_be_seen():
    assert loaded_after("import pamjax.parameter", "jax")

"""Imports have one direction, folders are small, and readers do not load heavy packages."""

import ast
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

import pamjax

#: From left to right: a room imports from rooms to its left only.
ROOMS = [
    "errors",
    "text",
    "progress",
    "notebook",
    "drawing",
    "units",
    "channels",
    "parameter",
    "jit",
    "model",
    "explanation",
    "records",
    "compile",
    "infer",
    "diagnosis",
    "baselines",
    "control",
    "sizing",
    "planning",
    "benchmark",
    "fleet",
    "view",
    "cluster",
    "cli",
]
HOME = Path(pamjax.__file__).parent
FILES = sorted(HOME.rglob("*.py"))
#: Modules that read recordings and tables; they must report errors before JAX is loaded.
LIGHT = ("pamjax.errors", "pamjax.units", "pamjax.records.case", "pamjax.records.shipped_tables")
#: A folder with more modules than this needs sub-folders; `model/mechanisms` has one file for each mechanism.
MAX_MODULES = 20


def list_imports(source, typing=True):
    """Yield (line, module) of all imports of a file; `typing` includes those under TYPE_CHECKING."""
    tree = ast.parse(source)
    skipped = set() if typing else {id(node) for node in _is_typing_only(tree)}
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            # `from pamjax import model` imports the room as much as `import pamjax.model`.
            yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.lineno, "." * node.level


def _is_typing_only(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            for statement in node.body:
                yield from ast.walk(statement)


def room_of(module):
    parts = module.split(".")
    return parts[1] if parts[0] == "pamjax" and len(parts) > 1 and parts[1] in ROOMS else None


def list_violations(source, here):
    """Yield (line, module) of imports in room `here` from a room to its right."""
    for line, module in list_imports(source):
        there = room_of(module)
        if module.startswith("."):
            yield line, "a relative import"
        elif there and ROOMS.index(there) > ROOMS.index(here):
            yield line, module


def module_name(path):
    return ".".join(path.relative_to(HOME.parent).with_suffix("").parts).removesuffix(".__init__")


def import_graph():
    """Yield the edges between modules, without imports for type checkers."""
    modules = {module_name(path) for path in FILES}
    for path in FILES:
        for _, name in list_imports(path.read_text("utf-8"), typing=False):
            target = name if name in modules else name.rpartition(".")[0]
            if target in modules and target != "pamjax" and module_name(path) not in ("pamjax", target):
                yield module_name(path), target


def find_cycle(edges):
    """Return the nodes on a cycle or between cycles; empty if there is none."""
    edges = {(a, b) for a, b in edges if a != b}
    while edges:
        inner = {a for a, _ in edges} & {b for _, b in edges}
        kept = {(a, b) for a, b in edges if a in inner and b in inner}
        if kept == edges:
            return sorted(inner)
        edges = kept
    return []


def folder_of(module):
    """Return the sub-package of a module, or the module itself directly in a room."""
    parts = module.split(".")
    return ".".join(parts[:3])


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.relative_to(HOME).as_posix())
def test_imports_have_one_direction(path):
    first = path.relative_to(HOME).with_suffix("").parts[0]
    if first in ROOMS:
        assert list(list_violations(path.read_text("utf-8"), first)) == []
    else:
        assert first in ("__init__", "__main__"), "a file outside the rooms"


@pytest.mark.parametrize(
    ("source", "here", "violations"),
    [
        ("import pamjax.infer.fitting.fit", "model", [(1, "pamjax.infer.fitting.fit")]),
        ("from pamjax import view", "diagnosis", [(1, "pamjax.view")]),
        ("def f():\n    from pamjax.cli import main", "view", [(2, "pamjax.cli.main")]),
        ("from . import thread", "model", [(1, "a relative import")]),
        ("from pamjax.model import thread\nimport jax", "infer", []),
        ("from pamjax.view import theme", "cli", []),
    ],
)
def test_import_in_the_wrong_direction_is_detected(source, here, violations):
    assert list(list_violations(source, here)) == violations


def test_modules_have_no_import_cycle():
    assert find_cycle(import_graph()) == []


def test_folders_have_no_import_cycle():
    assert find_cycle((folder_of(a), folder_of(b)) for a, b in import_graph()) == []


def test_import_cycle_is_detected():
    assert find_cycle([("a", "b"), ("b", "c"), ("c", "a"), ("c", "d")]) == ["a", "b", "c"]


def test_folders_are_small():
    counts = Counter(p.parent.relative_to(HOME).as_posix() for p in FILES if p.stem != "__init__")
    del counts["model/mechanisms"]
    assert {folder: n for folder, n in counts.items() if n > MAX_MODULES} == {}


def list_loaded_modules(statement, package):
    program = f"import sys; {statement}; print({package!r} in sys.modules)"
    process = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return process.stdout.strip() == "True"


def test_reading_loads_no_jax():
    assert not list_loaded_modules("import " + ", ".join(LIGHT), "jax")


def test_no_room_but_view_loads_matplotlib():
    modules = (
        "pamjax.model.muscle, pamjax.infer.fitting.fit, pamjax.diagnosis.run, pamjax.baselines.empirical"
    )
    assert not list_loaded_modules(f"import {modules}", "matplotlib")


def test_loaded_package_is_detected():
    assert list_loaded_modules("import pamjax.parameter", "jax")

"""Change each sign in the mechanisms, one at a time, and list the changes that no test detects.

Run it from the root of a checkout, for all mechanisms or for one file:

    python -m tests.model.mechanisms.mutate
    python -m tests.model.mechanisms.mutate --only force_drift.py

A mutant is a mechanism with one plus changed to a minus, one minus to a plus, or one minus sign removed. With
`--more` also with one product changed to a quotient, one quotient to a product, or one comparison reversed.
The mutants are written to a temporary copy of the package and of the tests, never to the checkout.

Each mutant is tested in a new process until the first failure: by the tests of its mechanism, by the common
tests of all mechanisms, then by the other files of this folder that import it. Slow tests run only with
`--slow`. The mutants share compiled programs, whose keys are the programs themselves.
The exit code is 1 if a mutant survives that is not in `EQUIVALENT`.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[3]
SOURCES = Path("pamjax", "model", "mechanisms")
TESTS = Path("tests", "model", "mechanisms")

#: Longest run of one test file, s: a mutant that takes longer counts as killed.
PATIENCE = 600

SIGNS = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.USub: ast.UAdd}
MORE = {
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Lt: ast.Gt,
    ast.Gt: ast.Lt,
    ast.LtE: ast.GtE,
    ast.GtE: ast.LtE,
}

#: Mutants that no test can detect, by file and mutation, with the reason.
EQUIVALENT = {
    (
        "thread_slip.py",
        "-1 -> +1",
    ): "times increase: the last sample is later than the first if the second is",
}


@dataclass(frozen=True)
class Mutant:
    """One changed operator.

    Attributes:
        line: line of the expression.
        mutation: the expression before and after the change.
        source: the complete changed file.
    """

    line: int
    mutation: str
    source: str


def mutants(source: str, more: bool = False) -> Iterator[Mutant]:
    """Yield all mutants of a source text, in the order of its lines."""
    swaps = SIGNS | MORE if more else SIGNS
    tree = ast.parse(source)
    nodes: list[Any] = [node for node in ast.walk(tree) if type(_operator(node)) in swaps]
    for node in sorted(nodes, key=lambda node: (node.lineno, node.col_offset, -node.end_col_offset)):
        before, operator = ast.unparse(node), _operator(node)
        _set_operator(node, swaps[type(operator)]())
        yield Mutant(node.lineno, f"{before} -> {ast.unparse(node)}", ast.unparse(tree))
        _set_operator(node, operator)


def _operator(node: Any) -> ast.AST | None:
    if isinstance(node, ast.Compare):
        return node.ops[0]
    return node.op if isinstance(node, (ast.BinOp, ast.UnaryOp, ast.AugAssign)) else None


def _set_operator(node: Any, operator: Any) -> None:
    if isinstance(node, ast.Compare):
        node.ops[0] = operator
    else:
        node.op = operator


def copied(folder: Path) -> Path:
    """Return a copy of the package and its tests in a folder, without compiled Python."""
    leave = shutil.ignore_patterns("__pycache__")
    for part in ("pamjax", "tests"):
        shutil.copytree(ROOT / part, folder / part, ignore=leave)
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


def failure(tree: Path, options: list[str]) -> str | None:
    """Return the first failing test in a copy, or None if all pass."""
    # A mutation keeps the size of a file, so that an outdated bytecode file would count as current.
    environment = {
        **os.environ,
        "PYTHONPATH": str(tree),
        "PYTHONDONTWRITEBYTECODE": "1",
        "PAMJAX_CACHE_DIR": str(tree / "cache"),
        "JAX_PLATFORMS": "cpu",
    }
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-x",
        "-q",
        "--tb=no",
        "-rfE",
        "-p",
        "no:cacheprovider",
        *options,
    ]
    try:
        done = subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, text=True, timeout=PATIENCE
        )
    except subprocess.TimeoutExpired:
        return f"longer than {PATIENCE} s"
    # Exit code 5: no test was selected.
    if done.returncode in (0, 5):
        return None
    failure = re.search(r"^(?:FAILED|ERROR) (?:\S*/)?(\S+)", done.stdout, re.MULTILINE)
    return failure[1] if failure else f"exit {done.returncode}"


def stages(tree: Path, mechanism: str, slow: bool = False) -> Iterator[list[str]]:
    """Yield the pytest options for the tests of a mechanism, its own tests first."""
    chosen = [] if slow else ["-m", "not slow"]
    own, battery = TESTS / f"test_{mechanism}.py", TESTS / "test_battery.py"
    yield [str(own), *chosen]
    yield [str(battery), "-k", mechanism, *chosen]
    for path in sorted((tree / TESTS).glob("test_*.py")):
        if path.name not in (own.name, battery.name) and f"mechanisms.{mechanism} import" in path.read_text():
            yield [str(path.relative_to(tree)), *chosen]


def judge(tree: Path, name: str, more: bool, slow: bool) -> Iterator[tuple[Mutant, str]]:
    """Yield each mutant of a file with its result: killed, equivalent, or SURVIVED."""
    path, mechanism = tree / SOURCES / name, name.removesuffix(".py")
    original, trusted = path.read_text(), set()

    def killer(source: str) -> str | None:
        for stage in stages(tree, mechanism, slow):
            path.write_text(source)
            failed = failure(tree, stage)
            # A test that fails without a mutation kills nothing.
            if failed and tuple(stage) not in trusted:
                path.write_text(original)
                if broken := failure(tree, stage):
                    sys.exit(f"{name}: {broken} fails without a mutation; repair it first")
                trusted.add(tuple(stage))
            if failed:
                return failed
        return None

    for mutant in mutants(original, more):
        if why := EQUIVALENT.get((name, mutant.mutation)):
            yield mutant, f"equivalent as {why}"
        else:
            by = killer(mutant.source)
            yield mutant, f"killed by {by}" if by else "SURVIVED"
    path.write_text(original)


def main() -> int:
    """Print the table of mutants; return 1 if one survived, else 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", metavar="FILE", help="one file of pamjax/model/mechanisms")
    parser.add_argument("--more", action="store_true", help="also products, quotients and comparisons")
    parser.add_argument("--slow", action="store_true", help="also the tests that are marked slow")
    chosen = parser.parse_args()
    names = sorted(p.name for p in (ROOT / SOURCES).glob("*.py") if p.name != "__init__.py")
    if chosen.only:
        only = Path(chosen.only).name
        if only not in names:
            parser.error(f"no file {only} in {SOURCES}: choose one of {', '.join(names)}")
        names = [only]
    count = {"killed": 0, "equivalent": 0, "SURVIVED": 0}
    with tempfile.TemporaryDirectory(prefix="pamjax-mutants-") as folder:
        tree = copied(Path(folder))
        for name in names:
            for mutant, verdict in judge(tree, name, chosen.more, chosen.slow):
                word, _, detail = verdict.partition(" ")
                count[word] += 1
                print(f"{word:10}  {name}:{mutant.line:<3}  {mutant.mutation}  {detail}".rstrip(), flush=True)
    print(", ".join(f"{n} {word}" for word, n in count.items()), f"of {sum(count.values())} mutants")
    return int(count["SURVIVED"] > 0)


if __name__ == "__main__":
    sys.exit(main())

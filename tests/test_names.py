"""Check the names of the package: one meaning each, and no parameter that says nothing."""

import ast
from collections import defaultdict
from pathlib import Path

import pytest

import pamjax

HOME = Path(pamjax.__file__).parent
TREES = {path: ast.parse(path.read_text("utf-8")) for path in sorted(HOME.rglob("*.py"))}
#: Parameter names that do not name the thing.
RIDDLES = {"found", "one", "told", "much"}
#: Constants that every file format has of its own.
SHARED_CONSTANTS = {"SCHEMA"}


def list_parameters(tree):
    """(function, parameter) of every function, method and lambda."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            arguments = node.args
            every = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
            every += [a for a in (arguments.vararg, arguments.kwarg) if a]
            yield from ((getattr(node, "name", "lambda"), a.arg) for a in every)


def find_riddles(tree):
    return [f"{function}({name})" for function, name in list_parameters(tree) if name in RIDDLES]


def find_repeated(names):
    """Names that stand in more than one place."""
    places = defaultdict(list)
    for name, place in names:
        places[name].append(place)
    return {name: where for name, where in places.items() if len(where) > 1}


def list_classes():
    for path, tree in TREES.items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                yield node.name, path.relative_to(HOME).as_posix()


def list_constants():
    for path, tree in TREES.items():
        for node in tree.body:
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            for target in targets:
                if isinstance(target, ast.Name) and target.id.isupper() and target.id not in SHARED_CONSTANTS:
                    yield target.id, path.relative_to(HOME).as_posix()


@pytest.mark.parametrize("path", TREES, ids=lambda p: p.relative_to(HOME).as_posix())
def test_parameters_name_the_thing(path):
    assert find_riddles(TREES[path]) == []


def test_a_planted_riddle_is_reported():
    assert find_riddles(ast.parse("def f(case, *, found): ...\ng = lambda one: one")) == [
        "f(found)",
        "lambda(one)",
    ]


def test_no_class_name_occurs_twice():
    assert find_repeated(list_classes()) == {}


def test_no_constant_has_two_meanings():
    assert find_repeated(list_constants()) == {}


def test_a_planted_repetition_is_reported():
    assert find_repeated([("A", "x.py"), ("B", "x.py"), ("A", "y.py")]) == {"A": ["x.py", "y.py"]}

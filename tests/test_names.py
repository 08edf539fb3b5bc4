"""Names of the package: each has one meaning, and each parameter names its object."""

import ast
from collections import defaultdict
from pathlib import Path

import pytest

import pamjax

HOME = Path(pamjax.__file__).parent
TREES = {path: ast.parse(path.read_text("utf-8")) for path in sorted(HOME.rglob("*.py"))}
#: Parameter names without a meaning.
RIDDLES = {"found", "one", "told", "much"}
#: Constants that each file format defines.
SHARED_CONSTANTS = {"SCHEMA"}


def list_parameters(tree):
    """Yield (function, parameter) of every function, method and lambda."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            arguments = node.args
            every = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
            every += [a for a in (arguments.vararg, arguments.kwarg) if a]
            yield from ((getattr(node, "name", "lambda"), a.arg) for a in every)


def find_riddles(tree):
    return [f"{function}({name})" for function, name in list_parameters(tree) if name in RIDDLES]


def find_repeated(names):
    """Return the names that occur in several files, with these files."""
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
def test_parameters_have_meaningful_names(path):
    assert find_riddles(TREES[path]) == []


def test_meaningless_parameter_name_is_detected():
    assert find_riddles(ast.parse("def f(case, *, found): ...\ng = lambda one: one")) == [
        "f(found)",
        "lambda(one)",
    ]


def test_no_class_name_occurs_twice():
    assert find_repeated(list_classes()) == {}


def test_no_constant_has_two_meanings():
    assert find_repeated(list_constants()) == {}


def test_repeated_class_name_is_detected():
    assert find_repeated([("A", "x.py"), ("B", "x.py"), ("A", "y.py")]) == {"A": ["x.py", "y.py"]}

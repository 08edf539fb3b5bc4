"""Names, docstrings and messages: each name states its object, each sentence can be read once."""

import ast
import re
from collections import defaultdict
from pathlib import Path

import pytest

import pamjax

HOME = Path(pamjax.__file__).parent
TREES = {path: ast.parse(path.read_text("utf-8")) for path in sorted(HOME.rglob("*.py"))}
TESTS = Path(__file__).parent
#: Names of parameters, local variables and attributes without a meaning.
RIDDLES = {"found", "one", "told", "much", "said", "asked"}
#: First words of a docstring that is not a summary of the result.
NO_SUMMARY = {
    "a",
    "an",
    "the",
    "this",
    "it",
    "no",
    "how",
    "what",
    "when",
    "where",
    "whether",
    "which",
    "who",
    "why",
}
#: Largest number of words of a sentence in a message.
MESSAGE_WORDS = 30
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


def find_assigned_riddles(tree):
    """Return the meaningless names of variables and attributes, with their line."""
    names = [(n.id, n.lineno) for n in ast.walk(tree) if isinstance(n, ast.Name) and _is_assigned(n)]
    names += [(n.attr, n.lineno) for n in ast.walk(tree) if isinstance(n, ast.Attribute) and _is_assigned(n)]
    return [f"{name}, line {line}" for name, line in names if name in RIDDLES]


def _is_assigned(node):
    return isinstance(node.ctx, ast.Store)


def find_participles(tree):
    """Return the functions and classes of a module whose name is one participle, such as `settled`."""
    names = [n.name for n in tree.body if isinstance(n, ast.FunctionDef | ast.ClassDef)]
    return [name for name in names if re.fullmatch(r"_?[A-Za-z][a-z]*[^e]ed", name)]


def find_poor_docstrings(tree):
    """Return the functions whose docstring does not begin with a summary of the result."""
    functions = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef) and ast.get_docstring(n)]
    return [n.name for n in functions if (ast.get_docstring(n) or "").split()[0].lower() in NO_SUMMARY]


def list_messages(tree):
    """Yield the text of each string, with `x` for each value; templates of several lines are left out."""
    parts = {id(v) for n in ast.walk(tree) if isinstance(n, ast.JoinedStr) for v in n.values}
    for node in ast.walk(tree):
        text = ""
        if isinstance(node, ast.JoinedStr):
            text = "".join(str(v.value) if isinstance(v, ast.Constant) else "x" for v in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts:
            text = node.value
        if "\n" not in text:
            yield text


def find_long_messages(tree):
    """Return the sentences of messages with more than `MESSAGE_WORDS` words."""
    sentences = (s for text in list_messages(tree) for s in re.split(r"(?<=[.!?:;])\s", text))
    return [sentence for sentence in sentences if len(sentence.split()) > MESSAGE_WORDS]


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
            for name in list_target_names(targets):
                if name.isupper() and name not in SHARED_CONSTANTS:
                    yield name, path.relative_to(HOME).as_posix()


def list_target_names(targets):
    """Yield the names of the targets of an assignment, with those of its tuples."""
    for target in targets:
        if isinstance(target, ast.Name):
            yield target.id
        elif isinstance(target, ast.Tuple):
            yield from list_target_names(target.elts)


@pytest.mark.parametrize("path", TREES, ids=lambda p: p.relative_to(HOME).as_posix())
def test_parameters_have_meaningful_names(path):
    assert find_riddles(TREES[path]) == []


@pytest.mark.parametrize("path", TREES, ids=lambda p: p.relative_to(HOME).as_posix())
def test_variables_have_meaningful_names(path):
    assert find_assigned_riddles(TREES[path]) == []


@pytest.mark.parametrize("path", TREES, ids=lambda p: p.relative_to(HOME).as_posix())
def test_functions_and_classes_are_no_participles(path):
    assert find_participles(TREES[path]) == []


def test_docstrings_begin_with_the_result():
    assert {p.name: names for p, t in TREES.items() if (names := find_poor_docstrings(t))} == {}


def test_sentences_of_messages_are_short():
    assert {p.name: long for p, tree in TREES.items() if (long := find_long_messages(tree))} == {}


def test_names_of_the_tests_are_meaningful():
    trees = {p.relative_to(TESTS).as_posix(): ast.parse(p.read_text("utf-8")) for p in TESTS.rglob("*.py")}
    assert len(trees) > 180
    riddles = {name: find_riddles(tree) + find_assigned_riddles(tree) for name, tree in trees.items()}
    assert {name: names for name, names in riddles.items() if names} == {}


def test_poor_names_and_texts_are_detected():
    module = """def settled(x): ...
class Told: ...
def need(): ...
def f():
    'How it is done.'
    self.said = (found := 1)
"""
    tree = ast.parse(module)
    assert find_participles(tree) == ["settled"]
    assert find_poor_docstrings(tree) == ["f"]
    assert find_assigned_riddles(tree) == ["found, line 6", "said, line 6"]
    long = "word " * MESSAGE_WORDS
    assert find_long_messages(ast.parse(f"BadInput.from_rule(f'{long}{{x}}. Short.')")) == [f"{long}x."]
    assert find_long_messages(ast.parse(f"BadInput.from_rule('{long}')")) == []


def test_meaningless_parameter_name_is_detected():
    assert find_riddles(ast.parse("def f(case, *, found): ...\ng = lambda one: one")) == [
        "f(found)",
        "lambda(one)",
    ]


def test_no_class_name_occurs_twice():
    assert find_repeated(list_classes()) == {}


def test_no_constant_has_two_meanings():
    assert find_repeated(list_constants()) == {}


def test_constants_of_a_tuple_are_counted():
    (node,) = ast.parse("A, (B, c.d) = 1, (2, 3)").body
    assert list(list_target_names(node.targets)) == ["A", "B"]


def test_repeated_class_name_is_detected():
    assert find_repeated([("A", "x.py"), ("B", "x.py"), ("A", "y.py")]) == {"A": ["x.py", "y.py"]}

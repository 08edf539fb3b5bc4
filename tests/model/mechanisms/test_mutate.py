"""The mutation command: its changes, and the refusal of tests that fail without a change."""

import pytest

from tests.model.mechanisms import mutate

SOURCE = '''
LOW = -1.0

def law(a: "x - y", b):
    """Return a - b."""
    return a * (a - b) + (a if a < b else b)
'''


def mutations(**options):
    return [(mutant.line, mutant.mutation) for mutant in mutate.mutants(SOURCE, **options)]


def test_every_sign_is_changed_and_nothing_else():
    whole = "a * (a - b) + (a if a < b else b)"
    assert mutations() == [
        (2, "-1.0 -> +1.0"),
        (6, f"{whole} -> {whole.replace('+', '-')}"),
        (6, "a - b -> a + b"),
    ]


def test_more_option_changes_products_and_comparisons():
    more = [mutation for mutation in mutations(more=True) if mutation not in mutations()]
    assert more == [(6, "a * (a - b) -> a / (a - b)"), (6, "a < b -> a > b")]


def test_mutant_differs_by_one_operator():
    results = []
    for mutant in mutate.mutants(SOURCE):
        scope = {}
        exec(mutant.source, scope)
        results.append((scope["LOW"], scope["law"](3.0, 5.0)))
    # Without a change, LOW is −1 and the law gives 3 (3 − 5) + 3 = −3.
    assert results == [(1.0, -3.0), (-1.0, -9.0), (-1.0, 27.0)]


@pytest.fixture
def tree(tmp_path):
    """Return a folder with one mechanism and its test."""
    for folder in (mutate.SOURCES, mutate.TESTS):
        (tmp_path / folder).mkdir(parents=True)
    for package in (mutate.SOURCES, *mutate.SOURCES.parents[:2]):
        (tmp_path / package / "__init__.py").touch()
    (tmp_path / mutate.SOURCES / "law.py").write_text("def law(a, b):\n    return a - b\n")
    (tmp_path / mutate.TESTS / "test_battery.py").write_text("")
    (tmp_path / "pyproject.toml").write_text(
        "[tool.pytest.ini_options]\naddopts = '--import-mode=importlib'\n"
    )
    return tmp_path


def judged(tree, test):
    test = f"from pamjax.model.mechanisms.law import law\n\n\ndef test_law():\n    assert {test}\n"
    (tree / mutate.TESTS / "test_law.py").write_text(test)
    return [verdict for _, verdict in mutate.judge(tree, "law.py", more=False, slow=True)]


@pytest.mark.slow
def test_mutant_is_killed_only_by_a_test_that_detects_it(tree):
    assert judged(tree, "law(3, 5) == -2") == ["killed by test_law.py::test_law"]
    assert judged(tree, "law(3, 0) == 3") == ["SURVIVED"]


@pytest.mark.slow
def test_failing_test_is_refused(tree):
    with pytest.raises(SystemExit, match="test_law fails without a mutation"):
        judged(tree, "law(3, 5) == 2")


def test_listed_equivalent_mutants_exist():
    for name, mutation in mutate.EQUIVALENT:
        source = (mutate.ROOT / mutate.SOURCES / name).read_text()
        assert mutation in [mutant.mutation for mutant in mutate.mutants(source, more=True)]

"""Every example of a docstring runs."""

import doctest
import importlib
import pkgutil

import pytest

import pamjax

MODULES = sorted(
    m.name for m in pkgutil.walk_packages(pamjax.__path__, "pamjax.") if "__main__" not in m.name
)


@pytest.mark.parametrize("name", MODULES)
def test_examples(name):
    result = doctest.testmod(importlib.import_module(name), optionflags=doctest.NORMALIZE_WHITESPACE)
    assert result.failed == 0


def test_there_are_examples():
    assert {"pamjax.units", "pamjax.model.muscle"} <= set(MODULES)
    muscle = importlib.import_module("pamjax.model.muscle")
    assert sum(len(t.examples) for t in doctest.DocTestFinder().find(muscle)) > 0

"""Words that hold for every case, or for one of them."""

from pathlib import Path

import pytest

from pamjax.cli.settings import of_each
from pamjax.errors import BadInput

CASES = [Path("labs/first"), Path("labs/second"), Path("third")]


def test_nothing_said_is_the_usual():
    assert of_each(CASES, None, "carry", "--gaps") == ["carry"] * 3


def test_what_is_said_of_one_case_holds_for_it_alone_wherever_it_stands():
    assert of_each(CASES, ["second=carry", "anew"], "carry", "--gaps") == ["anew", "carry", "anew"]


def test_a_case_that_is_not_there_is_told():
    with pytest.raises(BadInput, match="Did you mean `second`"):
        of_each(CASES, ["secnd=anew"], "carry", "--gaps")

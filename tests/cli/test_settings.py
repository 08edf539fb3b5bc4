"""Words that hold for every case, or for one of them."""

from pathlib import Path

import pytest

from pamjax.cli.settings import assign_to_cases
from pamjax.errors import BadInput

CASES = [Path("labs/first"), Path("labs/second"), Path("third")]


def test_nothing_said_is_the_usual():
    assert assign_to_cases(CASES, None, "carry", "--gaps") == ["carry"] * 3


def test_what_is_said_of_one_case_holds_for_it_alone_wherever_it_stands():
    assert assign_to_cases(CASES, ["second=carry", "anew"], "carry", "--gaps") == ["anew", "carry", "anew"]


def test_a_case_that_is_not_there_is_told():
    with pytest.raises(BadInput, match="Did you mean `second`"):
        assign_to_cases(CASES, ["secnd=anew"], "carry", "--gaps")

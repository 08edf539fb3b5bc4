"""Options that apply to all cases or to one case."""

from pathlib import Path

import pytest

from pamjax.cli.name_value_options import assign_to_cases
from pamjax.errors import BadInput

CASES = [Path("labs/first"), Path("labs/second"), Path("third")]


def test_defaults_apply_without_options():
    assert assign_to_cases(CASES, None, "carry", "--gaps") == ["carry"] * 3


def test_option_of_one_case_applies_to_it_only():
    assert assign_to_cases(CASES, ["second=carry", "anew"], "carry", "--gaps") == ["anew", "carry", "anew"]


def test_option_of_an_unknown_case_is_refused():
    with pytest.raises(BadInput, match="Did you mean `second`"):
        assign_to_cases(CASES, ["secnd=anew"], "carry", "--gaps")

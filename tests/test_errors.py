"""A complaint is one sentence in one order."""

import pytest

from pamjax.errors import BadInput, InputWarning, compose_message, refuse, suggest_word


@pytest.mark.parametrize(
    ("parts", "text"),
    [
        (("a rule",), "a rule."),
        (("a rule.",), "a rule."),
        (("a rule", "3 mm"), "a rule; got 3 mm."),
        (("a rule", "", "a.csv"), "a rule (a.csv)."),
        (("a rule", "3 mm", "row 4 of a.csv"), "a rule; got 3 mm in row 4 of a.csv."),
        (("a rule", "3 mm", "a.csv", "Do this."), "a rule; got 3 mm in a.csv. Do this."),
        (("a rule", "", "", "Do this."), "a rule. Do this."),
    ],
)
def test_sentence(parts, text):
    assert compose_message(*parts) == text
    assert str(refuse(*parts)) == text


def test_a_complaint_is_a_value_error():
    assert isinstance(refuse("a rule"), BadInput)
    assert issubclass(BadInput, ValueError)
    assert issubclass(InputWarning, UserWarning)


def test_nearest_names_one_or_all():
    assert suggest_word("presure", ["length", "pressure"]) == "Did you mean `pressure`?"
    assert suggest_word("xyz", ["length", "pressure"]) == "Known are `length`, `pressure`."


def test_nearest_names_who_lists_what_is_too_much_for_a_sentence():
    assert suggest_word("presure", ["length", "pressure"], "pamjax explain") == "Did you mean `pressure`?"
    assert (
        suggest_word("xyz", ["length", "pressure"], "pamjax explain")
        == "`pamjax explain` lists what there is."
    )

"""Error messages have one sentence with rule, value, place and remedy."""

import pytest

from pamjax.errors import BadInput, InputWarning, compose_message, suggest_word


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
def test_message_has_rule_value_place_and_remedy(parts, text):
    assert compose_message(*parts) == text
    assert str(BadInput.from_rule(*parts)) == text


def test_message_with_cut_parts_ends_as_a_sentence():
    long = "x" * 1000
    message = compose_message(long, long, long, f"Write `{long}`.")
    assert message.endswith("xxx….")
    assert len(message) < 1700
    assert compose_message("a", remedy="Did you mean `b`?") == "a. Did you mean `b`?"


def test_bad_input_is_a_value_error():
    assert isinstance(BadInput.from_rule("a rule"), BadInput)
    assert issubclass(BadInput, ValueError)
    assert issubclass(InputWarning, UserWarning)


def test_hint_has_the_nearest_name_or_all_names():
    assert suggest_word("presure", ["length", "pressure"]) == "Did you mean `pressure`?"
    assert suggest_word("xyz", ["length", "pressure"]) == "Valid names are `length`, `pressure`."


def test_hint_refers_to_a_command_for_long_lists():
    assert suggest_word("presure", ["length", "pressure"], "pamjax explain") == "Did you mean `pressure`?"
    assert (
        suggest_word("xyz", ["length", "pressure"], "pamjax explain") == "`pamjax explain` lists all names."
    )

"""TOML files that are too large, too deep, or have numbers that no float holds: one sentence at once."""

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pamjax.errors import BadInput
from pamjax.records.toml_text import parse_toml


def read_error(text):
    start = time.monotonic()
    with pytest.raises(BadInput) as error:
        parse_toml(text.encode(), "a.toml")
    assert time.monotonic() - start < 2.0
    return str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = " + "[" * 2000, "a.toml must not have deeply nested brackets. Close each bracket."),
        (
            "a = " + "9" * 400,
            "`a` must be a whole number below 2^63; got a number of 400 digits in a.toml. Remove digits.",
        ),
        ("a = " + "9" * 5000, "a.toml must be TOML; got a number with thousands of digits."),
        (
            ".".join("a" * 50_000) + " = 1",
            "a line must have at most 10000 characters; got 100003 in line 1 of a.toml. Break the line.",
        ),
        (
            "".join(f"a{k} = 1\n" for k in range(300_000)),
            "a.toml must have at most 1 MB; got 3.5 MB. Remove entries.",
        ),
        ("#\n" * 1_000_000, "a.toml must have at most 1 MB; got 2.0 MB. Remove entries."),
        ("a", "a.toml must be TOML; got expected '=' after a key in a key/value pair"),
        ("b = 1\na = 1,45", "). The decimal mark is a point: write 1.45."),
        ("a = {b = -0,5, c = 1}", "). The decimal mark is a point: write -0.5."),
        ("a = [1,45\nb = 2", "Write a text in double quotes, and a table name in [brackets]."),
    ],
    ids=[
        "deep",
        "400 digits",
        "5000 digits",
        "dotted",
        "keys",
        "comments",
        "no toml",
        "comma",
        "comma in a table",
        "list",
    ],
)
def test_unreadable_text_is_one_sentence(text, message):
    assert message in read_error(text)


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused(text):
    message = ""
    try:
        parse_toml(text.encode("utf-8", "surrogatepass"), "a.toml")
    except BadInput as error:
        message = str(error)
    assert len(message.splitlines()) <= 1


def test_usual_text_is_read():
    assert parse_toml(b'a = 3\r\nb = {c = [1, 9223372036854775807], d = "x"}', "a.toml") == {
        "a": 3,
        "b": {"c": [1, 2**63 - 1], "d": "x"},
    }

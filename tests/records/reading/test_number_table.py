"""The fast reader of plain tables: equal to the reader of cells, and used only for plain files."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pamjax.records.reading import number_table
from pamjax.records.reading.number_table import read_number_table
from pamjax.records.reading.text_table import read_text_table

HEADER = "pressure [kPa],length [mm],force [N]"
NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.sampled_from(["", "1", "+1.", "-.5", "1E5", " 2.5", "1e-3 ", "007", "1e999"]),
)


def assert_same(plain, cells):
    assert plain.header == cells.header
    np.testing.assert_array_equal(plain.rows, cells.rows)
    for k in range(len(plain.header)):
        for ours, theirs in zip(plain.read_numbers(k), cells.read_numbers(k), strict=True):
            np.testing.assert_array_equal(ours, theirs)
        for i in range(len(plain.rows)):
            assert plain.read_text(i, k) == cells.read_text(i, k)


@given(
    rows=st.lists(st.tuples(st.floats(1.0, 2.0).map(repr), NUMBERS, NUMBERS), min_size=1, max_size=20),
    start=st.sampled_from(["", "\ufeff", '# a comment, "\n\n', "\n,,\n"]),
    line_end=st.sampled_from(["\n", "\r\n"]),
    end=st.sampled_from(["", "\n", "\n\n\n"]),
)
def test_plain_file_has_the_numbers_of_its_cells(rows, start, line_end, end):
    text = line_end.join([HEADER, *map(",".join, rows)])
    raw = (start + text + end).encode()
    plain = read_number_table(raw)
    assert plain is not None
    assert_same(plain, read_text_table(raw, "a.csv"))


def test_parts_of_a_file_are_joined(monkeypatch):
    random = np.random.default_rng(0)
    table = random.normal(size=(500, 3))
    raw = "\n".join([HEADER, *(",".join(map(repr, row.tolist())) for row in table)]).encode()
    for part_bytes in (1, 70, 1000):
        monkeypatch.setattr(number_table, "_PART_BYTES", part_bytes)
        plain = read_number_table(raw)
        assert plain is not None
        np.testing.assert_array_equal(np.transpose(plain.numbers), table)


@pytest.mark.parametrize(
    "body",
    ["1,2,nan", "1,2,inf", "1,2,1_0", "1,2,0x1", "1,2,3 # a", "1,2,1e", "1,2,1 2", "1,2", "1,2,3,4", ",,", "",
     "1,2,3\n\n4,5,6", '"1",2,3', "1,2,--1", "1,2,\u0663", "1,2,3\r4,5,6", "1,2,3\0"],
)  # fmt: skip
def test_other_contents_are_left_to_the_reader_of_cells(body):
    assert read_number_table(f"{HEADER}\n{body}\n".encode()) is None


@pytest.mark.parametrize(
    "header", ["", "a,b,", '"a",b,c', "a;b;c", "a\tb,b,c", "PK,b,c", "a\0,b,c", "a\rb,c,d", "a,b"]
)
def test_unusual_header_is_left_to_the_reader_of_cells(header):
    assert read_number_table(f"{header}\n1,2,3\n".encode()) is None
    assert read_number_table(b"a,b,c\xff\n1,2,3\n") is None

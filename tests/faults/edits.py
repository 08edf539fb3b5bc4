"""Random edits of input files: bytes, lines, TOML values and CSV columns."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

#: Values that a person, a spreadsheet or a broken program writes in place of a number.
NUMBERS = (
    "0", "-0.0", "-1", "1e308", "1e-320", "1e400", "nan", "-inf", "inf", "99999999999999999999",
    "9" * 400, "1_000", "0x10", "1.", ".5", "1,5", "١٢", "1e", "--1", "true", "1.0000000000000002",
    "3000000",
)  # fmt: skip
#: Texts in place of a text.
TEXTS = (
    "", " ", "none", "nan", "1e999 mm", "-5 mm", "5 kg", "3 furlong", "5 mm mm", "5 mm^9999",
    "5 mm**9**9**9", "5 (((((mm)))))", "mm", "5 µm", "5 \\u00b0", "0 Pa", "1e-300 Pa", "5 %", "../../x",
    "../*", "*", "**", "**/**", "a" * 300, "a" * 9000, "<script>alert(1)</script>", "{{7*7}}", "%s%n",
    "\\u0000", "\\ud7ff", "𝔘", "\\n\\n", "2026-13-45", "elastic", "force", "length", "__class__",
    "5 degC", "5 1/0", "5 m/(s-s)", "10**10**10 mm",
)  # fmt: skip
#: Values in place of a TOML value.
VALUES = (
    "[]", "{}", "[[]]", '[""]', "[1, 'a', true]", "2026-03-02", "2026-03-02T01:02:03Z", "07:32:00",
    "true", '{value = "5 mm"}', '{value = "5 mm", sd = "0 mm"}', '{value = "5 mm", sd = "-1 mm"}',
    "{value = {}}", '{sd = "1 mm"}', "[" * 90 + "]" * 90, '"""a\nb"""', "''", "[1e400]", '["5 mm"]',
    '{column = 0, unit = "N"}', '{column = -1}', '{per_setting = "1 mm"}', "[0.1, -0.1]",
    "[" + "1," * 3000 + "1]",
)  # fmt: skip
#: Lines that are inserted.
LINES = (
    "", "[", "[muscle]", "[[tests]]", "[muscle.name]", "[a.b.c.d]", "= 1", "x = 1", "muscle = 1", "# ü",
    "\x00", "\ufeff", '"" = 1', '"\\u0000" = 1', "\t", "a.b = 1", "[test]\nmeasured = 'length'",
    "[columns]\nforce = 'length [mm]'", "[specimen]\ndate = 2026-01-01", "'''",
)  # fmt: skip
#: Headers of CSV columns.
HEADERS = (
    "time [s]", "time [ms]", "time [h]", "pressure [kPa]", "pressure [bar]", "pressure [psi]",
    "length [mm]", "length [m]", "force [N]", "force [kN]", "diameter [mm]", "cycle", "cycle [mm]",
    "length [%]", "force", "[N]", "", "force [N] [N]", "force [N/0]", "force [[N]]", "x" * 5000, "=cmd()",
    "force [N", "Kraft [N]", "force [m^999]",
)  # fmt: skip

NUMBER_PATTERN = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
TEXT_PATTERN = re.compile(r'"[^"\n]*"')
VALUE_PATTERN = re.compile(r"(?<== )[^\n]+")
KEY_PATTERN = re.compile(r"^[\w.\"]+(?= = )", re.M)
#: Share of the files with one, two and three edits. Most single edits show which check refuses them.
EDIT_SHARES = (0.6, 0.25, 0.15)

Edit = Callable[[str, np.random.Generator], str]


def mutate_toml(text: str, random: np.random.Generator, donors: Sequence[str] = ()) -> bytes:
    """Return a TOML text with one to three random edits.

    Args:
        text: the text.
        random: random numbers.
        donors: texts whose lines may be inserted.
    """
    edits: list[Edit] = [
        replace_number, replace_number, replace_text, replace_text, replace_value, replace_key, remove_line,
        repeat_line, move_line, insert_line, change_unit,
    ]  # fmt: skip
    if donors:
        edits.append(lambda before, rng: insert_from(before, rng, donors))
    return _apply(text, random, edits)


def mutate_csv(text: str, random: np.random.Generator) -> bytes:
    """Return a table with one to three random edits of cells, rows, columns and headers."""
    edits: list[Edit] = [
        replace_number, replace_number, replace_cell, replace_header, change_column, change_column,
        drop_column, repeat_column, swap_columns, remove_line, repeat_line, move_line, insert_line,
        change_marks, keep_few_rows,
    ]  # fmt: skip
    return _apply(text, random, edits)


def _apply(text: str, random: np.random.Generator, edits: Sequence[Edit]) -> bytes:
    for _ in range(1 + int(random.choice(len(EDIT_SHARES), p=EDIT_SHARES))):
        text = edits[int(random.integers(len(edits)))](text, random)
    raw = text.encode("utf-8", "surrogatepass")
    return damage_bytes(raw, random) if random.random() < 0.1 else raw


def damage_bytes(raw: bytes, random: np.random.Generator) -> bytes:
    """Return the bytes with a part removed, repeated or replaced, or in another encoding."""
    at, size = int(random.integers(len(raw) + 1)), int(random.integers(1, 40))
    kind = random.integers(6)
    if kind == 0:
        return raw[:at]
    if kind == 1:
        return raw[:at] + raw[at + size :]
    if kind == 2:
        return raw[:at] + random.bytes(int(random.integers(1, 4))) + raw[at + 1 :]
    if kind == 3:
        return raw[:at] + raw[at : at + size] * 50 + raw[at:]
    if kind == 4:
        return raw.decode("utf-8", "replace").encode("utf-16")
    return raw.replace(b"\n", b"\r\n" if at % 2 else b"\r")


def replace_number(text: str, random: np.random.Generator) -> str:
    """Return the text with another number in one place: hostile, similar, or times a power of ten."""

    def change(number: str) -> str:
        kind = random.random()
        if kind < 0.3:
            return NUMBERS[random.integers(len(NUMBERS))]
        if kind < 0.6:
            return f"{float(number) * float(random.uniform(0.5, 2.0)):g}"
        return f"{float(number) * 10.0 ** float(random.integers(-12, 13)) * float(random.choice([-1, 1])):g}"

    return _replace_match(NUMBER_PATTERN, text, random, change)


def replace_text(text: str, random: np.random.Generator) -> str:
    """Return the text with another quoted text in one place."""
    return _replace_match(TEXT_PATTERN, text, random, lambda _: f'"{_choose(TEXTS, random)}"')


def replace_value(text: str, random: np.random.Generator) -> str:
    """Return the text with another TOML value in one place."""
    return _replace_match(VALUE_PATTERN, text, random, lambda _: _choose(VALUES, random))


def replace_key(text: str, random: np.random.Generator) -> str:
    """Return the text with the key of another line, or a misspelt one, in one place."""
    keys = KEY_PATTERN.findall(text)
    return _replace_match(
        KEY_PATTERN,
        text,
        random,
        lambda key: _choose(keys, random) if random.random() < 0.5 else key[:-1] or "k",
    )


def change_unit(text: str, random: np.random.Generator) -> str:
    """Return the text with another unit after one number."""
    units = (
        "mm",
        "m",
        "km",
        "in",
        "N",
        "kN",
        "kg",
        "Pa",
        "GPa",
        "psi",
        "s",
        "Hz",
        "deg",
        "%",
        "1",
        "mm/s",
        "V",
    )
    return _replace_match(
        re.compile(r'(?<=\d )[^"\s\d]+(?=")'), text, random, lambda _: _choose(units, random)
    )


def remove_line(text: str, random: np.random.Generator) -> str:
    """Return the text without one line."""
    lines = text.split("\n")
    del lines[random.integers(len(lines))]
    return "\n".join(lines)


def repeat_line(text: str, random: np.random.Generator) -> str:
    """Return the text with one line twice or many times."""
    lines = text.split("\n")
    k = int(random.integers(len(lines)))
    return "\n".join(lines[:k] + [lines[k]] * int(random.choice([2, 2, 2000])) + lines[k + 1 :])


def move_line(text: str, random: np.random.Generator) -> str:
    """Return the text with one line in another place."""
    lines = text.split("\n")
    line = lines.pop(random.integers(len(lines)))
    lines.insert(int(random.integers(len(lines) + 1)), line)
    return "\n".join(lines)


def insert_line(text: str, random: np.random.Generator) -> str:
    """Return the text with one line from `LINES`."""
    return _insert(text, _choose(LINES, random), random)


def insert_from(text: str, random: np.random.Generator, donors: Sequence[str]) -> str:
    """Return the text with some lines of another file."""
    lines = _choose(donors, random).split("\n")
    k = int(random.integers(len(lines)))
    return _insert(text, "\n".join(lines[k : k + int(random.integers(1, 6))]), random)


def replace_cell(text: str, random: np.random.Generator) -> str:
    """Return the table with another text in one cell."""
    return _replace_match(re.compile(r"[^,\n]+"), text, random, lambda _: _choose((*NUMBERS, *TEXTS), random))


def replace_header(text: str, random: np.random.Generator) -> str:
    """Return the table with another header of one column."""
    head, _, rest = text.partition("\n")
    titles = head.split(",")
    titles[random.integers(len(titles))] = _choose(HEADERS, random)
    return ",".join(titles) + "\n" + rest


def change_column(text: str, random: np.random.Generator) -> str:
    """Return the table with other numbers in one column: scaled, shifted, constant, or without a value."""
    kind, factor = int(random.integers(6)), 10.0 ** float(random.integers(-9, 10))

    def change(cell: str, k: int) -> str:
        if not NUMBER_PATTERN.fullmatch(cell):
            return cell
        number = float(cell)
        changed = (number * factor, -number, number + factor, factor, number * (k % 2), 0.0)
        return f"{changed[kind]:.10g}"

    return _map_column(text, random, change)


def drop_column(text: str, random: np.random.Generator) -> str:
    """Return the table without one column."""
    return _map_rows(text, random, lambda cells, k: cells[:k] + cells[k + 1 :])


def repeat_column(text: str, random: np.random.Generator) -> str:
    """Return the table with one column twice."""
    return _map_rows(text, random, lambda cells, k: cells[: k + 1] + cells[k:])


def swap_columns(text: str, random: np.random.Generator) -> str:
    """Return the table with the numbers of its columns in another order, below the same headers."""
    head, _, rest = text.partition("\n")
    return head + "\n" + _map_rows(rest, random, lambda cells, k: cells[k:] + cells[:k])


def change_marks(text: str, random: np.random.Generator) -> str:
    """Return the table with another separator, decimal mark or quotation marks."""
    pairs = ((",", ";"), (",", "\t"), (".", ","), (",", " "), ("\n", "\n\n"), (",", '","'))
    old, new = pairs[random.integers(len(pairs))]
    return text.replace(old, new)


def keep_few_rows(text: str, random: np.random.Generator) -> str:
    """Return the table with its first rows."""
    return "\n".join(text.split("\n")[: int(random.integers(0, 8))])


def _map_column(text: str, random: np.random.Generator, change: Callable[[str, int], str]) -> str:
    rows = [line.split(",") for line in text.split("\n")]
    column = int(random.integers(len(rows[0])))
    for k, cells in enumerate(rows):
        if column < len(cells):
            cells[column] = change(cells[column], k)
    return "\n".join(",".join(cells) for cells in rows)


def _map_rows(text: str, random: np.random.Generator, change: Callable[[list[str], int], list[str]]) -> str:
    rows = [line.split(",") for line in text.split("\n")]
    column = int(random.integers(len(rows[0])))
    return "\n".join(",".join(change(cells, column)) for cells in rows)


def _insert(text: str, line: str, random: np.random.Generator) -> str:
    lines = text.split("\n")
    lines.insert(int(random.integers(len(lines) + 1)), line)
    return "\n".join(lines)


def _replace_match(
    pattern: re.Pattern[str], text: str, random: np.random.Generator, change: Callable[[str], str]
) -> str:
    matches = list(pattern.finditer(text))
    if not matches:
        return text
    match = matches[random.integers(len(matches))]
    return text[: match.start()] + change(match[0]) + text[match.end() :]


def _choose(options: Sequence[str], random: np.random.Generator) -> str:
    return options[int(random.integers(len(options)))]

"""Identification of the columns of a CSV file and their units."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pamjax.channels import CHANNEL_BY_NAME
from pamjax.errors import BadInput, suggest_word
from pamjax.units import parse_unit, suggest_units

#: Kind of quantity of each column.
COLUMN_KINDS = {c.name: c.kind for c in CHANNEL_BY_NAME.values()}

#: Default header of each column, for error messages.
_USUAL_HEADERS = {c.name: c.header for c in CHANNEL_BY_NAME.values()}

#: Names of units that state gauge pressure; the pressure of a recording is always gauge pressure.
GAUGE_UNITS = {"psig": "psi", "barg": "bar", "kPag": "kPa", "MPag": "MPa"}
#: Names of units that state absolute pressure, with the same unit of gauge pressure.
ABSOLUTE_UNITS = {"psia": "psi", "bara": "bar", "kPaa": "kPa", "kPa(a)": "kPa"}

#: Units that mean a dimensionless count.
_NO_UNIT_MARKS = ("", "1", "-", "#")

#: Opening and closing mark of a unit.
_UNIT_BRACKETS = ("[]", "()")


@dataclass(frozen=True)
class Column:
    """One column of a file: its channel, header, index, unit and the unit's SI value."""

    name: str
    header: str
    index: int
    unit: str
    factor: float


def split_title(header: str) -> tuple[str, str | None]:
    """Return name and unit of a header cell; the unit is None if there is none.

    >>> split_title("Load (lbf)")
    ('Load', 'lbf')
    >>> split_title("cycle")
    ('cycle', None)
    """
    title = header.strip()
    for opening, closing in _UNIT_BRACKETS:
        start = title.rfind(opening)
        if title.endswith(closing) and start >= 0 and closing not in title[start:-1]:
            return title[:start].rstrip(), title[start + 1 : -1].strip()
    return title, None


def find_columns(
    header: Sequence[str],
    mapping: Mapping[str, str],
    file: str,
    fixed_length: bool,
    measures_length: bool = False,
) -> tuple[dict[str, Column], list[str]]:
    """Return the columns of a header by channel, and the unknown headers.

    Args:
        header: the cells of the header line.
        mapping: header of the file for each channel, as in `[columns]`.
        file: name of the file, for error messages.
        fixed_length: whether the length is stated without a column.
        measures_length: whether the force is set, so that no column of force or diameter is required.

    Raises:
        BadInput: if a required column is missing, occurs twice, or has a wrong unit; all units at once.
    """
    titles = [cell.strip() for cell in header]
    names = _match_names(titles, mapping, file)
    columns: dict[str, Column] = {}
    errors: list[BadInput] = []
    for index, (title, name) in enumerate(zip(titles, names, strict=True)):
        if name is None:
            continue
        if name in columns:
            got = f"`{columns[name].header}` and `{title}`"
            remedy = "Remove one, or map the correct one in [columns] of muscle.toml."
            raise BadInput.from_rule(f"only one column can be `{name}`", got, file, remedy)
        try:
            columns[name] = _build_column(name, title, index, file)
        except BadInput as error:
            errors.append(error)
    if errors:
        raise BadInput(" Also: ".join(map(str, errors)))
    _check_required(columns, titles, file, fixed_length, measures_length)
    return columns, [
        title or "(no header)" for title, name in zip(titles, names, strict=True) if name is None
    ]


def _match_names(titles: Sequence[str], mapping: Mapping[str, str], file: str) -> list[str | None]:
    """Return the channel of each header cell, or None; a mapped header replaces the default one."""
    names: list[str | None] = [None] * len(titles)
    for name, mapped_header in mapping.items():
        if name not in COLUMN_KINDS:
            raise BadInput.from_rule(
                f"unknown channel `{name}`",
                where="[columns]",
                remedy=suggest_word(name, COLUMN_KINDS),
            )
        matches = [
            i for i, title in enumerate(titles) if mapped_header.strip() in (title, split_title(title)[0])
        ]
        if not matches:
            rule = f"`[columns] {name}` must be a header of {file}"
            raise BadInput.from_rule(
                rule,
                f"`{mapped_header}`",
                remedy=suggest_word(mapped_header, [title for title in titles if title]),
            )
        for i in matches:
            names[i] = name
    for i, title in enumerate(titles):
        plain_name = split_title(title)[0].lower()
        if names[i] is None and plain_name in COLUMN_KINDS and plain_name not in mapping:
            names[i] = plain_name
    return names


def _build_column(name: str, title: str, index: int, file: str) -> Column:
    where = f"column `{title}` of {file}"
    _, unit = split_title(title)
    kind = COLUMN_KINDS[name]
    if kind == "count":
        if unit not in (None, *_NO_UNIT_MARKS):
            raise BadInput.from_rule(
                f"`{name}` must be a whole number without a unit", f"{unit!r}", where, "Remove the unit."
            )
        return Column(name, title, index, "1", 1.0)
    if not unit:
        remedy = f"Write it as `{split_title(title)[0]} [unit]`, with a unit such as {suggest_units(kind)}."
        raise BadInput.from_rule(f"the header of `{name}` must state its unit", f"`{title}`", file, remedy)
    if unit in ABSOLUTE_UNITS and name == "pressure":
        remedy = "Subtract the atmospheric pressure, and write the unit without the `a`."
        raise BadInput.from_rule("`pressure` must be gauge pressure", f"{unit!r}", where, remedy)
    unit = GAUGE_UNITS.get(unit, unit)
    return Column(name, title, index, unit, parse_unit(unit, kind, where))


def _check_required(
    columns: Mapping[str, Column], titles: Sequence[str], file: str, fixed_length: bool, measures_length: bool
) -> None:
    if "pressure" not in columns:
        raise _build_missing_error("pressure", titles, file)
    if "length" not in columns and not fixed_length:
        raise _build_missing_error(
            "length", titles, file, " For a fixed length, state `length` in [muscle] of muscle.toml."
        )
    if not measures_length and "force" not in columns and "diameter" not in columns:
        hint = (
            " A recording must have force, diameter, or both. If the length was measured at a set force,"
            ' write [test] measured = "length" in muscle.toml.'
        )
        raise _build_missing_error("force", titles, file, hint)


def _build_missing_error(name: str, titles: Sequence[str], file: str, hint: str = "") -> BadInput:
    guess = _guess_header(name, titles)
    remedy = f'If it is `{guess}`, map it in muscle.toml: [columns] {name} = "{guess}".' if guess else ""
    if not remedy and sum(bool(title.strip()) for title in titles) == 1:
        remedy = "If the headers follow below, delete the lines above them, or begin these lines with #."
    remedy = remedy or f"Rename its header, or map it as `{name}` in [columns] of muscle.toml."
    quoted_titles = ", ".join(f"`{title}`" for title in titles if title)
    return BadInput.from_rule(
        f"a recording must have a column `{_USUAL_HEADERS[name]}`", quoted_titles, file, remedy + hint
    )


def _guess_header(name: str, titles: Sequence[str]) -> str | None:
    """Return the header with the most similar name, or else one with a unit of the channel's kind."""
    others = {split_title(title)[0].lower(): title for title in titles}
    others = {plain: title for plain, title in others.items() if plain not in COLUMN_KINDS}
    matches = difflib.get_close_matches(name, others, n=1, cutoff=0.6)
    if matches:
        return others[matches[0]]
    return next((title for title in others.values() if _has_unit_of_kind(title, COLUMN_KINDS[name])), None)


def _has_unit_of_kind(title: str, kind: str) -> bool:
    unit = split_title(title)[1]
    try:
        return bool(unit) and parse_unit(GAUGE_UNITS.get(unit, unit), kind) > 0
    except BadInput:
        return False

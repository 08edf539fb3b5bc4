"""Identical copies: cases of a fleet whose recording and muscle.toml have the same checksum.

A copy has no information of its own. Statistics over specimens use one case of each group of copies.
"""

from __future__ import annotations

from dataclasses import replace

from pamjax.fleet.fleet import Fleet
from pamjax.fleet.frames import list_rows, select_rows
from pamjax.fleet.store import DONE


def find_copies(fleet: Fleet) -> tuple[tuple[str, ...], ...]:
    """Return groups of cases with identical inputs; in each group, the case that counts is the first."""
    groups: dict[str, list[str]] = {}
    # A complete case represents its copies.
    for row in sorted(list_rows(fleet.cases), key=lambda row: row["state"] != DONE):
        if row["checksum"]:
            groups.setdefault(row["checksum"], []).append(row["case"])
    return tuple(tuple(group) for group in groups.values() if len(group) > 1)


def drop_copies(fleet: Fleet, copies: tuple[tuple[str, ...], ...]) -> Fleet:
    """Return the fleet with one case of each group of copies.

    Args:
        fleet: the fleet.
        copies: groups of `find_copies`.
    """
    dropped = {case for group in copies for case in group[1:]}
    if not dropped:
        return fleet
    tables = {
        name: select_rows(table, ~table["case"].isin(sorted(dropped)))
        for name, table in (
            ("cases", fleet.cases),
            ("numbers", fleet.numbers),
            ("mechanisms", fleet.mechanisms),
            ("regions", fleet.regions),
        )
    }
    return replace(fleet, **tables)

"""Assumptions, uncertainties and sources of a sizing, for its report."""

from __future__ import annotations

from pamjax.records.shipped_tables import read_sidecar
from pamjax.sizing.io import build_receipt
from pamjax.sizing.result import Design
from pamjax.units import format_quantity

#: Units in which a person reads how exactly something is built.
TOLERANCE_UNITS = {"rest_length": "mm", "thread_length": "mm", "turns": "1", "wall": "mm"}


def build_page_receipt(design: Design) -> dict[str, list[str]]:
    """Return the lines of the receipt by heading."""
    choice, sections = design.choice, build_receipt(design)
    kinds = (("threads", choice.thread), ("bladders", choice.bladder))
    for _, kind in kinds:
        # A program reads keys; a person reads the sources below.
        sections["assumed"] = [line.removesuffix(f", sources {kind.source}") for line in sections["assumed"]]
    sections["not known"] = [line for line in sections["not known"] if not line.startswith("how exactly")]
    tolerance_text = _format_tolerances(design)
    if tolerance_text:
        sections["not known"].append(f"how exactly it is built, one standard deviation: {tolerance_text}")
    else:
        sections["assumed"].append("it is built exactly as drawn: the spec states no [tolerance]")
    sections["sources of the materials"] = [
        line for table, kind in kinds for line in _list_sources(table, kind.name, kind.source)
    ]
    return {name: lines for name, lines in sections.items() if lines}


def _format_tolerances(design: Design) -> str:
    tolerance = design.spec.entries.tolerance
    parts = {name: getattr(tolerance, name) for name in TOLERANCE_UNITS}
    return ", ".join(
        f"{n.replace('_', ' ')} ± {format_quantity(sd, TOLERANCE_UNITS[n], 2)}"
        for n, sd in parts.items()
        if sd
    )


def _list_sources(table: str, name: str, keys: str) -> list[str]:
    """Return the sources of a material as printed in its table; a material of the spec has none."""
    if keys == "stated":
        return [f"{name}: as the spec states it"]
    source_texts = read_sidecar(f"materials/{table}")["sources"]
    return [f"{name}: {source_texts.get(key, key)}" for key in keys.split(";")]

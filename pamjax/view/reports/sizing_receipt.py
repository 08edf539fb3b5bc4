"""Assumptions, uncertainties and sources of a sizing, for its report."""

from __future__ import annotations

from pamjax.records.shipped_tables import read_sidecar
from pamjax.sizing.io import build_receipt
from pamjax.sizing.result import Design

#: Headings of the sections of a receipt.
_SECTION_HEADINGS = {
    "assumed": "Assumptions",
    "calibrated": "Calibrated properties",
    "not known": "Uncertain properties",
    "sensitive to": "Sensitivities",
    "searched": "Search",
}


def build_page_receipt(design: Design) -> dict[str, list[str]]:
    """Return the lines of the receipt by heading."""
    choice, sections = design.choice, build_receipt(design)
    materials = (("threads", choice.thread), ("bladders", choice.bladder))
    for _, material in materials:
        # Remove the keys of the sources, because the page lists the sources in full.
        sections["assumed"] = [
            line.removesuffix(f", sources {material.source}") for line in sections["assumed"]
        ]
    page_sections = {_SECTION_HEADINGS[key]: lines for key, lines in sections.items()}
    page_sections["Sources of the material data"] = [
        line for table, material in materials for line in _list_sources(table, material.name, material.source)
    ]
    page_sections["Sources of the sizes of parts"] = _list_part_sources(design)
    return {heading: lines for heading, lines in page_sections.items() if lines}


def _list_part_sources(design: Design) -> list[str]:
    """Return the sources of the sizes of the tube and of the yarn; empty without sold parts."""
    choice, lines = design.choice, []
    if choice.tube is not None:
        lines += _list_sources("tubes", f"tube {choice.tube.size}", choice.tube.source)
    if choice.yarn_count is not None:
        lines += _list_sources("yarns", f"yarn of {choice.describe_thread()}", "count")
    return lines


def _list_sources(table: str, name: str, keys: str) -> list[str]:
    """Return the sources of a material from its table, or that the spec states its properties."""
    if keys == "stated":
        return [f"{name}: stated in the spec"]
    source_texts = read_sidecar(f"materials/{table}")["sources"]
    return [f"{name}: {source_texts.get(key, key)}" for key in keys.split(";")]

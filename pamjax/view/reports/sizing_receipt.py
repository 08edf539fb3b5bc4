"""Assumptions, uncertainties and sources of a sizing, for its report."""

from __future__ import annotations

from pamjax.records.shipped_tables import read_sidecar
from pamjax.sizing.io import TOLERANCE_LABEL, build_receipt
from pamjax.sizing.result import Design
from pamjax.units import format_quantity

#: Units of manufacturing tolerances in reports.
TOLERANCE_UNITS = {"rest_length": "mm", "thread_length": "mm", "turns": "1", "wall": "mm"}


#: Headings of the sections of a receipt.
SECTION_HEADINGS = {
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
    sections["not known"] = [line for line in sections["not known"] if not line.startswith(TOLERANCE_LABEL)]
    tolerance_text = _format_tolerances(design)
    if tolerance_text:
        sections["not known"].append(f"{TOLERANCE_LABEL}{tolerance_text} (one standard deviation)")
    else:
        sections["assumed"].append("no manufacturing errors: the spec states no [tolerance]")
    page_sections = {SECTION_HEADINGS[key]: lines for key, lines in sections.items()}
    page_sections["Sources of the material data"] = [
        line for table, material in materials for line in _list_sources(table, material.name, material.source)
    ]
    return {heading: lines for heading, lines in page_sections.items() if lines}


def _format_tolerances(design: Design) -> str:
    tolerance = design.spec.entries.tolerance
    parts = {name: getattr(tolerance, name) for name in TOLERANCE_UNITS}
    return ", ".join(
        f"{n.replace('_', ' ')} ± {format_quantity(sd, TOLERANCE_UNITS[n], 2)}"
        for n, sd in parts.items()
        if sd
    )


def _list_sources(table: str, name: str, keys: str) -> list[str]:
    """Return the sources of a material from its table, or that the spec states its properties."""
    if keys == "stated":
        return [f"{name}: stated in the spec"]
    source_texts = read_sidecar(f"materials/{table}")["sources"]
    return [f"{name}: {source_texts.get(key, key)}" for key in keys.split(";")]

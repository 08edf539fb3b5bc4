"""What a sizing stands on, for its page: the receipt with its sources by name."""

from __future__ import annotations

from pamjax.records.shipped_tables import sidecar
from pamjax.sizing.io import receipt
from pamjax.sizing.result import Design
from pamjax.units import show

#: Units in which a person reads how exactly something is built.
BUILT = {"rest_length": "mm", "thread_length": "mm", "turns": "1", "wall": "mm"}


def page_receipt(design: Design) -> dict[str, list[str]]:
    """Headings, and a line for each thing that the answer stands on."""
    choice, told = design.choice, receipt(design)
    kinds = (("threads", choice.thread), ("bladders", choice.bladder))
    for _, kind in kinds:
        # A program reads keys; a person reads the sources below.
        told["assumed"] = [line.removesuffix(f", sources {kind.source}") for line in told["assumed"]]
    told["not known"] = [line for line in told["not known"] if not line.startswith("how exactly")]
    built = _built(design)
    if built:
        told["not known"].append(f"how exactly it is built, one standard deviation: {built}")
    else:
        told["assumed"].append("it is built exactly as drawn: the spec states no [tolerance]")
    told["sources of the materials"] = [
        line for table, kind in kinds for line in _sources(table, kind.name, kind.source)
    ]
    return {name: lines for name, lines in told.items() if lines}


def _built(design: Design) -> str:
    tolerance = design.spec.words.tolerance
    parts = {name: getattr(tolerance, name) for name in BUILT}
    return ", ".join(f"{n.replace('_', ' ')} ± {show(sd, BUILT[n], 2)}" for n, sd in parts.items() if sd)


def _sources(table: str, name: str, keys: str) -> list[str]:
    """Each source of a material as its table prints it; a material of the spec's own has none."""
    if keys == "stated":
        return [f"{name}: as the spec states it"]
    full = sidecar(f"materials/{table}")["sources"]
    return [f"{name}: {full.get(key, key)}" for key in keys.split(";")]

"""Spec of a sizing: requirements and catalogue in SI, with checks that involve several entries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pamjax.errors import BadInput
from pamjax.records.files import read_bytes
from pamjax.sizing.specification import materials
from pamjax.sizing.specification.materials import BladderKind, PropertyRange, ThreadKind
from pamjax.sizing.specification.parts import compute_yarn_diameter, list_yarn_counts
from pamjax.sizing.specification.schema import (
    OBJECTIVES,
    ForceDemand,
    OwnBladder,
    OwnThread,
    SpecEntries,
    read_entries,
)
from pamjax.units import format_quantity

#: Usual numbers of threads of braiding machines, both families together.
_THREAD_COUNTS = (16, 24, 32, 48, 64, 96, 144)

#: Assumed length of one fitting, m, and its largest share of the available length.
_DEFAULT_FITTING, _MAX_FITTING_SHARE = 15e-3, 0.08

#: Fractions of a stroke at which its load is checked.
STROKE_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)

#: Largest number of [[force]] entries: a candidate has sixteen operating points, see `candidate.POINT_COUNT`.
_MAX_FORCES = 9

#: Smallest circle around 1 to 12 equal circles, in diameters of one circle.
PACKING_RATIOS = (1, 2, 2.1547, 2.4142, 2.7013, 3, 3, 3.3048, 3.6131, 3.8130, 3.9238, 4.0296)


@dataclass(frozen=True)
class Spec:
    """A spec with its catalogue.

    Attributes:
        entries: all entries, SI.
        file: name of the file; folder: folder of the relative paths in it.
        threads, bladders: the catalogue.
        text: content of the file, "" for a spec from Python.
        stock: whether the muscle is built of parts that are sold.
    """

    entries: SpecEntries
    file: str
    folder: Path
    threads: tuple[ThreadKind, ...]
    bladders: tuple[BladderKind, ...]
    text: str = ""
    stock: bool = False

    @property
    def name(self) -> str:
        return self.entries.name or Path(self.file).stem

    @property
    def supply(self) -> float:
        """Return the highest pressure, Pa."""
        return self.entries.supply.pressure

    @property
    def fittings(self) -> float:
        """Return the length of one fitting, m: of the spec, or assumed for sold parts."""
        envelope = self.entries.envelope
        if envelope.fittings is not None or envelope.length is None or not self.stock:
            return envelope.fittings or 0.0
        return min(_DEFAULT_FITTING, _MAX_FITTING_SHARE * envelope.length)

    @property
    def counts(self) -> tuple[int, ...]:
        """Return the permitted numbers of threads."""
        return self.entries.threads.counts or _THREAD_COUNTS


def read_spec(source: str | Path | Mapping[str, Any], stock: bool = False) -> Spec:
    """Return the spec of a TOML file, or of a mapping with the same entries.

    Args:
        source: the file or the mapping.
        stock: whether threads are yarns that are sold, unless the spec states their diameters.

    Raises:
        BadInput: if the spec is invalid.
    """
    if isinstance(source, Mapping):
        file, folder, text = "the spec", Path(), ""
        entries = read_entries(source, file)
    else:
        path = Path(source)
        raw = read_bytes(path)
        file, folder, text = path.name, path.parent, raw.decode("utf-8-sig", errors="replace")
        entries = read_entries(raw, file)
    _check_demands(entries, file)
    _check_pressures(entries, file)
    _check_parallel(entries, file)
    _check_objectives(entries, file)
    threads = _select_threads(entries, file, stock)
    bladders = _select_bladders(entries, file)
    if "cost" in (entries.minimise, entries.against):
        for kind in (*threads, *bladders):
            if kind.price is None:
                table = "thread" if isinstance(kind, ThreadKind) else "bladder"
                remedy = f'Write [[{table}]] name = "{kind.name}", price = 50.0.'
                raise BadInput.from_rule(
                    "cost needs a price per kilogram of each material",
                    f"no price of {kind.name}",
                    file,
                    remedy,
                )
    return Spec(entries, file, folder, threads, bladders, text, stock)


def _check_demands(entries: SpecEntries, file: str) -> None:
    if not entries.force and entries.stroke is None and entries.free_contraction is None:
        remedy = 'Add [[force]] at_least = "500 N", contraction = 0.1.'
        raise BadInput.from_rule(
            "a spec must state [[force]], [stroke] or `free_contraction`", "none", file, remedy
        )
    if len(entries.force) > _MAX_FORCES:
        got, remedy = f"{len(entries.force)}", "Keep the most demanding ones."
        raise BadInput.from_rule(f"a spec has at most {_MAX_FORCES} [[force]] entries", got, file, remedy)
    for k, demand in enumerate(entries.force, 1):
        if demand.contraction is not None and demand.shortening is not None:
            rule = "a [[force]] table has either `contraction` or `shortening`"
            raise BadInput.from_rule(rule, "both", f"[[force]] {k} of {file}", "Remove one of them.")
    has_length = entries.stroke or entries.limits.rest_length or entries.envelope.length
    if not has_length and all(demand.shortening is None for demand in entries.force):
        remedy = 'Add [envelope] length, [stroke] length or [limits] rest_length = ["100 mm", "300 mm"].'
        raise BadInput.from_rule(
            "a spec must state a length of the muscle, a stroke or a shortening", "none", file, remedy
        )
    envelope_length, fittings = entries.envelope.length, entries.envelope.fittings
    if envelope_length and fittings and 2 * fittings >= envelope_length:
        rule = f"two fittings must be shorter than the envelope ({format_quantity(envelope_length, 'mm')})"
        raise BadInput.from_rule(
            rule,
            format_quantity(2 * fittings, "mm"),
            f"[envelope] of {file}",
            "`fittings` is the length of one fitting.",
        )


def _check_pressures(entries: SpecEntries, file: str) -> None:
    supply = entries.supply.pressure
    for k, demand in enumerate(entries.force, 1):
        if demand.pressure is not None and demand.pressure > supply * (1 + 1e-9):
            rule = (
                f"the pressure of a [[force]] must not exceed the supply ({format_quantity(supply, 'kPa')})"
            )
            raise BadInput.from_rule(
                rule, format_quantity(demand.pressure, "kPa"), f"[[force]] {k} of {file}", "Check its unit."
            )


def _check_parallel(entries: SpecEntries, file: str) -> None:
    muscle_count = max(entries.parallel)
    needs_bundle = entries.envelope.bundle is not None or "diameter" in (entries.minimise, entries.against)
    if needs_bundle and muscle_count > len(PACKING_RATIOS):
        rule = f"the diameter of a bundle can be computed for at most {len(PACKING_RATIOS)} muscles"
        remedy = "Remove [envelope] bundle, and choose another objective than diameter."
        raise BadInput.from_rule(rule, str(muscle_count), f"`parallel` of {file}", remedy)


def _check_objectives(entries: SpecEntries, file: str) -> None:
    if entries.against == entries.minimise:
        others = ", ".join(objective for objective in OBJECTIVES if objective != entries.minimise)
        rule = "`against` must differ from `minimise`"
        raise BadInput.from_rule(rule, entries.minimise, file, f"Write one of {others}.")


def _select_threads(entries: SpecEntries, file: str, stock: bool) -> tuple[ThreadKind, ...]:
    threads_by_name = dict(materials.list_threads())
    for own_thread in entries.thread:
        threads_by_name[own_thread.name] = _build_own_thread(
            own_thread, threads_by_name.get(own_thread.name), file
        )
    names = (
        entries.threads.kinds
        or tuple(own_thread.name for own_thread in entries.thread)
        or tuple(name for name in threads_by_name if not stock or list_yarn_counts(name))
    )
    kinds = [
        materials.find_material(name, threads_by_name, "thread", f"[threads] of {file}") for name in names
    ]
    if entries.threads.diameters is not None:
        return tuple(replace(kind, diameters=entries.threads.diameters) for kind in kinds)
    if stock:
        own_names = {own_thread.name for own_thread in entries.thread if own_thread.diameters is not None}
        kinds = [kind if kind.name in own_names else _use_yarns(kind) for kind in kinds]
    return tuple(kinds)


def _use_yarns(kind: ThreadKind) -> ThreadKind:
    """Return the thread with the diameters of its yarns, or unchanged if it has none."""
    counts = list_yarn_counts(kind.name)
    diameters = tuple(compute_yarn_diameter(kind, count) for count in counts)
    return replace(kind, diameters=diameters) if diameters else kind


def _build_own_thread(own_thread: OwnThread, shipped_thread: ThreadKind | None, file: str) -> ThreadKind:
    stated_values = {key: getattr(own_thread, key) for key in ("modulus", "strength", "density", "diameters")}
    if shipped_thread is None:
        missing = [key for key, value in stated_values.items() if value is None]
        if missing:
            rule = f"your own thread ({own_thread.name!r}) needs modulus, strength, density and diameters"
            raise BadInput.from_rule(rule, f"no `{missing[0]}`", f"[[thread]] of {file}", "Add it.")
        shipped_thread = ThreadKind(
            own_thread.name,
            "stated in the spec",
            PropertyRange(1, 1, 1),
            PropertyRange(1, 1, 1),
            1.0,
            0.7,
            (),
        )
    changes: dict[str, Any] = {}
    for key in ("modulus", "strength"):
        if stated_values[key] is not None:
            changes[key] = PropertyRange(stated_values[key], stated_values[key], stated_values[key])
    for key in ("density", "diameters", "fill", "price"):
        if getattr(own_thread, key) is not None:
            changes[key] = getattr(own_thread, key)
    return replace(shipped_thread, **changes)


def _select_bladders(entries: SpecEntries, file: str) -> tuple[BladderKind, ...]:
    bladders_by_name = dict(materials.list_bladders())
    for own_bladder in entries.bladder:
        bladders_by_name[own_bladder.name] = _build_own_bladder(
            own_bladder, bladders_by_name.get(own_bladder.name), file
        )
    names = (
        entries.bladders.kinds
        or tuple(own_bladder.name for own_bladder in entries.bladder)
        or tuple(bladders_by_name)
    )
    return tuple(
        materials.find_material(name, bladders_by_name, "rubber", f"[bladders] of {file}") for name in names
    )


def _build_own_bladder(
    own_bladder: OwnBladder, shipped_bladder: BladderKind | None, file: str
) -> BladderKind:
    if shipped_bladder is None:
        if own_bladder.modulus is None or own_bladder.density is None:
            rule = f"your own rubber ({own_bladder.name!r}) needs modulus (Young's) and density"
            missing = "modulus" if own_bladder.modulus is None else "density"
            raise BadInput.from_rule(rule, f"no `{missing}`", f"[[bladder]] of {file}", "Add it.")
        shipped_bladder = BladderKind(
            own_bladder.name, "stated in the spec", PropertyRange(1, 1, 1), 0.0, 1.0, 5.0, (0.2e-3, 5e-3)
        )
    changes: dict[str, Any] = {}
    if own_bladder.modulus is not None:
        changes["modulus"] = PropertyRange(
            own_bladder.modulus / 3, own_bladder.modulus / 3, own_bladder.modulus / 3
        )
    for key in ("density", "elongation", "price"):
        if getattr(own_bladder, key) is not None:
            changes[key] = getattr(own_bladder, key)
    return replace(shipped_bladder, **changes)


def format_force_place(demand: ForceDemand) -> str:
    """Return the operating point of a required force as text."""
    place = "at rest length"
    if demand.contraction:
        place = f"at {100 * demand.contraction:g} % contraction"
    elif demand.shortening:
        place = f"at {format_quantity(demand.shortening, 'mm')} shortening"
    return place + (f" and {format_quantity(demand.pressure, 'kPa')}" if demand.pressure is not None else "")

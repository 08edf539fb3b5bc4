"""What a muscle must do and may be made of: a spec in SI, checked for what no single entry shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pamjax.errors import refuse
from pamjax.records.files import read_bytes
from pamjax.sizing import materials
from pamjax.sizing.materials import BladderKind, Known, ThreadKind
from pamjax.sizing.schema import OBJECTIVES, OwnBladder, OwnThread, Pull, Words, read_words
from pamjax.units import show

#: Threads of both families that braiding machines are built for.
COUNTS = (16, 24, 32, 48, 64, 96, 144)

#: Shares of a stroke at which its load is checked.
WAY = (0.0, 0.25, 0.5, 0.75, 1.0)

#: Most [[force]] entries: a candidate is asked at sixteen places, one of which is the proof at rest.
MOST_FORCES = 9

#: Circle around equal circles, over the diameter of one: the known optimum for 1 to 12 of them.
PACKING = (1, 2, 2.1547, 2.4142, 2.7013, 3, 3, 3.3048, 3.6131, 3.8130, 3.9238, 4.0296)


@dataclass(frozen=True)
class Spec:
    """A spec as read.

    Attributes:
        words: every entry, SI.
        file: its name; folder: where paths in it start from.
        threads, bladders: the catalogue.
        text: the file as it was, "" for one from Python.
    """

    words: Words
    file: str
    folder: Path
    threads: tuple[ThreadKind, ...]
    bladders: tuple[BladderKind, ...]
    text: str = ""

    @property
    def name(self) -> str:
        return self.words.name or Path(self.file).stem

    @property
    def supply(self) -> float:
        """Highest pressure, Pa."""
        return self.words.supply.pressure

    @property
    def counts(self) -> tuple[int, ...]:
        """Numbers of threads to choose from."""
        return self.words.threads.counts or COUNTS


def read_spec(source: str | Path | Mapping[str, Any]) -> Spec:
    """Read a spec from a TOML file, or from the same words as a mapping.

    Raises:
        BadInput: in one sentence, if it cannot be used.
    """
    if isinstance(source, Mapping):
        file, folder, text = "the spec", Path(), ""
        words = read_words(source, file)
    else:
        path = Path(source)
        raw = read_bytes(path)
        file, folder, text = path.name, path.parent, raw.decode("utf-8-sig", errors="replace")
        words = read_words(raw, file)
    _does_something(words, file)
    _pressures(words, file)
    _parallel(words, file)
    _two_objectives(words, file)
    threads = _threads(words, file)
    bladders = _bladders(words, file)
    if "cost" in (words.minimise, words.against):
        for kind in (*threads, *bladders):
            if kind.price is None:
                table = "thread" if isinstance(kind, ThreadKind) else "bladder"
                remedy = f'Write [[{table}]] name = "{kind.name}", price = 50.0.'
                raise refuse("cost needs a price a kilogram of each material", kind.name, file, remedy)
    return Spec(words, file, folder, threads, bladders, text)


def _does_something(words: Words, file: str) -> None:
    if not words.force and words.stroke is None and words.free_contraction is None:
        remedy = 'Add [[force]] at_least = "500 N", contraction = 0.1.'
        raise refuse("a spec must state [[force]], [stroke] or `free_contraction`", "none", file, remedy)
    if len(words.force) > MOST_FORCES:
        got, remedy = f"{len(words.force)}", "Keep those that ask for most."
        raise refuse(f"a spec has at most {MOST_FORCES} [[force]] entries", got, file, remedy)
    for k, pull in enumerate(words.force, 1):
        if pull.contraction is not None and pull.shortening is not None:
            rule = "a [[force]] is at a `contraction` or at a `shortening`"
            raise refuse(rule, "both", f"[[force]] {k} of {file}", "Keep one.")
    absolute = words.stroke or words.limits.rest_length or words.envelope.length
    if not absolute and all(pull.shortening is None for pull in words.force):
        remedy = 'Add [envelope] length, [stroke] length or [limits] rest_length = ["100 mm", "300 mm"].'
        raise refuse("a spec must say how long the muscle is, or how far it moves", "neither", file, remedy)
    room, fittings = words.envelope.length, words.envelope.fittings
    if room and fittings and 2 * fittings >= room:
        rule = f"two fittings must be shorter than the envelope ({show(room, 'mm')})"
        raise refuse(
            rule, show(2 * fittings, "mm"), f"[envelope] of {file}", "`fittings` is that of one end."
        )


def _pressures(words: Words, file: str) -> None:
    supply = words.supply.pressure
    for k, pull in enumerate(words.force, 1):
        if pull.pressure is not None and pull.pressure > supply * (1 + 1e-9):
            rule = f"a force is wanted at no more than the supply ({show(supply, 'kPa')})"
            raise refuse(rule, show(pull.pressure, "kPa"), f"[[force]] {k} of {file}", "Check its unit.")


def _parallel(words: Words, file: str) -> None:
    most = max(words.parallel)
    asked = words.envelope.bundle is not None or "diameter" in (words.minimise, words.against)
    if asked and most > len(PACKING):
        rule = f"the diameter of a bundle is known for up to {len(PACKING)} muscles"
        remedy = "Leave out [envelope] bundle, and minimise another."
        raise refuse(rule, str(most), f"`parallel` of {file}", remedy)


def _two_objectives(words: Words, file: str) -> None:
    if words.against == words.minimise:
        others = ", ".join(one for one in OBJECTIVES if one != words.minimise)
        rule = "`against` is another objective than `minimise`"
        raise refuse(rule, words.minimise, file, f"Write one of {others}.")


def _threads(words: Words, file: str) -> tuple[ThreadKind, ...]:
    known = dict(materials.threads())
    for own in words.thread:
        known[own.name] = _own_thread(own, known.get(own.name), file)
    named = words.threads.kinds or tuple(own.name for own in words.thread) or tuple(known)
    kinds = [materials.of_name(name, known, "thread", f"[threads] of {file}") for name in named]
    if words.threads.diameters is not None:
        kinds = [replace(kind, diameters=words.threads.diameters) for kind in kinds]
    return tuple(kinds)


def _own_thread(own: OwnThread, shipped: ThreadKind | None, file: str) -> ThreadKind:
    stated = {key: getattr(own, key) for key in ("modulus", "strength", "density", "diameters")}
    if shipped is None:
        missing = [key for key, value in stated.items() if value is None]
        if missing:
            rule = f"a thread of your own ({own.name!r}) states modulus, strength, density and diameters"
            raise refuse(rule, f"no `{missing[0]}`", f"[[thread]] of {file}", "Add it.")
        shipped = ThreadKind(own.name, "stated in the spec", Known(1, 1, 1), Known(1, 1, 1), 1.0, 0.7, ())
    changed: dict[str, Any] = {}
    for key in ("modulus", "strength"):
        if stated[key] is not None:
            changed[key] = Known(stated[key], stated[key], stated[key])
    for key in ("density", "diameters", "fill", "price"):
        if getattr(own, key) is not None:
            changed[key] = getattr(own, key)
    return replace(shipped, **changed)


def _bladders(words: Words, file: str) -> tuple[BladderKind, ...]:
    known = dict(materials.bladders())
    for own in words.bladder:
        known[own.name] = _own_bladder(own, known.get(own.name), file)
    named = words.bladders.kinds or tuple(own.name for own in words.bladder) or tuple(known)
    return tuple(materials.of_name(name, known, "rubber", f"[bladders] of {file}") for name in named)


def _own_bladder(own: OwnBladder, shipped: BladderKind | None, file: str) -> BladderKind:
    if shipped is None:
        if own.modulus is None or own.density is None:
            rule = f"a rubber of your own ({own.name!r}) states modulus (Young's) and density"
            missing = "modulus" if own.modulus is None else "density"
            raise refuse(rule, f"no `{missing}`", f"[[bladder]] of {file}", "Add it.")
        shipped = BladderKind(own.name, "stated in the spec", Known(1, 1, 1), 0.0, 1.0, 5.0, (0.2e-3, 5e-3))
    changed: dict[str, Any] = {}
    if own.modulus is not None:
        changed["modulus"] = Known(own.modulus / 3, own.modulus / 3, own.modulus / 3)
    for key in ("density", "elongation", "price"):
        if getattr(own, key) is not None:
            changed[key] = getattr(own, key)
    return replace(shipped, **changed)


def at_words(pull: Pull) -> str:
    """Where a force is wanted, in words."""
    where = "at rest"
    if pull.contraction:
        where = f"at {100 * pull.contraction:g} %"
    elif pull.shortening:
        where = f"{show(pull.shortening, 'mm')} shorter"
    return where + (f" and {show(pull.pressure, 'kPa')}" if pull.pressure is not None else "")

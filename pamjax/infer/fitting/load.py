"""A muscle to simulate: a case folder as stated, or a fit.json as calibrated."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
from jaxtyping import Array

from pamjax.errors import nearest, refuse
from pamjax.infer.fitting.io import SCHEMA
from pamjax.infer.problem.priors import sizes, stated
from pamjax.model.assembly import assemble, assemble_bench, bench_law, mechanism_numbers
from pamjax.model.bench import Bench
from pamjax.model.muscle import Muscle
from pamjax.model.parameters import meaning
from pamjax.model.registry import not_twice
from pamjax.records.case import MUSCLE, RECORDING
from pamjax.records.files import read_bytes
from pamjax.records.reading.muscle_toml import Entry, read_entry


@dataclass(frozen=True)
class Loaded:
    """A muscle and what is known of it.

    Attributes:
        muscle: the muscle, on a bench where it has mechanisms.
        entry: its muscle.toml.
        text: the text of its muscle.toml.
        calibrated: lowest and highest calibrated "pressure" (Pa) and "length" (m); empty if it was
            not calibrated.
        law, mechanisms, numbers: from which it is assembled; numbers in SI.
        checksum: of the recording and muscle.toml that it stands for; "" where there is no recording.
    """

    muscle: Muscle | Bench
    entry: Entry
    text: str
    calibrated: dict[str, tuple[float, float]]
    law: str
    mechanisms: tuple[str, ...]
    numbers: Mapping[str, Array]
    checksum: str = ""

    @property
    def rubber_left_out(self) -> bool:
        """Whether muscle.toml states a rubber that the muscle does without."""
        bladder = self.entry.bladder
        return (
            bladder is not None
            and bladder.modulus is not None
            and "bladder_elasticity" not in self.mechanisms
        )


def load_muscle(
    source: str | Path,
    law: str | None = None,
    case: str | None = None,
    settings: Mapping[str, float] | None = None,
) -> Loaded:
    """Read a muscle from a case folder, a muscle.toml, a fit.json, or a model.json of a diagnosis.

    Args:
        source: the folder or file.
        law: thread law, for a muscle as stated; None takes its baseline.
        case: which case of a fit.json that holds several.
        settings: numbers of mechanisms to add or to change, SI, as {"braid_friction.coefficient": 0.2}.

    Returns:
        a `Loaded`: its `muscle` (a bench where mechanisms act), and the pressures, Pa, and lengths, m, that
        it was `calibrated` on.

    Raises:
        BadInput: if it cannot be read.
    """
    source = Path(source)
    if source.suffix == ".json":
        if law is not None:
            remedy = "Leave `--law` out, or name the case folder."
            raise refuse("a calibrated muscle keeps the law it was fitted with", law, source.name, remedy)
        return _calibrated(source, case, settings or {})
    if case is not None:
        raise refuse("`--case` names a case of a fit.json", str(source), remedy="Leave it out.")
    file = source / MUSCLE if source.is_dir() else source
    raw = read_bytes(file)
    entry = read_entry(raw, file.name)
    law = law or entry.baseline
    numbers = {name: jnp.asarray(m.value) for name, m in stated(entry, law).items()}
    known = {name: jnp.asarray(m.value) for name, m in sizes(entry).items()}
    made = _with_mechanisms(law, (), numbers, known, settings or {})
    recording = source / RECORDING if source.is_dir() else None
    beside = recording is not None and recording.exists()
    same = hashlib.sha256(read_bytes(recording) + raw).hexdigest() if recording and beside else ""
    return Loaded(build(*made), entry, raw.decode("utf-8-sig"), {}, *made, same)


def build(law: str, ids: tuple[str, ...], numbers: Mapping[str, Array]) -> Muscle | Bench:
    """The muscle, or the bench if anything acts beside its threads."""
    return assemble_bench(law, ids, numbers) if ids else assemble(law, numbers)


def _with_mechanisms(law, ids, numbers, known, settings: Mapping[str, float]):
    """Law, mechanisms and numbers with the settings among them."""
    named = dict.fromkeys((*ids, *(_owner(name) for name in settings)))
    if not named:
        return law, (), numbers
    not_twice(named)
    law = bench_law(law, named)
    own = mechanism_numbers(named)
    by_field = {name: known[field] for name, (_, field) in own.items() if field in known}
    usual = by_field | {name: known[name] for name in own if name in known}
    new = {name: jnp.asarray(value) for name, value in settings.items()}
    return law, tuple(named), usual | numbers | new


def _owner(name: str) -> str:
    """The mechanism that owns a number, by the number's name."""
    meaning(name)
    owner = name.partition(".")[0]
    if owner in ("muscle", "thread"):
        raise refuse("only numbers of mechanisms can be set here", name, remedy="Change it in muscle.toml.")
    return owner


def _calibrated(file: Path, case: str | None, settings: Mapping[str, float]) -> Loaded:
    raw = read_bytes(file)
    try:
        document = json.loads(raw)
    except ValueError as error:
        raise refuse("a calibrated muscle is a fit.json", str(error), file.name) from error
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        got = document.get("schema", "no schema") if isinstance(document, dict) else "no object"
        remedy = "Name the model.json beside it." if (file.parent / "model.json").exists() else ""
        raise refuse(f"a calibrated muscle is a file of schema {SCHEMA}", str(got), file.name, remedy)
    try:
        return _chosen(document["cases"], file, case, settings)
    except (KeyError, TypeError, AttributeError) as error:
        rule, remedy = "a fit.json must be whole", "Write it again with `pamjax fit`."
        raise refuse(rule, f"no {error}", file.name, remedy) from error


def _chosen(cases: dict, file: Path, case: str | None, settings: Mapping[str, float]) -> Loaded:
    if not cases:
        raise KeyError("case")
    if case is None and len(cases) > 1:
        raise refuse("a fit of several cases needs `--case`", ", ".join(cases), file.name, "Name one.")
    name = case or next(iter(cases))
    if name not in cases:
        raise refuse(f"{name!r} is no case of {file.name}", remedy=nearest(name, cases))
    one = cases[name]
    numbers = {key: jnp.asarray(value) for key, value in one["muscle"]["numbers"].items()}
    entry = read_entry(one["muscle_toml"].encode(), "muscle.toml")
    known = {key: jnp.asarray(m.value) for key, m in sizes(entry).items()}
    muscle = one["muscle"]
    made = _with_mechanisms(muscle["law"], muscle["mechanisms"], numbers, known, settings)
    ends = {key: (ends["low"], ends["high"]) for key, ends in one["calibrated"].items()}
    return Loaded(build(*made), entry, one["muscle_toml"], ends, *made, one.get("checksum", ""))

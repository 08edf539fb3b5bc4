"""Loader of a muscle: as stated in a case folder, or as calibrated in a fit.json."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from pamjax.errors import BadInput, suggest_word
from pamjax.infer.fitting.io import FIT_SCHEMA
from pamjax.infer.form_errors.form_model import FormErrorModel
from pamjax.infer.form_errors.form_model_file import FORM_MODEL_KEY, read_form_model
from pamjax.infer.problem.priors import collect_stated_values, estimate_tube_sizes
from pamjax.model.assembly import assemble, assemble_bench, list_mechanism_parameters, resolve_bench_law
from pamjax.model.bench import Bench
from pamjax.model.muscle import Muscle
from pamjax.model.parameters import find_meaning
from pamjax.model.registry import check_exclusive_pairs
from pamjax.records.case import MUSCLE_FILE, RECORDING_FILE
from pamjax.records.files import read_bytes
from pamjax.records.json_number import check_json_number
from pamjax.records.reading.muscle_toml import MuscleToml, read_muscle_toml


@dataclass(frozen=True)
class LoadedMuscle:
    """A muscle with its source data.

    Attributes:
        muscle: the muscle; a `Bench` if it has mechanisms.
        muscle_toml: the contents of its muscle.toml.
        text: the text of its muscle.toml.
        calibrated_range: lowest and highest calibrated "pressure" (Pa) and "length" (m); empty if it was
            not calibrated.
        law, mechanisms, numbers: thread law, mechanisms and parameters of the muscle; parameters in SI.
        checksum: checksum of its recording and muscle.toml; "" without a recording.
        form_errors: the muscle with the form errors of its fit; None if there are none. `muscle` has none.
    """

    muscle: Muscle | Bench
    muscle_toml: MuscleToml
    text: str
    calibrated_range: dict[str, tuple[float, float]]
    law: str
    mechanisms: tuple[str, ...]
    numbers: Mapping[str, Array]
    checksum: str = ""
    form_errors: FormErrorModel | None = None

    @property
    def neglects_rubber(self) -> bool:
        """Return whether muscle.toml states a rubber modulus that the muscle does not use."""
        bladder = self.muscle_toml.bladder
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
) -> LoadedMuscle:
    """Return a muscle with its law, parameters, muscle.toml and calibrated range.

    The `muscle` of the result is the `Muscle`, or a `Bench` if it has mechanisms. It has no form errors:
    `validate` and the command `simulate` add those of `form_errors`, all other functions neglect them.

    Args:
        source: a case folder, a muscle.toml, a fit.json, or a model.json of a diagnosis.
        law: thread law, for a muscle as stated; None takes its baseline.
        case: name of the case, for a fit.json with several cases.
        settings: mechanism parameters to add or to change, SI, as {"braid_friction.coefficient": 0.2}.

    Returns:
        the `LoadedMuscle`, for `predict`, `inverse`, `plan` and `validate`.

    Raises:
        BadInput: if it cannot be read.

    Example:
        loaded = pamjax.load_muscle("mine", settings={"braid_friction.coefficient": 0.2})
        print(loaded.muscle)
    """
    source = Path(source)
    if source.suffix == ".json":
        if law is not None:
            remedy = "Omit `law`, or use the case folder."
            raise BadInput.from_rule(
                "the thread law of a calibrated muscle cannot be changed", law, source.name, remedy
            )
        return _load_calibrated(source, case, settings or {})
    if case is not None:
        raise BadInput.from_rule("`case` needs a fit.json", str(source), remedy="Omit `case`.")
    file = source / MUSCLE_FILE if source.is_dir() else source
    raw = read_bytes(file)
    muscle_toml = read_muscle_toml(raw, file.name)
    law = law or muscle_toml.baseline
    numbers = {name: jnp.asarray(m.value) for name, m in collect_stated_values(muscle_toml, law).items()}
    tube_sizes = {name: jnp.asarray(m.value) for name, m in estimate_tube_sizes(muscle_toml).items()}
    parts = _add_mechanisms(law, (), numbers, tube_sizes, settings or {})
    recording = source / RECORDING_FILE if source.is_dir() else None
    has_recording = recording is not None and recording.exists()
    checksum = hashlib.sha256(read_bytes(recording) + raw).hexdigest() if recording and has_recording else ""
    return LoadedMuscle(build_muscle(*parts), muscle_toml, raw.decode("utf-8-sig"), {}, *parts, checksum)


def build_muscle(law: str, ids: tuple[str, ...], numbers: Mapping[str, Array]) -> Muscle | Bench:
    """Return the muscle, or a bench if it has mechanisms.

    Args:
        law: thread law.
        ids: mechanisms.
        numbers: parameters by name, SI.
    """
    return assemble_bench(law, ids, numbers) if ids else assemble(law, numbers)


def _add_mechanisms(law, ids, numbers, tube_sizes, settings: Mapping[str, float]):
    """Return law, mechanisms and parameters, including the values in `settings`."""
    all_ids = dict.fromkeys((*ids, *(_find_mechanism(name) for name in settings)))
    if not all_ids:
        return law, (), numbers
    check_exclusive_pairs(all_ids)
    law = resolve_bench_law(law, all_ids)
    mechanism_parameters = list_mechanism_parameters(all_ids)
    by_field = {
        name: tube_sizes[field] for name, (_, field) in mechanism_parameters.items() if field in tube_sizes
    }
    defaults = by_field | {name: tube_sizes[name] for name in mechanism_parameters if name in tube_sizes}
    new = {name: jnp.asarray(value) for name, value in settings.items()}
    return law, tuple(all_ids), defaults | numbers | new


def _find_mechanism(name: str) -> str:
    """Return the mechanism of a parameter, by the parameter's name."""
    find_meaning(name)
    owner = name.partition(".")[0]
    if owner in ("muscle", "thread"):
        raise BadInput.from_rule(
            "only parameters of mechanisms can be set here", name, remedy="Change it in muscle.toml."
        )
    return owner


def _load_calibrated(file: Path, case: str | None, settings: Mapping[str, float]) -> LoadedMuscle:
    raw = read_bytes(file)
    try:
        document = json.loads(raw)
    # Python's reader of JSON ends in a RecursionError on thousands of brackets.
    except (ValueError, RecursionError) as error:
        remedy = "Name the fit.json that `pamjax fit` wrote."
        raise BadInput.from_rule(
            "a calibrated muscle is a fit.json", str(error), file.name, remedy
        ) from error
    if not isinstance(document, dict) or document.get("schema") != FIT_SCHEMA:
        got = document.get("schema", "no schema") if isinstance(document, dict) else "no object"
        remedy = "Use the model.json in the same folder." if (file.parent / "model.json").exists() else ""
        raise BadInput.from_rule(
            f"a calibrated muscle is a file of schema {FIT_SCHEMA}", str(got), file.name, remedy
        )
    try:
        return _load_case_entry(document["cases"], file, case, settings)
    except (KeyError, TypeError, AttributeError) as error:
        rule, remedy = "a fit.json must be complete", "Write it again with `pamjax fit`."
        raise BadInput.from_rule(rule, f"no {error}", file.name, remedy) from error


def _load_case_entry(
    cases: dict, file: Path, case: str | None, settings: Mapping[str, float]
) -> LoadedMuscle:
    if not cases:
        raise KeyError("case")
    if case is None and len(cases) > 1:
        raise BadInput.from_rule(
            "a fit of several cases needs `case`", ", ".join(cases), file.name, "Choose one case."
        )
    name = case or next(iter(cases))
    if name not in cases:
        raise BadInput.from_rule(f"unknown case {name!r} in {file.name}", remedy=suggest_word(name, cases))
    case_entry = cases[name]
    numbers = {
        key: jnp.asarray(check_json_number(key, value, file.name))
        for key, value in case_entry["muscle"]["numbers"].items()
    }
    muscle_toml = read_muscle_toml(case_entry["muscle_toml"].encode(), "muscle.toml")
    tube_sizes = {key: jnp.asarray(m.value) for key, m in estimate_tube_sizes(muscle_toml).items()}
    muscle = case_entry["muscle"]
    parts = _add_mechanisms(muscle["law"], muscle["mechanisms"], numbers, tube_sizes, settings)
    ranges = {
        key: (
            check_json_number(f"{key}.low", ends["low"], file.name),
            check_json_number(f"{key}.high", ends["high"], file.name),
        )
        for key, ends in case_entry["calibrated"].items()
    }
    return LoadedMuscle(
        build_muscle(*parts),
        muscle_toml,
        case_entry["muscle_toml"],
        ranges,
        *parts,
        case_entry.get("checksum", ""),
        _load_form_errors(case_entry, file, tube_sizes, settings),
    )


def _load_form_errors(
    case_entry: Mapping[str, Any], file: Path, tube_sizes, settings: Mapping[str, float]
) -> FormErrorModel | None:
    """Return the muscle with form errors, and with the values in `settings`; None if there are none."""
    entry, muscle = case_entry.get(FORM_MODEL_KEY), case_entry["muscle"]
    if entry is None:
        return None
    model = read_form_model(entry, muscle["law"], muscle["mechanisms"], file.name)
    (law, ids, numbers), (_, _, effect_numbers) = (
        _add_mechanisms(model.law, model.mechanisms, values, tube_sizes, settings)
        for values in (model.numbers, model.effect_numbers)
    )
    return replace(model, law=law, mechanisms=ids, numbers=numbers, effect_numbers=effect_numbers)

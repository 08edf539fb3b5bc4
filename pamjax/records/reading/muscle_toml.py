"""Contents of muscle.toml as checked values in SI, each with its standard deviation (sd)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pamjax.errors import BadInput
from pamjax.records.reading.quantity import MeasuredValue
from pamjax.records.reading.schema import MuscleDocument, MuscleTable, ThreadTable, read_document
from pamjax.records.reading.specimen import Specimen
from pamjax.units import format_quantity

__all__ = ["Bladder", "MeasuredValue", "MuscleToml", "Sensors", "parse_muscle_toml", "read_muscle_toml"]


@dataclass(frozen=True)
class Bladder:
    """Dimensions of the rubber tube, m, and its Young's modulus at small strain, Pa; None if not stated."""

    inner_diameter: MeasuredValue | None = None
    thickness: MeasuredValue | None = None
    modulus: MeasuredValue | None = None


@dataclass(frozen=True)
class Sensors:
    """Sensor noise of one sample, standard deviation, SI; None if it is to be estimated.

    With `length_per_level`, all samples of one length level have the same length error.
    """

    force: float | None = None
    diameter: float | None = None
    pressure: float | None = None
    length: float | None = None
    length_per_level: bool = False


@dataclass(frozen=True)
class MuscleToml:
    """Contents of muscle.toml, SI.

    The braid has one of two equivalent forms: `thread_length` (m) and `turns`, or `braid_angle` (rad, from
    the circumference) and mid-thread `diameter` (m), both at rest.

    Attributes:
        name: name of the muscle.
        rest_length: m, the length at zero contraction.
        thread_length: m, length of one thread from fitting to fitting.
        turns: number of turns of one thread around the muscle.
        braid_angle: rad, between thread and circumference, at rest.
        diameter: m, of the thread layer, at rest.
        threads: number of threads of both families.
        thread_area: m^2, cross-section of one thread.
        length: m, the fixed length of a recording without a length column.
        fitting_diameter: m, outer diameter of the fitting at the clamped braid.
        modulus: Pa, Young's modulus of the thread.
        stiffness: N, of all threads together, n·E·A.
        bladder: None if the file has no such table.
        sensors: noise of one sample.
        measures_length: whether the force is set and the length is measured (isotonic test).
        load: N, the set force of an isotonic recording without a force column.
        baseline: "inelastic" or "elastic", the baseline model.
        columns: header of recording.csv for each channel.
        specimen: origin of the recording; no computation on one recording uses it.
    """

    name: str
    rest_length: MeasuredValue
    thread_length: MeasuredValue | None = None
    turns: MeasuredValue | None = None
    braid_angle: MeasuredValue | None = None
    diameter: MeasuredValue | None = None
    threads: int | None = None
    thread_area: MeasuredValue | None = None
    length: float | None = None
    fitting_diameter: MeasuredValue | None = None
    modulus: MeasuredValue | None = None
    stiffness: MeasuredValue | None = None
    bladder: Bladder | None = None
    sensors: Sensors = field(default_factory=Sensors)
    measures_length: bool = False
    load: float | None = None
    baseline: str = "inelastic"
    columns: dict[str, str] = field(default_factory=dict)
    specimen: Specimen = field(default_factory=Specimen)

    @property
    def braid(self) -> tuple[float, float]:
        """Return thread length (m) and turns, from either form of the braid.

        From the triangle of one unrolled thread: sin θ = L / B, cos θ = π D N / B.
        """
        if self.thread_length is not None and self.turns is not None:
            return self.thread_length.value, self.turns.value
        assert self.braid_angle is not None
        assert self.diameter is not None
        thread_length = self.rest_length.value / math.sin(self.braid_angle.value)
        return thread_length, thread_length * math.cos(self.braid_angle.value) / (
            math.pi * self.diameter.value
        )

    def compute_braid_diameter(self, length: np.ndarray | float) -> np.ndarray:
        """Return the diameter of the braid with inextensible threads, √(B² − L²) / (π N), at a length L, m.

        It is zero beyond the thread length B.
        """
        thread, turns = self.braid
        return np.sqrt(np.maximum(thread**2 - length**2, 0.0)) / (math.pi * turns)


def read_muscle_toml(raw: bytes, file: str = "muscle.toml") -> MuscleToml:
    """Return the contents of a muscle.toml from its bytes.

    Raises:
        BadInput: with table and key, if it is not TOML or has an impossible value.
    """
    return parse_muscle_toml(read_document(raw, file), file)


def parse_muscle_toml(document: MuscleDocument | Mapping[str, Any], file: str = "muscle.toml") -> MuscleToml:
    """Return the contents of a document, checked for consistency.

    >>> braid = {"rest_length": "200 mm", "thread_length": "214 mm", "turns": 1.2}
    >>> parse_muscle_toml({"muscle": braid}).baseline
    'inelastic'
    """
    tables = document if isinstance(document, MuscleDocument) else MuscleDocument.from_mapping(document, file)
    muscle, thread = tables.muscle, tables.thread
    rest_length = _find_rest_length(muscle, file)
    _check_braid(muscle, rest_length, file)
    _check_stiffness(muscle, thread, file)
    _check_test(tables, file)
    elastic = thread.modulus is not None or thread.stiffness is not None
    sensors = tables.sensors
    return MuscleToml(
        name=muscle.name or "muscle",
        rest_length=rest_length,
        thread_length=muscle.thread_length,
        turns=muscle.turns,
        braid_angle=muscle.braid_angle,
        diameter=muscle.diameter,
        threads=muscle.threads,
        thread_area=muscle.thread_area,
        length=muscle.length.value if muscle.length else None,
        fitting_diameter=muscle.fitting_diameter,
        modulus=thread.modulus,
        stiffness=thread.stiffness,
        bladder=Bladder(**dict(tables.bladder)) if tables.bladder else None,
        sensors=Sensors(
            force=sensors.force.sd if sensors.force else None,
            diameter=sensors.diameter.sd if sensors.diameter else None,
            pressure=sensors.pressure.sd if sensors.pressure else None,
            length=sensors.length.sd if sensors.length else None,
            length_per_level=sensors.length is not None and sensors.length.per == "setting",
        ),
        measures_length=tables.test.measured == "length",
        load=tables.test.load,
        baseline=tables.baseline.model or ("elastic" if elastic else "inelastic"),
        columns=dict(tables.columns),
        specimen=Specimen(**dict(tables.specimen)),
    )


def describe_unused_bladder(muscle_toml: MuscleToml, mechanisms: Iterable[str]) -> list[str]:
    """Return a note if muscle.toml states a rubber tube and the model has no rubber; else an empty list.

    Args:
        muscle_toml: contents of muscle.toml.
        mechanisms: mechanisms of the model.
    """
    if muscle_toml.bladder is None or "bladder_elasticity" in mechanisms:
        return []
    return [
        "The model has no rubber, so [bladder] is not used."
        " `pamjax fit --with bladder_elasticity` adds rubber."
    ]


def _find_rest_length(muscle: MuscleTable, file: str) -> MeasuredValue:
    length = muscle.rest_length or muscle.length
    if length is None:
        remedy = 'Write the length between the fittings at rest: rest_length = "235 mm".'
        raise BadInput.from_rule("[muscle] must state `rest_length`", "none", file, remedy)
    return length


def _check_braid(muscle: MuscleTable, rest_length: MeasuredValue, file: str) -> None:
    """Refuse a braid that is incomplete, stated twice, or shorter than the muscle."""
    turns_form = {"thread_length": muscle.thread_length, "turns": muscle.turns}
    angle_form = {"braid_angle": muscle.braid_angle, "diameter": muscle.diameter}
    stated_names = [name for name, value in (turns_form | angle_form).items() if value is not None]
    if stated_names not in (list(turns_form), list(angle_form)):
        raise _build_braid_error(stated_names, file)
    thread = muscle.thread_length
    if thread is not None and rest_length.value >= thread.value:
        rule = f"`rest_length` must be shorter than the thread ({format_quantity(thread.value, 'mm')})"
        remedy = "`thread_length` is measured along one thread, from fitting to fitting."
        raise BadInput.from_rule(
            rule, format_quantity(rest_length.value, "mm"), f"[muscle] of {file}", remedy
        )


def _build_braid_error(stated_names: list[str], file: str) -> BadInput:
    rule = "[muscle] must state the braid as `thread_length` and `turns`, or as `braid_angle` and `diameter`"
    got = " and ".join(f"`{name}`" for name in stated_names) or "neither"
    remedy = (
        "Remove one pair; the other one is sufficient." if len(stated_names) > 2 else "Add the missing entry."
    )
    if len(stated_names) == 2:
        remedy = "Complete one pair and remove the other."
    return BadInput.from_rule(rule, got, file, remedy)


def _check_test(tables: MuscleDocument, file: str) -> None:
    """Refuse entries that contradict the measured channel of the test."""
    test = tables.test
    if test.measured == "force":
        if test.load is not None:
            remedy = 'Write measured = "length" if a weight sets the force; otherwise remove `load`.'
            raise BadInput.from_rule(
                "`load` needs a measured length", 'measured = "force"', f"[test] of {file}", remedy
            )
        return
    if tables.muscle.length is not None:
        remedy = "Remove `length`, or remove [test]."
        raise BadInput.from_rule("a measured length cannot be fixed", "`length` in [muscle]", file, remedy)
    if tables.sensors.length and tables.sensors.length.per == "setting":
        remedy = 'Write the noise of one sample, as length = "0.1 mm".'
        rule = "a measured length has an error for each sample"
        raise BadInput.from_rule(rule, 'per = "setting"', f"[sensors] of {file}", remedy)


def _check_stiffness(muscle: MuscleTable, thread: ThreadTable, file: str) -> None:
    if thread.modulus is None:
        return
    if thread.stiffness is not None:
        remedy = "Remove one: the stiffness is threads x area x modulus."
        raise BadInput.from_rule("[thread] must state `modulus` or `stiffness`", "both", file, remedy)
    missing = [n for n in ("threads", "thread_area") if getattr(muscle, n) is None]
    if missing:
        rule = "`modulus` needs `threads` and `thread_area` in [muscle]"
        got = "no " + " and no ".join(f"`{name}`" for name in missing)
        remedy = 'Add them, or state the stiffness of all threads together: [thread] stiffness = "1.4 MN".'
        raise BadInput.from_rule(rule, got, file, remedy)

"""`pamjax simulate`: the recording a muscle and a protocol would make."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from pamjax.cli.options import Json, MechanismList
from pamjax.cli.screen import print_json, print_text


def simulate(
    muscle: Path,
    /,
    protocol: Path | None = None,
    *,
    out: Path,
    law: str | None = None,
    case: str | None = None,
    with_: MechanismList = None,
    before: Literal["relaxed", "settled"] = "relaxed",
    noise: bool = True,
    correlation_time: str = "0 s",
    seed: int = 0,
    json: Json = False,
) -> None:
    """Make the case folder that a bench would have written.

    Args:
        muscle: a case folder or muscle.toml (the muscle as stated), or a fit.json or model.json (as
            calibrated: leaving the calibrated pressures and lengths is warned of).
        protocol: a TOML file with a table [protocol]; the paper's ten isobars if left out.
        out: folder for the new case.
        law: thread law of a muscle as stated; its baseline if left out.
        case: which case of a fit.json or model.json with several.
        with_: numbers of mechanisms to add, as braid_friction.coefficient=0.2 or "force_offset.offset=5 N".
        before: whether the muscle was at rest before the first sample, or had been through the same once.
        noise: whether the sensors of muscle.toml add their noise.
        correlation_time: of the noise of force and diameter.
        seed: of the noise.
        json: print for programs.
    """
    from pamjax.cli.settings import parse_settings
    from pamjax.errors import check_minimum
    from pamjax.infer.fitting.load import load_muscle
    from pamjax.records.protocol import PAPER_PROTOCOL, read_protocol
    from pamjax.records.reading.muscle_toml import Sensors
    from pamjax.records.simulate import describe_extrapolation
    from pamjax.records.simulate import simulate as record
    from pamjax.records.writing.case_folder import write_case
    from pamjax.units import format_count, parse_quantity

    check_minimum("seed", seed, 0)
    loaded = load_muscle(muscle, law, case, parse_settings(with_ or ()))
    plan = read_protocol(protocol) if protocol else PAPER_PROTOCOL
    schedule = plan.build_schedule(loaded.entry.rest_length.value)
    warnings = (
        list(describe_extrapolation(loaded.calibrated_range, schedule)) if loaded.calibrated_range else []
    )
    if loaded.neglects_rubber:
        warnings.append(
            "the rubber of [bladder] takes no part; the model.json of a design or diagnosis has it"
        )
    for sentence in warnings:
        print(f"pamjax: warning: {sentence}", file=sys.stderr)
    sensors = loaded.entry.sensors if noise else Sensors()
    pause = parse_quantity(correlation_time, "time", "--correlation-time")
    recording = record(
        loaded.muscle,
        schedule,
        sensors,
        seed=seed,
        correlation_time=pause,
        settled=before == "settled",
    )
    write_case(out, recording, loaded.text)
    if json:
        channels = list(recording.channels)
        print_json({"case": str(out), "rows": recording.n, "channels": channels, "warnings": warnings})
        return
    print_text(f"wrote {out}/: {format_count(recording.n, 'row')} of {' and '.join(recording.channels)}")

"""`pamjax simulate`: simulate the recording of a muscle under a protocol."""

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
    """Simulate a recording of a muscle and write it as a case folder.

    Args:
        muscle: a case folder or muscle.toml with stated values, or a fit.json or model.json of a fitted
            muscle. The command warns about pressures and lengths outside the calibrated range. Form errors
            in the file are part of the simulated force and diameter.
        protocol: TOML file with a table [protocol]; by default ten isobars as in Chambers & Wereley (2022).
        out: case folder to write; it must be empty or not exist yet.
        law: thread law of a muscle with stated values; by default that of its baseline model.
        case: name of the case, if a fit.json or model.json has several.
        with_: parameters of mechanisms to add, such as braid_friction.coefficient=0.2 or
            "force_offset.offset=5 N".
        before: state before the first sample: relaxed (at rest), or settled (the protocol has run once
            before).
        noise: add the noise of the sensors in muscle.toml.
        correlation_time: correlation time of the noise of force and diameter.
        seed: random seed for the noise.
        json: print one JSON document.
    """
    from pamjax.cli.name_value_options import parse_parameter_values
    from pamjax.errors import check_minimum
    from pamjax.infer.fitting.load import load_muscle
    from pamjax.infer.form_errors.schedule_form import predict_schedule_form
    from pamjax.records.protocol import PAPER_PROTOCOL, read_protocol
    from pamjax.records.reading.muscle_toml import Sensors
    from pamjax.records.simulate import check_set_channel, describe_extrapolation
    from pamjax.records.simulate import simulate as simulate_recording
    from pamjax.records.writing.case_folder import write_case
    from pamjax.units import format_count, parse_quantity

    check_minimum("seed", seed, 0)
    loaded_muscle = load_muscle(muscle, law, case, parse_parameter_values(with_ or ()))
    plan = read_protocol(protocol) if protocol else PAPER_PROTOCOL
    schedule = plan.build_schedule(loaded_muscle.muscle_toml.rest_length.value)
    check_set_channel(schedule, loaded_muscle.muscle_toml)
    warnings = (
        list(describe_extrapolation(loaded_muscle.calibrated_range, schedule))
        if loaded_muscle.calibrated_range
        else []
    )
    if loaded_muscle.neglects_rubber:
        warnings.append(
            "the rubber of [bladder] is neglected; use the model.json of a design or diagnosis to include it"
        )
    form_errors = loaded_muscle.form_errors
    if form_errors is not None and schedule.load is not None:
        warnings.append(
            "the form errors of the model are neglected, because they are no errors of the length"
        )
        form_errors = None
    for sentence in warnings:
        print(f"pamjax: warning: {sentence}", file=sys.stderr)
    sensors = loaded_muscle.muscle_toml.sensors if noise else Sensors()
    noise_time = parse_quantity(correlation_time, "time", "--correlation-time")
    recording = simulate_recording(
        loaded_muscle.muscle if form_errors is None else form_errors.muscle,
        schedule,
        sensors,
        seed=seed,
        correlation_time=noise_time,
        settled=before == "settled",
        deviation=None
        if form_errors is None
        else predict_schedule_form(form_errors, schedule, before == "settled"),
    )
    write_case(out, recording, loaded_muscle.text)
    if json:
        channels = list(recording.channels)
        print_json({"case": str(out), "rows": recording.n, "channels": channels, "warnings": warnings})
        return
    print_text(f"wrote {out}/: {format_count(recording.n, 'row')} of {' and '.join(recording.channels)}")

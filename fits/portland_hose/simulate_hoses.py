"""Two simulated hoses, for tests: the recordings of the bench cannot be shipped, these can.

python fits/portland_hose/simulate_hoses.py FOLDER

writes `hose-10mm-132` and `hose-10mm-281` into FOLDER; `simulated/` contains its output. The hoses have
the stated size of the real ones, one rubber wall (`WALL`) and threads that do not stretch. Each is filled
and vented three times at four lengths. A slack hose shows the zero of the load cell. The noise has a
fixed seed and the lengths are exact. Relaxation, friction and soft threads are absent.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from pamjax.model.assembly import assemble_bench
from pamjax.records.protocol import Protocol
from pamjax.records.reading.muscle_toml import read_muscle_toml
from pamjax.records.recording import Recording
from pamjax.records.simulate import simulate
from pamjax.records.writing.case_folder import write_case

#: The true wall: shear modulus, Pa; Mooney share; bore and thickness, m.
WALL = {"modulus": 1.5e6, "mooney": 0.4, "inner_diameter": 8.2e-3, "thickness": 1.8e-3}

#: Length at rest, mm, and seed of each hose.
HOSES = {"hose-10mm-132": (132, 1), "hose-10mm-281": (281, 2)}

PROTOCOL = Protocol(
    kind="ramps",
    pressures=["620 kPa"],
    contractions=[0.0, 0.04, 0.08, 0.12],
    cycles=3,
    duration="12 s",
    rate="2 Hz",
    diameter_every=0,
)

MUSCLE = """\
[muscle]
name = "simulated hose, 10 mm, {length} mm long"
rest_length = {{value = "{length} mm", sd = "1 mm"}}
diameter = {{value = "11.8 mm", sd = "0.9 mm"}}
braid_angle = {{value = "61.4 deg", sd = "1 deg"}}

[bladder]
inner_diameter = "10 mm"
thickness = "1.8 mm"

[sensors]
force = "0.7 N"
pressure = "0.5 kPa"
length = {{sd = "1 mm", per = "setting"}}

[baseline]
model = "inelastic"
"""


def simulate_hose(name: str) -> tuple[Recording, str]:
    """Return the recording of one hose and the text of its muscle.toml."""
    length, seed = HOSES[name]
    text = MUSCLE.format(length=length)
    muscle_toml = read_muscle_toml(text.encode())
    assert muscle_toml.diameter is not None
    assert muscle_toml.braid_angle is not None
    numbers = {
        "muscle.rest_length": muscle_toml.rest_length.value,
        "muscle.diameter": muscle_toml.diameter.value,
        "muscle.braid_angle": muscle_toml.braid_angle.value,
        "bladder_elasticity.length": muscle_toml.rest_length.value,
    } | {f"bladder_elasticity.{field}": value for field, value in WALL.items()}
    bench = assemble_bench("inelastic", ("bladder_elasticity",), numbers)
    schedule = PROTOCOL.build_schedule(muscle_toml.rest_length.value)
    first = np.r_[True, np.diff(schedule.cycle) != 0]
    schedule = replace(schedule, cycle=np.cumsum(first))
    recording = simulate(bench, schedule, replace(muscle_toml.sensors, force=None), seed=seed)
    noise = np.random.default_rng(100 + seed).standard_normal(recording.n)
    force = np.nan_to_num(recording.force) + muscle_toml.sensors.force * noise
    return replace(recording, force=force, length=schedule.length), text


def main(arguments: list[str] | None = None) -> None:
    style = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=style)
    parser.add_argument("folder", type=Path, help="folder for the two cases")
    folder = parser.parse_args(arguments).folder
    folder.mkdir(parents=True, exist_ok=True)
    for name in HOSES:
        write_case(folder / name, *simulate_hose(name))


if __name__ == "__main__":
    main()

"""An example of a fleet: simulated recordings of six muscles on each of two rigs.

The pressure gauge of the second rig reads too high, and no muscle.toml states it. One recording does not
distinguish this error from a mechanism of the muscle. The fleet does, because only one rig has the error.
"""

from __future__ import annotations

from pathlib import Path

import jax.numpy as jnp
import numpy as np

from pamjax.errors import BadInput
from pamjax.model.assembly import assemble_bench
from pamjax.records.files import write_folder_atomically
from pamjax.records.protocol import Protocol
from pamjax.records.reading.muscle_toml import read_muscle_toml
from pamjax.records.simulate import simulate
from pamjax.records.writing.case_folder import write_case
from pamjax.records.writing.template import MUSCLE_TEMPLATE

#: Specimens of each rig, and the error of the gauge of each rig, Pa.
SPECIMENS_PER_RIG = 6
GAUGE_ERRORS = {"north": 0.0, "south": 12e3}

#: True parameters of the specimens, SI: those that are equal, and mean and standard deviation of the others.
_COMMON = {"muscle.rest_length": 0.2, "muscle.threads": 120.0, "muscle.thread_area": 0.07e-6}
_MANUFACTURE = {
    "muscle.thread_length": (0.214, 4e-4),
    "muscle.turns": (1.2, 4e-3),
    "thread.modulus": (70e9, 2e9),
}

_PROTOCOL = Protocol(
    kind="strokes",
    pressures=["100 kPa", "250 kPa", "400 kPa", "550 kPa"],
    contractions=[0.2],
    speed="1.57 mm/s",
    cycles=1,
)

_FLEET_TEMPLATE = """\
# SIMULATED RECORDINGS of six muscles on each of two rigs: replace them with your case folders.
# Run:  pamjax fleet FLEET.toml --out store
name = "example fleet"
stages = ["check", "fit", "diagnose"]

# What the recordings of one rig have in common. `cases` is a pattern, relative to this file.
[[groups]]
cases = "north/*"
bench = "north"
date = 2026-03-02

[[groups]]
cases = "south/*"
bench = "south"
date = 2026-03-09
"""


def write_example_fleet(folder: str | Path) -> Path:
    """Write a fleet of simulated recordings, and return the path of its FLEET.toml.

    Args:
        folder: a folder that does not exist, or is empty.

    Raises:
        BadInput: if the folder is a file, or has files.
    """
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadInput.from_rule(
            "a new fleet needs an empty folder", f"{folder}, which exists", remedy="Choose another folder."
        )
    random = np.random.default_rng(0)
    with write_folder_atomically(folder) as temporary:
        for rig, gauge_error in GAUGE_ERRORS.items():
            for k in range(SPECIMENS_PER_RIG):
                parameters = _draw_specimen(random) | {"pressure_offset.offset": gauge_error}
                _write_specimen(
                    temporary / rig / f"specimen-{k + 1}", parameters, int(random.integers(2**31))
                )
        (temporary / "FLEET.toml").write_text(_FLEET_TEMPLATE, encoding="utf-8", newline="\n")
    return folder / "FLEET.toml"


def _draw_specimen(random: np.random.Generator) -> dict[str, float]:
    """Return the parameters of a specimen, SI."""
    return _COMMON | {name: random.normal(mean, sd) for name, (mean, sd) in _MANUFACTURE.items()}


def _write_specimen(folder: Path, parameters: dict[str, float], seed: int) -> None:
    """Write the simulated recording of a specimen, with the stated values of the template."""
    numbers = {name: jnp.asarray(value) for name, value in parameters.items()}
    bench = assemble_bench("elastic", ("pressure_offset",), numbers)
    schedule = _PROTOCOL.build_schedule(parameters["muscle.rest_length"])
    sensors = read_muscle_toml(MUSCLE_TEMPLATE.encode()).sensors
    folder.parent.mkdir(exist_ok=True)
    write_case(folder, simulate(bench, schedule, sensors, seed=seed), MUSCLE_TEMPLATE)

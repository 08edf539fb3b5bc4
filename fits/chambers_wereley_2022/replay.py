"""The paper's story, told to a diagnosis that does not know it.

python fits/chambers_wereley_2022/replay.py --out out/replay

table     Table 1 alone and threads that do not stretch: what is missing?
protocol  ten isobars of the paper's muscle, simulated with threads that are soft until they are straight,
          and a model of threads that are equally stiff at every load: what is missing now?

The second is a simulation with pamjax's own equations, since the paper's forces were never tabulated; its
sensors are as good as Table 1 (0.02 mm), its toe as large as the two moduli of the paper ask for.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import numpy as np

from pamjax.compile.jax_cache import keep_compiled
from pamjax.diagnosis.library.library_problem import problem
from pamjax.diagnosis.result import Diagnosis, save
from pamjax.diagnosis.run import diagnose
from pamjax.records.case import Case, read_case
from pamjax.records.protocol import Protocol
from pamjax.records.reading.muscle_toml import Sensors
from pamjax.records.recording import Recording

HERE = Path(__file__).parent

#: Sensors of the simulated bench: N, m, Pa, m.
SENSORS = Sensors(force=2.0, diameter=0.02e-3, pressure=200.0, length=0.01e-3)

#: The concealed toe: straight threads of 112 GPa, and a crimp of 0.15 % that is out at 1.5 kN in all.
TOE = {"thread.modulus": 112e9, "thread_crimp.crimp": 1.5e-3, "thread_crimp.load": 1500.0}


def table() -> Case:
    """Table 1 with a model of inextensible threads."""
    case = read_case(HERE)
    return dataclasses.replace(
        case, name="table-1", entry=dataclasses.replace(case.entry, baseline="inelastic")
    )


def protocol(seed: int = 0) -> Case:
    """The paper's muscle on ten isobars, twice each, with a concealed toe."""
    entry = dataclasses.replace(read_case(HERE).entry, sensors=SENSORS, baseline="elastic")
    plan = Protocol(
        kind="strokes",
        pressures=[f"{10 * k} psi" for k in range(1, 11)],
        contractions=np.linspace(0.12, 0.3, 10).round(3).tolist(),
        cycles=2,
        speed="1 mm/s",
        rate="0.45 Hz",
        diameter_every=1,
    ).schedule(entry.rest_length.value)
    asked = Recording.from_arrays(
        time=plan.time, pressure=plan.pressure, length=plan.length, cycle=plan.cycle,
        force=np.full(plan.time.size, 1e3), diameter=np.full(plan.time.size, 1.0),
    )  # fmt: skip
    bench = problem(Case("true", HERE, entry, asked, "simulated"))
    values = bench.neutral.copy()
    for name, value in TOE.items():
        values[bench.place(name)] = value
    force, diameter = bench.shows(values)
    rng = np.random.default_rng(seed)
    noise = {name: getattr(SENSORS, name) * rng.standard_normal(plan.time.size)
             for name in ("force", "diameter", "pressure", "length")}  # fmt: skip
    recording = Recording.from_arrays(
        time=plan.time, cycle=plan.cycle,
        pressure=plan.pressure + noise["pressure"], length=plan.length + noise["length"],
        force=np.where(force > 0, force + noise["force"], np.nan), diameter=diameter + noise["diameter"],
    )  # fmt: skip
    return Case("ten-isobars", HERE, entry, recording, "simulated")


def told(case: Case, out: Path) -> Diagnosis:
    """One act: diagnosed, saved and printed."""
    found = diagnose(case)
    save(found, out / case.name)
    print(found, end="\n\n", flush=True)
    return found


def main(arguments: list[str] | None = None) -> None:
    style = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=style)
    parser.add_argument("--out", type=Path, default=Path("out/replay"), help="folder for the diagnoses")
    parser.add_argument("--act", choices=("table", "protocol"), help="one act alone")
    asked = parser.parse_args(arguments)
    keep_compiled()
    if asked.act != "protocol":
        told(table(), asked.out)
    if asked.act != "table":
        told(protocol(), asked.out)


if __name__ == "__main__":
    main()

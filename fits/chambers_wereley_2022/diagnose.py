"""Two diagnoses of the article's muscle: its Table 1, and a simulation with threads that stiffen.

python fits/chambers_wereley_2022/diagnose.py --out out/chambers_wereley_2022

table     Table 1, with inelastic threads as baseline
isobars   ten isobars of the same muscle with soft threads (`thread_crimp`), with linear elastic threads as
          baseline

The second recording is simulated with pamjax's own equations, since the article does not tabulate its
forces. Its diameter sensor is as accurate as Table 1 (0.02 mm). Its crimp has the size that the two moduli
of the article imply.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import numpy as np

from pamjax.compile.jax_cache import keep_compiled
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.result import save_diagnosis
from pamjax.diagnosis.run import diagnose
from pamjax.records.case import Case, read_case
from pamjax.records.protocol import Protocol
from pamjax.records.reading.muscle_toml import Sensors
from pamjax.records.recording import Recording

HERE = Path(__file__).parent

#: Sensors of the simulated bench: N, m, Pa, m.
SENSORS = Sensors(force=2.0, diameter=0.02e-3, pressure=200.0, length=0.01e-3)

#: The simulated threads: 112 GPa when straight, and a crimp of 0.15 % that is straight at 1.5 kN in all.
CRIMP = {"thread.modulus": 112e9, "thread_crimp.crimp": 1.5e-3, "thread_crimp.load": 1500.0}


def read_table() -> Case:
    """Return Table 1 with inelastic threads as baseline."""
    case = read_case(HERE)
    muscle_toml = dataclasses.replace(case.muscle_toml, baseline="inelastic")
    return dataclasses.replace(case, name="table-1", muscle_toml=muscle_toml)


def simulate_isobars(seed: int = 0) -> Case:
    """Return ten simulated isobars of the article's muscle, two strokes each, with crimped threads."""
    muscle_toml = dataclasses.replace(read_case(HERE).muscle_toml, sensors=SENSORS, baseline="elastic")
    plan = Protocol(
        kind="strokes",
        pressures=[f"{10 * k} psi" for k in range(1, 11)],
        contractions=np.linspace(0.12, 0.3, 10).round(3).tolist(),
        cycles=2,
        speed="1 mm/s",
        rate="0.45 Hz",
        diameter_every=1,
    ).build_schedule(muscle_toml.rest_length.value)
    # The model is evaluated at rows that have a measurement; these placeholders stand for them.
    rows = Recording.from_arrays(
        time=plan.time, pressure=plan.pressure, length=plan.length, cycle=plan.cycle,
        force=np.full(plan.time.size, 1e3), diameter=np.full(plan.time.size, 1.0),
    )  # fmt: skip
    bench = build_library_problem(Case("true", HERE, muscle_toml, rows, "simulated"))
    values = bench.neutral.copy()
    for name, value in CRIMP.items():
        values[bench.index(name)] = value
    force, diameter = bench.predict(values)
    rng = np.random.default_rng(seed)
    noise = {name: getattr(SENSORS, name) * rng.standard_normal(plan.time.size)
             for name in ("force", "diameter", "pressure", "length")}  # fmt: skip
    recording = Recording.from_arrays(
        time=plan.time, cycle=plan.cycle,
        pressure=plan.pressure + noise["pressure"], length=plan.length + noise["length"],
        force=np.where(force > 0, force + noise["force"], np.nan), diameter=diameter + noise["diameter"],
    )  # fmt: skip
    return Case("ten-isobars", HERE, muscle_toml, recording, "simulated")


#: The recordings, by their name on the command line.
CASES = {"table": read_table, "isobars": simulate_isobars}


def diagnose_case(case: Case, out: Path) -> None:
    """Diagnose a case, save the diagnosis and print it."""
    diagnosis = diagnose(case)
    save_diagnosis(diagnosis, out / case.name)
    print(diagnosis, end="\n\n", flush=True)


def main(arguments: list[str] | None = None) -> None:
    style = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=style)
    default = Path("out/chambers_wereley_2022")
    parser.add_argument("--out", type=Path, default=default, help="folder for the diagnoses")
    parser.add_argument("--only", choices=tuple(CASES), help="diagnose one recording alone")
    options = parser.parse_args(arguments)
    keep_compiled()
    for name, make in CASES.items():
        if options.only in (None, name):
            diagnose_case(make(), options.out)


if __name__ == "__main__":
    main()

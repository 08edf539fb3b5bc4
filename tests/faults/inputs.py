"""Kinds of input files for the mutation test: valid examples, and the reader of each kind."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pamjax.fleet.plan import read_plan
from pamjax.infer.posterior.priors_file import read_priors
from pamjax.planning.rig_capabilities import read_capabilities
from pamjax.records.blocks import find_blocks
from pamjax.records.case import read_case
from pamjax.records.files import read_bytes
from pamjax.records.importing.importer import import_case
from pamjax.records.protocol import read_protocol
from pamjax.records.reading.muscle_toml import read_muscle_toml
from pamjax.records.writing.template import write_template
from pamjax.sizing.specification.spec import read_spec
from tests.faults.edits import mutate_csv, mutate_toml

ROOT = Path(__file__).resolve().parents[2]

MUSCLE = """\
[muscle]
name = "test muscle"
rest_length = {value = "200 mm", sd = "0.2 mm"}
thread_length = {value = "214 mm", sd = "0.5 mm"}
turns = {value = 1.2, sd = 0.005}
threads = 40
thread_area = "0.05 mm^2"
fitting_diameter = "18 mm"

[thread]
modulus = {value = "70 GPa", sd = "15 GPa"}

[bladder]
inner_diameter = "12 mm"
thickness = {value = "1.5 mm", sd = "0.1 mm"}
modulus = {value = "1 MPa", sd = "0.3 MPa"}

[sensors]
force = "2.5 N"
diameter = "0.05 mm"
pressure = "0.5 kPa"
length = {sd = "0.1 mm", per = "setting"}

[test]
measured = "force"

[baseline]
model = "elastic"

[specimen]
bench = "north"
serial = "A-0012"
date = 2026-03-02
type = "22 mm"
"""
#: A muscle whose braid is stated by its angle.
BRAID_ANGLE_MUSCLE = """\
[muscle]
rest_length = "9.89 in"
braid_angle = {value = "72 deg", sd = "0.3 deg"}
diameter = {value = "0.875 in", sd = "0.1 mm"}

[thread]
stiffness = {value = "180 kN", sd = "60 kN"}

[test]
measured = "length"
load = "20 N"
"""
PROTOCOLS = (
    """\
[protocol]
kind = "strokes"
pressures = ["100 kPa", "3 bar"]
contractions = [0.2, 0.1]
speed = "1 mm/s"
cycles = 2
rate = "1 Hz"
diameter_every = 3
""",
    """\
[protocol]
kind = "ramps"
pressures = ["87 psi"]
loads = ["0 N", "2 kgf"]
duration = "10 s"
cycles = 1
""",
    """\
[protocol]
kind = "holds"
pressures = ["1 bar", "2 bar"]
contractions = [0.0, 0.1, 0.2]
duration = "5 s"
""",
)
IMPORTS = (
    """\
muscle = "muscle.toml"
gap = "1 s"
median = "0.5 s"

[files]
separator = ","
decimal = "."
header = true
skip = 0

[columns]
time = "t [s]"
force = {column = "Load [lbf]", zero = 0.1, scale = 1.0}
pressure = {column = 2, unit = "kPa"}

[tare]
start = "0 s"
end = "0.2 s"
force = "0 N"
cut = true

[[tests]]
file = "run_*.csv"
length = "200 mm"

[[tests]]
file = ["run_1.csv", "run_2.csv"]
length = "190 mm"
""",
    """\
muscle = "muscle.toml"

[files]
rate = "5 Hz"

[columns]
force = {column = 3, unit = "N", scale = 4.45}
pressure = {column = 2, unit = "kPa"}

[[tests]]
file = {force = "run_1.csv", pressure = "run_2.csv"}
length = "190 mm"
""",
)
RUN = "t [s],P [kPa],Load [lbf]\n" + "".join(
    f"{0.1 * k:.1f},{100 + 10 * k},{0.1 if k < 4 else 90 + 9 * k}\n" for k in range(20)
)
FLEET = """\
name = "pilot series"
folder = "recordings"
cases = ["north/*", "south/*"]
stages = ["check", "fit", "diagnose", "validate"]
seed = 3
figures = true
report = false

[fit]
law = "elastic"
mechanisms = ["braid_friction"]
loss = "square"
starts = 2
folds = 3

[sample]
sampler = "emcee"
ess = 200
rhat = 1.02
max_draws = 5000

[validate]
model = "model.json"
case = "north/a"

[[groups]]
cases = "north/*"
bench = "north"
date = 2026-03-02

[[groups]]
cases = ["south/*"]
bench = "south"
serial = "A-1"
type = "22 mm"
date = "2026-03-09"
"""
RIG = """\
[rig]
pressure = "690 kPa"
contraction = "30 %"
speed = "1 mm/s"
rate = "1 Hz"
minutes = 60
setup = "1 min"
correlation_time = "0.5 s"
force = "2 N"
diameter = "0.1 mm"
gauge = "1 kPa"
ruler = "0.05 mm"
force_zero = "5 N"
force_gain = 0.01
pressure_zero = "3 kPa"
give = "0.05 mm/kN"
"""
PRIORS = """\
["thread.modulus"]
value = "90 GPa"
sd = "10 GPa"
low = "50 GPa"

["muscle.turns"]
value = 1.2
sd = 0.01

["noise.force"]
high = "9 N"
"""


@dataclass(frozen=True)
class InputKind:
    """A kind of input, which is a folder of files.

    Attributes:
        name: its name in the table of results.
        build_examples: returns valid examples; each is the text of every file by its name, and the first
            file is the one that most mutations change.
        read: reads a folder as the command does; raises `BadInput` for a refused one.
    """

    name: str
    build_examples: Callable[[], tuple[dict[str, str], ...]]
    read: Callable[[Path], object]


def write_example(example: dict[str, str], folder: Path) -> None:
    """Write the files of an example to a folder."""
    for name, text in example.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, "utf-8")


def write_mutation(kind: InputKind, folder: Path, random: np.random.Generator) -> None:
    """Write an example of a kind with one mutated file, or with another object in place of a file."""
    examples = kind.build_examples()
    example = examples[random.integers(len(examples))]
    write_example(example, folder)
    names = list(example)
    name = names[0] if random.random() < 0.6 else names[random.integers(len(names))]
    if random.random() < 0.02:
        replace_file(folder / name, int(random.integers(7)))
        return
    is_table = name.endswith(".csv")
    # Lines of other kinds of files are what a user copies to the wrong file.
    mutated = mutate_csv(example[name], random) if is_table else mutate_toml(example[name], random, DONORS)
    (folder / name).write_bytes(mutated)


def replace_file(file: Path, kind: int) -> None:
    """Replace a file: by none, a folder, a link to nothing, itself or a device, a pipe, or an empty file."""
    file.unlink()
    if kind == 1:
        file.mkdir()
    elif kind == 2:
        file.symlink_to("nowhere")
    elif kind == 3:
        file.symlink_to(file.name)
    elif kind == 4:
        file.symlink_to("/dev/zero")
    elif kind == 5:
        os.mkfifo(file)
    elif kind == 6:
        file.write_bytes(b"")


@cache
def build_cases() -> tuple[dict[str, str], ...]:
    """Return two measured cases and one of `MUSCLE`; a long table keeps its first rows."""
    examples = [{"recording.csv": _build_table(), "muscle.toml": MUSCLE}]
    for folder in ("fits/chambers_wereley_2022", "fits/petre_2021/zero-load"):
        texts = {name: (ROOT / folder / name).read_text("utf-8") for name in ("recording.csv", "muscle.toml")}
        texts["recording.csv"] = "\n".join(texts["recording.csv"].split("\n")[:200]) + "\n"
        examples.append(texts)
    return tuple(examples)


def _build_table() -> str:
    """Return a table of three isobars of the muscle in `MUSCLE`."""
    rows = ["time [s],pressure [kPa],length [mm],force [N],diameter [mm],cycle"]
    for k in range(60):
        pressure, length = 100.0 * (1 + k // 20), 200.0 - 1.5 * (10 - abs(k % 20 - 10))
        force = 1e-3 * pressure * (3 * length**2 - 214.0**2) / (4 * np.pi * 1.44)
        diameter = np.sqrt(214.0**2 - length**2) / (1.2 * np.pi)
        rows.append(f"{k},{pressure:g},{length:.3f},{force:.2f},{diameter:.3f},1")
    return "\n".join(rows) + "\n"


@cache
def build_muscles() -> tuple[dict[str, str], ...]:
    """Return the muscle.toml of `pamjax new` and those above."""
    with TemporaryDirectory() as folder:
        write_template(Path(folder) / "new")
        template = (Path(folder) / "new" / "muscle.toml").read_text("utf-8")
    return tuple({"muscle.toml": text} for text in (template, MUSCLE, BRAID_ANGLE_MUSCLE))


def build_imports() -> tuple[dict[str, str], ...]:
    """Return the imports above with their files."""
    files = {"run_1.csv": RUN, "run_2.csv": RUN, "muscle.toml": MUSCLE}
    return tuple({"rig.toml": text, **files} for text in IMPORTS)


def build_fleets() -> tuple[dict[str, str], ...]:
    """Return the fleet above with three cases."""
    cases = {f"recordings/{name}/muscle.toml": MUSCLE for name in ("north/a", "north/b", "south/c")}
    tables = {name.replace("muscle.toml", "recording.csv"): "pressure [kPa]\n" for name in cases}
    return ({"fleet.toml": FLEET, "model.json": "{}", **cases, **tables},)


def build_specifications() -> tuple[dict[str, str], ...]:
    """Return the specifications of `fits/sizing`."""
    files = sorted((ROOT / "fits" / "sizing").glob("*.toml"))
    return tuple({"spec.toml": file.read_text("utf-8")} for file in files)


def _read_case(folder: Path) -> object:
    case = read_case(folder)
    return str(case), find_blocks(case.recording)


def _read_muscle(folder: Path) -> object:
    return read_muscle_toml(read_bytes(folder / "muscle.toml"))


def _read_protocol(folder: Path) -> object:
    return read_protocol(folder / "protocol.toml").build_schedule(0.2)


def _read_rig(folder: Path) -> object:
    return read_capabilities(read_muscle_toml(MUSCLE.encode()), folder / "rig.toml")


def _read_import(folder: Path) -> object:
    # The case is written to a folder beside, because an import only accepts a new one.
    out = folder.with_name("imported")
    shutil.rmtree(out, ignore_errors=True)
    return str(import_case(folder / "rig.toml", out))


DONORS = (MUSCLE, *PROTOCOLS, *IMPORTS, FLEET, RIG, PRIORS)
KINDS = {
    kind.name: kind
    for kind in (
        InputKind("case folder", build_cases, _read_case),
        InputKind("muscle.toml", build_muscles, _read_muscle),
        InputKind("protocol", lambda: tuple({"protocol.toml": text} for text in PROTOCOLS), _read_protocol),
        InputKind("import", build_imports, _read_import),
        InputKind("fleet", build_fleets, lambda folder: read_plan([folder / "fleet.toml"])),
        InputKind("sizing", build_specifications, lambda folder: read_spec(folder / "spec.toml")),
        InputKind("rig", lambda: ({"rig.toml": RIG},), _read_rig),
        InputKind(
            "priors", lambda: ({"priors.toml": PRIORS},), lambda folder: read_priors(folder / "priors.toml")
        ),
    )
}

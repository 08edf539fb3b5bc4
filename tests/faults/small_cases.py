"""Small case folders, on which each command takes a few seconds once its programs are compiled."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.main import main as run_command

PROTOCOL = """\
[protocol]
kind = "strokes"
pressures = ["100 kPa", "450 kPa"]
contractions = [0.2]
speed = "3 mm/s"
cycles = 1
"""


def write_simulated_case(folder: Path, seed: int = 3) -> Path:
    """Write a simulated case of two isobars with 58 rows, and return its folder.

    Args:
        folder: an empty folder; it also gets the muscle and the protocol of the simulation.
        seed: seed of the noise.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "protocol.toml").write_text(PROTOCOL)
    _run("new", folder / "stated")
    made = folder / "made"
    _run("simulate", folder / "stated", folder / "protocol.toml", "--out", made, "--seed", seed)
    return made


def write_template_cases(folder: Path, names: str = "abc") -> None:
    """Write cases of the template, which differ in the last force."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, name in enumerate(names):
        _run("new", folder / name)
        file = folder / name / "recording.csv"
        *rows, last = file.read_text().splitlines()
        time, pressure, length, force, *others = last.split(",")
        cells = [time, pressure, length, f"{float(force) + 2 * k}", *others]
        file.write_text("\n".join([*rows, ",".join(cells), ""]))


def _run(*words: object) -> None:
    if run_command([str(word) for word in words]):
        raise SystemExit(f"pamjax {words[0]} failed")

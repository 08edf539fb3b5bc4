"""Size three muscles that exist from their own forces, and compare the dimensions.

python fits/sizing/real_muscles.py

prints the table of the README. Each muscle is sized twice: with the braid angle, the rubber and the wall of
the real muscle, to test the model; and freely, with parts that are sold and a probability of 0.9.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

import pamjax
from pamjax.records.shipped_tables import convert_to_si, read_quantities, read_shipped

#: Wall of the factory hoses, m, and angle of their threads, deg: Martens & Boblan 2017.
FACTORY_WALL, FACTORY_ANGLE = 1.8e-3, 90 - 28.6


@dataclass(frozen=True)
class RealMuscle:
    """A muscle that exists, SI.

    Attributes:
        name: name.
        rest_length, diameter, wall: m; the diameter is that of the braid at rest.
        angle: braid angle at rest, deg.
        pressure: Pa; forces: (contraction, force in N) at this pressure.
        rubber: kind of rubber.
        threads: number of threads, None if it is unknown.
        origin: source of the forces.
    """

    name: str
    rest_length: float
    diameter: float
    wall: float
    angle: float
    pressure: float
    forces: tuple[tuple[float, float], ...]
    rubber: str
    threads: int | None
    origin: str


def list_muscles() -> list[RealMuscle]:
    """Return the two factory muscles and the muscle of the paper."""
    return [
        _read_factory_muscle("dmsp-10-250", 10e-3, 0.25),
        _read_factory_muscle("dmsp-20-300", 20e-3, 0.296),
        _read_paper_muscle(),
    ]


def _read_factory_muscle(name: str, bore: float, rest_length: float) -> RealMuscle:
    table = convert_to_si(read_shipped(f"martens_boblan_2017/{name}"))
    pressures, lengths, measured = (table[name].to_numpy(float) for name in ("pressure", "length", "force"))
    pressure = pressures[np.argmin(np.abs(pressures - 600e3))]
    rows = np.flatnonzero((pressures == pressure) & (measured > 0))
    forces = tuple((1 - float(lengths[k]) / rest_length, float(measured[k])) for k in rows)
    # The threads lie in the middle of the wall.
    return RealMuscle(
        name, rest_length, bore + FACTORY_WALL, FACTORY_WALL, FACTORY_ANGLE, float(pressure), forces,
        "neoprene", None, "measured",
    )  # fmt: skip


def _read_paper_muscle() -> RealMuscle:
    known = read_quantities("chambers_wereley_2022/materials")
    table = convert_to_si(read_shipped("chambers_wereley_2022/table1"))
    highest, empty = table.iloc[0], table.iloc[-1]
    pressure, thread = float(highest["pressure"]), float(highest["thread_length"])
    rest_length, turns = float(known["rest_length"]), float(known["turns"])

    def force(contraction: float) -> float:
        # Gaylord's equation with the measured length of the stretched threads; the article prints no forces.
        length = rest_length * (1 - contraction)
        return pressure * (3 * length**2 - thread**2) / (4 * math.pi * turns**2)

    forces = tuple((contraction, force(contraction)) for contraction in (0.0, 0.1, 0.2))
    angle = math.degrees(math.asin(rest_length / float(known["thread_length"])))
    return RealMuscle(
        "paper, 22.2 mm", rest_length, float(empty["diameter"]), 1.6e-3, angle, pressure, forces, "latex",
        int(known["threads"]), "Gaylord's equation",
    )  # fmt: skip


def build_spec(muscle: RealMuscle, is_free: bool) -> dict[str, Any]:
    """Return the spec of a muscle; with its own angle, rubber and wall unless it is free."""
    spec: dict[str, Any] = {
        "name": muscle.name,
        "supply": {"pressure": f"{muscle.pressure} Pa"},
        "force": [
            {"at_least": f"{force:.6g} N", "contraction": max(contraction, 0.0)}
            for contraction, force in muscle.forces
        ],
        "threads": {"kinds": "aramid", "counts": muscle.threads or [48, 64, 96, 144]},
        "limits": {"rest_length": f"{muscle.rest_length} m"},
    }
    if not is_free:
        spec["probability"] = 0
        spec["bladders"] = {"kinds": muscle.rubber}
        spec["limits"] |= {"braid_angle": f"{muscle.angle} deg", "wall": f"{muscle.wall} m"}
    return spec


def format_row(muscle: RealMuscle) -> str:
    """Return the row of a muscle in the table of the README."""
    own = pamjax.size(build_spec(muscle, False), inelastic_and_front=False, stock=False, starts=2)
    free = pamjax.size(build_spec(muscle, True), inelastic_and_front=False, starts=2)
    cells = [
        muscle.name,
        f"{1e3 * muscle.diameter:.1f} mm, {muscle.angle:.0f}°",
        _describe(own) + f" ({100 * (own.numbers['diameter'] / muscle.diameter - 1):+.0f} %)",
        _describe(free),
        free.choice.describe_bladder(),
        f"{free.choice.threads} of {free.choice.describe_thread()}",
        f"{free.probability:.2f}",
    ]
    return f"| {' | '.join(cells)} |"


def _describe(design: pamjax.Design) -> str:
    if not design.feasible:
        return "no solution"
    angle = math.degrees(design.numbers["braid_angle"])
    return f"{1e3 * design.numbers['diameter']:.1f} mm, {angle:.0f}°"


if __name__ == "__main__":
    pamjax.keep_compiled()
    print(
        "| muscle | real | same angle and wall, nominal | free, sold parts | tube | threads | probability |"
    )
    print("|---|---|---|---|---|---|---|")
    for each in list_muscles():
        print(format_row(each))

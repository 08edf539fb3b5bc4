"""What is believed of a muscle before it is fitted: numbers from muscle.toml, and where the rest start."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from pamjax.infer.problem.parameter_space import Free
from pamjax.model.assembly import mechanism_numbers
from pamjax.model.parameters import RULER, law_numbers, meaning
from pamjax.parameter import Meaning
from pamjax.records.blocks import setting_of_length
from pamjax.records.case import Case
from pamjax.records.reading.muscle_toml import Bladder, Entry
from pamjax.records.reading.quantity import Measured

#: Where a toe law starts when nothing else is known: half the slope up to 0.3 % strain.
TOE_START = {
    "thread.toe_ratio": 0.5,
    "thread.crimp": 0.003,
    "thread.width": 1e-3,
    "thread.curvature": 300.0,
    "thread.spread": 1.5e-3,
}
#: What is believed of a toe beside its limits. The corner of a toe is hardly seen, and let loose it takes
#: the slope below it along: 90 % intervals of that slope then held the truth in 63 of 100 simulated
#: recordings, and in 88 when the corner was believed to be as wide as this.
TOE_SD = {"thread.width": 0.5e-3}

#: Numbers of the rubber tube that muscle.toml states, and that no fit moves unless it gives an sd.
SIZES = ("inner_diameter", "thickness", "length")

#: Bore and wall of a rubber tube, as shares of the braid's diameter at rest, where none is stated.
USUAL_BORE, USUAL_WALL = 0.75, 0.08


def is_ruler(name: str) -> bool:
    """Whether a number is the error of one length setting, by its name in a space."""
    return name.rpartition("/")[2].startswith(RULER)


def stated(entry: Entry, law: str) -> dict[str, Measured]:
    """What muscle.toml says about the numbers that this law needs, SI."""
    found = {
        "muscle.rest_length": entry.rest_length,
        "muscle.thread_length": entry.thread_length,
        "muscle.turns": entry.turns,
        "muscle.braid_angle": entry.braid_angle,
        "muscle.diameter": entry.diameter,
    }
    if law != "inelastic":
        if entry.modulus is not None:
            found |= {
                "thread.modulus": entry.modulus,
                "muscle.threads": Measured(float(entry.threads or 0), 0.0),
                "muscle.thread_area": entry.thread_area,
            }
        else:
            found["thread.stiffness"] = entry.stiffness or Measured(_guess_stiffness(entry), math.inf)
        found |= {name: Measured(TOE_START[name], TOE_SD.get(name, math.inf)) for name in law_numbers(law)}
    return {name: measured for name, measured in found.items() if measured is not None}


def _guess_stiffness(entry: Entry) -> float:
    """A start for unknown threads: stiff enough that the muscle is far from bursting."""
    return 1e5 * (entry.rest_length.value / 0.2) ** 2


def free_numbers(case: Case, law: str, mechanisms: Sequence[str] = ()) -> list[Free]:
    """The numbers of a case that a fit may move: all that were measured with an error, or not at all."""
    numbers = [
        Free(name, meaning(name), m.value, m.sd)
        for name, m in (stated(case.entry, law) | stated_mechanisms(case.entry, mechanisms)).items()
        if m.sd > 0 and not _idle(name, case.entry)
    ]
    sensors = case.entry.sensors
    if sensors.length_per_setting and sensors.length:
        count = int(setting_of_length(case.recording).max()) + 1
        error = replace(meaning(RULER), low=-8 * sensors.length, high=8 * sensors.length)
        numbers += [Free(f"{RULER}{k + 1}", error, 0.0, sensors.length) for k in range(count)]
    return numbers


def stated_mechanisms(entry: Entry, ids: Sequence[str]) -> dict[str, Measured]:
    """What is known of the mechanisms' numbers before a fit, SI: from muscle.toml, or a place to start."""
    known = sizes(entry) | _believed_modulus(entry)
    return {
        name: known[name.rpartition(".")[2]]
        if name.rpartition(".")[2] in SIZES
        else known.get(name, Measured(_begin(meaning(name), kind, field), math.inf))
        for name, (kind, field) in mechanism_numbers(ids).items()
    }


def sizes(entry: Entry) -> dict[str, Measured]:
    """Sizes of the rubber tube and of the fittings, as stated, or what is usual beside the braid."""
    thread, turns = entry.braid
    rest = entry.rest_length.value
    outer = math.sqrt(max(thread**2 - rest**2, 0.0)) / (math.pi * turns)
    bladder = entry.bladder or Bladder()
    found = {
        "inner_diameter": bladder.inner_diameter or Measured(USUAL_BORE * outer),
        "thickness": bladder.thickness or Measured(USUAL_WALL * outer),
        "length": Measured(rest),
    }
    fitting = entry.fitting_diameter or Measured(outer, 0.1 * outer)
    # The threads just touch at rest: sin 2θ B / N, from which a fit finds whether they do.
    touching = 2 * math.pi * rest * outer / thread
    found["braid_locking.width"] = Measured(touching, math.inf)
    for ends in ("end_taper", "end_cones"):
        found[f"{ends}.radius"] = Measured(fitting.value / 2, fitting.sd / 2)
    return found


def _believed_modulus(entry: Entry) -> dict[str, Measured]:
    """Shear modulus of the rubber: the lab states Young's, three times as large in incompressible rubber."""
    if entry.bladder is None or entry.bladder.modulus is None:
        return {}
    young = entry.bladder.modulus
    return {"bladder_elasticity.modulus": Measured(young.value / 3, young.sd / 3)}


def _begin(about: Meaning, kind: type, field: str) -> float:
    """Where a number starts when nothing is known: at its default, or a little inside its limits."""
    default = float(getattr(kind(), field))
    reach = 0.05 * (about.high - about.low)
    return min(max(default, about.low + reach), about.high - reach) if about.scale == "linear" else default


def _idle(name: str, entry: Entry) -> bool:
    """Whether a number acts on nothing: rest length only names the contraction of a counted braid."""
    return name == "muscle.rest_length" and entry.thread_length is not None

"""What the inelastic assumption would have cost: size with threads that do not stretch, build with real ones.

The same spec, the same search, the same thread: once with a compliance of zero. What that muscle then lacks,
with threads that stretch, is force (it is missing where it is wanted) and room (it grows wider than drawn).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pamjax.sizing.calibration import Handed
from pamjax.sizing.candidate import index
from pamjax.sizing.enumerate import Tried, best_of
from pamjax.sizing.materials import threads
from pamjax.sizing.problem import OUTPUT, Choice, problem
from pamjax.sizing.requirements import Asked
from pamjax.sizing.spec import Spec

#: The threads that are always shown.
SHOWN = ("aramid", "pet", "nylon")


@dataclass(frozen=True)
class Cost:
    """What the inelastic assumption costs with one kind of thread.

    Attributes:
        thread: its name.
        choice: what was chosen with inelastic threads, None where the spec cannot be met with it.
        shortfall: force that is missing, N, where the most of what is wanted is missing; share alike.
        place: where that is.
        overrun: by how much it is wider than drawn, m; share alike.
        strain: largest of the threads.
        inelastic, elastic: the objective as sized with inelastic and with elastic threads, SI; elastic is
            None where the spec cannot be met with threads that stretch.
    """

    thread: str
    choice: Choice | None
    shortfall: float = 0.0
    share: float = 0.0
    place: str = ""
    overrun: float = 0.0
    wider: float = 0.0
    strain: float = 0.0
    inelastic: float = 0.0
    elastic: float | None = None


def inelastic_costs(spec: Spec, asked: Asked, handed: Handed, chosen: Choice, seed: int) -> list[Cost]:
    """The cost for aramid, polyester and nylon, on the bladder and the number of muscles that were chosen."""
    return [_cost(spec, asked, handed, chosen, name, seed) for name in SHOWN]


def _cost(spec: Spec, asked: Asked, handed: Handed, chosen: Choice, name: str, seed: int) -> Cost:
    kind = next((kind for kind in spec.threads if kind.name == name), threads()[name])
    if spec.words.threads.diameters is not None:
        kind = replace(kind, diameters=spec.words.threads.diameters)
    every = [
        replace(chosen, thread=kind, threads=count, diameter=diameter)
        for count in spec.counts
        for diameter in kind.diameters
    ]
    real = [problem(spec, asked, choice, handed) for choice in every]
    ideal = [one.with_(made=one.made._replace(elastic=0.0)) for one in real]
    best = _best(ideal, seed)
    if best is None or best.answer is None:
        return Cost(name, None)
    own = _best(real, seed)
    z, drawn = best.answer.z, best.problem.outputs(best.answer.z)
    built = best.problem.with_(made=best.problem.made._replace(elastic=1.0)).outputs(z)
    goal = index(OUTPUT[spec.words.minimise])
    lacks = np.array([asked.loads[k] - built[index("force", k)] for k in range(asked.used)])
    size = np.where(asked.loads > 0, asked.loads, np.nanmax(np.abs(asked.loads)) or 1.0)
    worst = int(np.nanargmax(lacks / size)) if np.isfinite(lacks).any() else 0
    widest = index("widest")
    made = best.problem.made
    strains = built[[index("tension", k) for k in range(asked.used)]] / (made.thread_area * made.modulus)
    return Cost(
        name,
        best.problem.choice,
        shortfall=max(0.0, float(lacks[worst])),
        share=max(0.0, float(lacks[worst] / size[worst])),
        place=asked.labels[worst],
        overrun=float(built[widest] - drawn[widest]),
        wider=float(built[widest] / drawn[widest] - 1),
        strain=float(np.max(strains)),
        inelastic=float(drawn[goal]),
        elastic=float(np.exp(own.answer.value)) if own is not None and own.answer is not None else None,
    )


def _best(problems, seed: int) -> Tried | None:
    tried, _ = best_of(problems, starts=1, seed=seed)
    return tried[0] if tried and tried[0].answer is not None else None

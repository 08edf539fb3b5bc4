"""What the inelastic assumption would have cost: size with threads that do not stretch, build with real ones.

The same spec, the same search, the same thread: once with a compliance of zero. What that muscle then lacks,
with threads that stretch, is force (it is missing where it is wanted) and room (it grows wider than drawn).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pamjax.sizing.calibration import CalibrationTransfer
from pamjax.sizing.candidate import locate_output
from pamjax.sizing.enumerate import ChoiceResult, search_choices
from pamjax.sizing.materials import list_threads
from pamjax.sizing.problem import OBJECTIVE_OUTPUTS, Choice, build_problem
from pamjax.sizing.requirements import SizingTask
from pamjax.sizing.spec import Spec

#: The threads that are always shown.
COMPARED_THREADS = ("aramid", "pet", "nylon")


@dataclass(frozen=True)
class InelasticCost:
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


def compute_inelastic_costs(
    spec: Spec, task: SizingTask, transfer: CalibrationTransfer, choice: Choice, seed: int
) -> list[InelasticCost]:
    """The cost for aramid, polyester and nylon, on the bladder and the number of muscles that were chosen."""
    return [_compute_cost(spec, task, transfer, choice, name, seed) for name in COMPARED_THREADS]


def _compute_cost(
    spec: Spec, task: SizingTask, transfer: CalibrationTransfer, base_choice: Choice, name: str, seed: int
) -> InelasticCost:
    kind = next((kind for kind in spec.threads if kind.name == name), list_threads()[name])
    if spec.entries.threads.diameters is not None:
        kind = replace(kind, diameters=spec.entries.threads.diameters)
    choices = [
        replace(base_choice, thread=kind, threads=count, diameter=diameter)
        for count in spec.counts
        for diameter in kind.diameters
    ]
    elastic_problems = [build_problem(spec, task, choice, transfer) for choice in choices]
    inelastic_problems = [
        elastic_problem.copy_with(build=elastic_problem.build._replace(elastic=0.0))
        for elastic_problem in elastic_problems
    ]
    best = _find_best(inelastic_problems, seed)
    if best is None or best.optimum is None:
        return InelasticCost(name, None)
    elastic_best = _find_best(elastic_problems, seed)
    z, drawn_outputs = best.optimum.z, best.problem.compute_outputs(best.optimum.z)
    built_outputs = best.problem.copy_with(build=best.problem.build._replace(elastic=1.0)).compute_outputs(z)
    objective_index = locate_output(OBJECTIVE_OUTPUTS[spec.entries.minimise])
    shortfalls = np.array(
        [task.loads[k] - built_outputs[locate_output("force", k)] for k in range(task.point_count)]
    )
    force_scale = np.where(task.loads > 0, task.loads, np.nanmax(np.abs(task.loads)) or 1.0)
    worst = int(np.nanargmax(shortfalls / force_scale)) if np.isfinite(shortfalls).any() else 0
    widest = locate_output("widest")
    build = best.problem.build
    strains = built_outputs[[locate_output("tension", k) for k in range(task.point_count)]] / (
        build.thread_area * build.modulus
    )
    return InelasticCost(
        name,
        best.problem.choice,
        shortfall=max(0.0, float(shortfalls[worst])),
        share=max(0.0, float(shortfalls[worst] / force_scale[worst])),
        place=task.labels[worst],
        overrun=float(built_outputs[widest] - drawn_outputs[widest]),
        wider=float(built_outputs[widest] / drawn_outputs[widest] - 1),
        strain=float(np.max(strains)),
        inelastic=float(drawn_outputs[objective_index]),
        elastic=float(np.exp(elastic_best.optimum.log_objective))
        if elastic_best is not None and elastic_best.optimum is not None
        else None,
    )


def _find_best(problems, seed: int) -> ChoiceResult | None:
    results, _ = search_choices(problems, starts=1, seed=seed)
    return results[0] if results and results[0].optimum is not None else None

"""Errors of the inelastic assumption: a muscle sized with inelastic threads, evaluated with elastic ones.

Spec, search and thread are the same; the sizing sets the compliance of the threads to zero. With elastic
threads, this muscle has less force than required and a larger diameter than computed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pamjax.sizing.calibration import CalibrationTransfer
from pamjax.sizing.candidate import locate_output
from pamjax.sizing.enumerate import ChoiceResult, search_choices
from pamjax.sizing.problem import OBJECTIVE_OUTPUTS, Choice, build_problem
from pamjax.sizing.requirements import SizingTask
from pamjax.sizing.specification.materials import list_threads
from pamjax.sizing.specification.spec import Spec

#: Threads for which the errors are reported.
COMPARED_THREADS = ("aramid", "pet", "nylon")


@dataclass(frozen=True)
class InelasticCost:
    """Errors of the inelastic assumption with one kind of thread.

    Attributes:
        thread: name of the thread.
        choice: choice with inelastic threads, None if the spec is infeasible.
        shortfall: largest missing force, N; share: the same relative to the required force.
        place: operating point of the largest missing force, as text.
        overrun: excess of the diameter, m; wider: the same relative to the computed diameter.
        strain: largest strain of the threads.
        inelastic, elastic: objective with inelastic and with elastic threads, SI; elastic is None if the spec
            is infeasible with elastic threads.
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
    """Return the errors for aramid, polyester and nylon, with the chosen bladder and number of muscles."""
    return [_compute_cost(spec, task, transfer, choice, name, seed) for name in COMPARED_THREADS]


def _compute_cost(
    spec: Spec, task: SizingTask, transfer: CalibrationTransfer, base_choice: Choice, name: str, seed: int
) -> InelasticCost:
    kind = next((kind for kind in spec.threads if kind.name == name), list_threads()[name])
    if spec.entries.threads.diameters is not None:
        kind = replace(kind, diameters=spec.entries.threads.diameters)
    choices = [
        replace(base_choice, thread=kind, threads=count, diameter=diameter, tube=None)
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
    z, inelastic_outputs = best.optimum.z, best.problem.compute_outputs(best.optimum.z)
    elastic_outputs = best.problem.copy_with(build=best.problem.build._replace(elastic=1.0)).compute_outputs(
        z
    )
    objective_index = locate_output(OBJECTIVE_OUTPUTS[spec.entries.minimise])
    shortfalls = np.array(
        [task.loads[k] - elastic_outputs[locate_output("force", k)] for k in range(task.point_count)]
    )
    force_scale = np.where(task.loads > 0, task.loads, np.nanmax(np.abs(task.loads)) or 1.0)
    worst = int(np.nanargmax(shortfalls / force_scale)) if np.isfinite(shortfalls).any() else 0
    widest = locate_output("widest")
    build = best.problem.build
    strains = elastic_outputs[[locate_output("tension", k) for k in range(task.point_count)]] / (
        build.thread_area * build.modulus
    )
    return InelasticCost(
        name,
        best.problem.choice,
        shortfall=max(0.0, float(shortfalls[worst])),
        share=max(0.0, float(shortfalls[worst] / force_scale[worst])),
        place=task.labels[worst],
        overrun=float(elastic_outputs[widest] - inelastic_outputs[widest]),
        wider=float(elastic_outputs[widest] / inelastic_outputs[widest] - 1),
        strain=float(np.max(strains)),
        inelastic=float(inelastic_outputs[objective_index]),
        elastic=float(np.exp(elastic_best.optimum.log_objective))
        if elastic_best is not None and elastic_best.optimum is not None
        else None,
    )


def _find_best(problems, seed: int) -> ChoiceResult | None:
    results, _ = search_choices(problems, starts=1, seed=seed)
    return results[0] if results and results[0].optimum is not None else None

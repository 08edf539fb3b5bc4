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
_COMPARED_THREADS = ("aramid", "pet", "nylon")


@dataclass(frozen=True)
class InelasticError:
    """Errors of the inelastic assumption with one kind of thread.

    Attributes:
        thread: name of the thread.
        choice: choice with inelastic threads, None if the spec is infeasible.
        missing_force: largest missing force, N.
        missing_force_share: the same relative to the required force.
        worst_point: operating point of the largest missing force, as text.
        excess_diameter: excess of the diameter, m.
        excess_diameter_share: the same relative to the computed diameter.
        max_strain: largest strain of the threads.
        inelastic_objective: objective with inelastic threads, SI.
        elastic_objective: objective with elastic threads, SI; None if the spec is infeasible with them.
    """

    thread: str
    choice: Choice | None
    missing_force: float = 0.0
    missing_force_share: float = 0.0
    worst_point: str = ""
    excess_diameter: float = 0.0
    excess_diameter_share: float = 0.0
    max_strain: float = 0.0
    inelastic_objective: float = 0.0
    elastic_objective: float | None = None


def compute_inelastic_errors(
    spec: Spec, task: SizingTask, transfer: CalibrationTransfer, choice: Choice, seed: int
) -> list[InelasticError]:
    """Return the errors for aramid, polyester and nylon, with the chosen bladder and number of muscles."""
    return [_compute_error(spec, task, transfer, choice, name, seed) for name in _COMPARED_THREADS]


def _compute_error(
    spec: Spec, task: SizingTask, transfer: CalibrationTransfer, base_choice: Choice, name: str, seed: int
) -> InelasticError:
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
        return InelasticError(name, None)
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
    return InelasticError(
        name,
        best.problem.choice,
        missing_force=max(0.0, float(shortfalls[worst])),
        missing_force_share=max(0.0, float(shortfalls[worst] / force_scale[worst])),
        worst_point=task.labels[worst],
        excess_diameter=float(elastic_outputs[widest] - inelastic_outputs[widest]),
        excess_diameter_share=float(elastic_outputs[widest] / inelastic_outputs[widest] - 1),
        max_strain=float(np.max(strains)),
        inelastic_objective=float(inelastic_outputs[objective_index]),
        elastic_objective=float(np.exp(elastic_best.optimum.log_objective))
        if elastic_best is not None and elastic_best.optimum is not None
        else None,
    )


def _find_best(problems, seed: int) -> ChoiceResult | None:
    results, _ = search_choices(problems, starts=1, seed=seed)
    return results[0] if results and results[0].optimum is not None else None

"""Time of a fit, compared with SciPy and lmfit on the same problem in NumPy.

    python -m tests.benchmarks.fit [--json FILE]

The reported times are medians of several repeats on one machine; only their ratios are valid for other
machines. All fits have the same residuals (protocol of the paper, force and diameter) and the same start.
The others use NumPy and finite differences. The script checks that all results agree. `command.py` measures
the time of a complete command.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
import lmfit
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.optimize import least_squares

from pamjax.infer.fitting.fit import reweight_datasets
from pamjax.infer.fitting.joint_space import build_joint_space
from pamjax.infer.fitting.least_squares import Solution, solve_least_squares
from pamjax.infer.problem.dataset import Dataset, build_dataset
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.records.protocol import PAPER_PROTOCOL
from tests.benchmarks.keep import arguments, keep
from tests.infer.made import TRUE, made

#: Newton steps of the NumPy toe law, from the solution of linear threads.
STEPS = 12

#: Difference in standard deviations below which two results agree.
SAME = 0.01


class Twin:
    """The residuals of a dataset in NumPy, without JAX."""

    def __init__(self, law: str, dataset: Dataset, space: ParameterSpace) -> None:
        self.law, self.names = law, space.names
        self.log = np.array(space.log_scale)
        self.low, self.high, self.mean, self.sd, self.origin, self.width = (
            np.asarray(a) for a in (space.low, space.high, space.mean, space.sd, space.origin, space.width)
        )
        rows, n = dataset.rows, int(dataset.rows.training_mask.sum())
        self.pressure, self.length, self.force, self.diameter = (
            np.asarray(a)[:n] for a in (rows.pressure, rows.length, rows.force, rows.diameter)
        )
        trust = np.asarray(dataset.channel_weights)
        self.weights: tuple[np.ndarray, ...] = (
            trust[0] * np.asarray(rows.force_weight)[:n],
            trust[1] * np.asarray(rows.diameter_weight)[:n],
        )

    def values(self, u: np.ndarray) -> np.ndarray:
        share = 1 / (1 + np.exp(-(self.origin + u * self.width)))
        low, high = np.where(self.log, self.low, 1.0), np.where(self.log, self.high, 2.0)
        return np.where(self.log, low * (high / low) ** share, self.low + (self.high - self.low) * share)

    def prior(self, u: np.ndarray, values: np.ndarray) -> np.ndarray:
        z = np.abs(self.origin + u * self.width)
        anywhere = np.copysign(
            2 * np.sqrt(0.5 * z + np.log1p(np.exp(-z)) - np.log(2.0)), self.origin + u * self.width
        )
        return np.where(np.isfinite(self.sd), (values - self.mean) / self.sd, anywhere)

    def __call__(self, u: np.ndarray) -> np.ndarray:
        values = self.values(u)
        now = TRUE | dict(zip(self.names, values, strict=True))
        stiffness = now["thread.modulus"] * now["muscle.threads"] * now["muscle.thread_area"]
        rest, turns = now["muscle.thread_length"], now["muscle.turns"]
        pull = self.pressure * self.length * rest / (2 * np.pi * turns**2) / stiffness
        strain = pull / (1 - pull)
        if self.law == "toe":
            strain = self._toe(
                pull, strain, now["thread.toe_ratio"], now["thread.crimp"], now["thread.width"]
            )
        thread = rest * (1 + strain)
        force = self.pressure * (3 * self.length**2 - thread**2) / (4 * np.pi * turns**2)
        diameter = np.sqrt(thread**2 - self.length**2) / (np.pi * turns)
        return np.concatenate(
            [
                (self.force - force) * self.weights[0],
                (self.diameter - diameter) * self.weights[1],
                self.prior(u, values),
            ]
        )

    @staticmethod
    def _toe(pull, strain, ratio, crimp, width):
        begin = np.hypot(crimp, width)
        strain = strain + crimp
        for _ in range(STEPS):
            root = np.hypot(strain - crimp, width)
            load = ratio * strain + (1 - ratio) * 0.5 * (strain + root - begin)
            slope = ratio + (1 - ratio) * 0.5 * (1 + (strain - crimp) / root)
            strain = strain - (load - pull * (1 + strain)) / (slope - pull)
        return strain


def problem(law: str) -> tuple[tuple[Dataset, ...], ParameterSpace]:
    """Return the fit problem of the paper's protocol, with weights from the first solution."""
    case = made(law, plan=PAPER_PROTOCOL, seed=1)
    at, (rename,) = build_joint_space([case], law, ())
    members = (build_dataset(case, law, at, rename),)
    members, _ = reweight_datasets([case], members, at, solve_least_squares(members, at, jnp.zeros(at.size)))
    return members, at


def by_lmfit(twin: Twin, size: int) -> np.ndarray:
    start = lmfit.Parameters()
    for k in range(size):
        start.add(f"u{k}", 0.0)

    def misfit(p):
        return twin(np.array([p[f"u{k}"].value for k in range(size)]))

    result = lmfit.minimize(misfit, start, scale_covar=False, xtol=1e-9, ftol=1e-9)
    values = result.params.values()  # pyright: ignore[reportAttributeAccessIssue]
    return np.array([p.value for p in values])


def by_scipy(twin: Twin, size: int, method: Literal["lm", "trf"]) -> np.ndarray:
    return least_squares(twin, np.zeros(size), method=method, xtol=1e-9, ftol=1e-9).x


def milliseconds(call: Callable[[], object], repeats: int) -> float:
    """Return the median processor time, ms; other processes affect the wall-clock time."""
    jax.block_until_ready(call())
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        jax.block_until_ready(call())
        times.append(time.process_time() - begin)
    return 1e3 * float(np.median(times))


def warm(console: Console, repeats: int = 9) -> dict[str, float]:
    """Return the processor time of a solve with its curvature, and of the solves of the other libraries."""
    table = Table("thread law", "rows", "pamjax", "SciPy lm", "SciPy trf", "lmfit", "SciPy's best / pamjax")
    figures = {}
    for law in ("elastic", "toe"):
        members, space = problem(law)
        twin, begin = Twin(law, members[0], space), jnp.zeros(space.size)
        mine = solve_least_squares(members, space, begin)
        rivals = {
            "SciPy lm": partial(by_scipy, twin, space.size, "lm"),
            "SciPy trf": partial(by_scipy, twin, space.size, "trf"),
            "lmfit": partial(by_lmfit, twin, space.size),
        }
        for name, call in rivals.items():
            _same_place(console, f"{law}, {name}", call(), mine)
        own = milliseconds(
            lambda arguments=(members, space, begin): solve_least_squares(*arguments).u, repeats
        )
        theirs = {name: milliseconds(call, repeats) for name, call in rivals.items()}
        best = min(theirs["SciPy lm"], theirs["SciPy trf"])
        times = (f"{time:.1f} ms" for time in (own, *theirs.values()))
        table.add_row(law, f"{int(members[0].rows.training_mask.sum())}", *times, f"{best / own:.1f}")
        all_times = {"pamjax": own} | theirs
        figures |= {f"{law}, {name}, processor [ms]": time for name, time in all_times.items()}
        figures[f"{law}, SciPy's best over pamjax"] = best / own
    console.print("One fit, warm, processor time:", table)
    return figures


def _same_place(console: Console, name: str, u: np.ndarray, mine: Solution) -> None:
    sd = np.sqrt(np.diag(np.linalg.inv(np.asarray(mine.information + mine.prior_information))))
    off = np.max(np.abs(u - np.asarray(mine.u)) / sd)
    if off > SAME:
        console.print(f"{name}: ends {off:.2g} sd from pamjax, so its time tells nothing")


def main() -> None:
    _, file = arguments()
    console = Console()
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    console.print(f"{os.cpu_count()} cores, load {load:.1f} before this began")
    keep(file, warm(console))


if __name__ == "__main__":
    main()

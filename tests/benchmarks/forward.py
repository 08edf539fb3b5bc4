"""Time of a million states, compared with a memory copy and with other implementations.

    python -m tests.benchmarks.forward [states] [--json FILE]

The reported times are medians of several repeats in one run; only their ratios are valid for other machines.
Python loops are measured with fewer states, and the time is scaled.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import scipy
from rich.console import Console
from rich.table import Table
from scipy.optimize import brentq

from pamjax.model import braid
from pamjax.model.balance import stretch_measured
from pamjax.model.muscle import Muscle, predict
from pamjax.model.thread import ExponentialToe, LinearThread, RecruitmentToe, SmoothToe
from tests.benchmarks.keep import arguments, keep

REST, B0, N, S = 0.235744, 0.251206, 1.09, 9.88e5
TOE = SmoothToe(S, toe_ratio=0.5, crimp=0.003, width=1e-3)
LAWS = {
    "closed form (linear thread)": LinearThread(S),
    "smooth toe": TOE,
    "exponential toe": ExponentialToe(S, crimp=0.003, curvature=300.0),
    "recruitment toe": RecruitmentToe(S, crimp=0.003, spread=1.5e-3),
}


def median_ms(call: Callable[[], object], repeats: int = 15) -> float:
    jax.block_until_ready(call())
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - begin)
    return 1e3 * float(np.median(times))


@eqx.filter_jit
def force(muscle, pressure, length):
    return predict(muscle, pressure, length).force


@eqx.filter_jit
def gradient_in_inputs(muscle, pressure, length):
    return jax.grad(lambda p, l: jnp.sum(force(muscle, p, l)), argnums=(0, 1))(pressure, length)


@eqx.filter_jit
def slopes_in_numbers(muscle, pressure, length):
    """Return the Jacobian in the parameters by forward mode, as a least-squares fit needs it."""
    numbers, rest = eqx.partition(muscle, eqx.is_array)
    leaves, tree = jax.tree.flatten(numbers)

    def column(k):
        def of(v):
            changed = eqx.combine(jax.tree.unflatten(tree, [*leaves[:k], v, *leaves[k + 1 :]]), rest)
            return force(changed, pressure, length)

        return jax.jvp(of, (leaves[k],), (jnp.ones_like(leaves[k]),))[1]

    return [column(k) for k in range(len(leaves))]


@eqx.filter_jit
def gradient_of_sum(muscle, pressure, length):
    return eqx.filter_grad(lambda m: jnp.sum(force(m, pressure, length)))(muscle)


#: Derivatives in both inputs (observer), column by column (least squares), and of a sum (sampler).
GRADIENTS = {
    "gradient in both inputs": gradient_in_inputs,
    "slopes in all numbers": slopes_in_numbers,
    "reverse mode of the sum": gradient_of_sum,
}


@jax.jit
def cubic(measured, pressure, length):
    return stretch_measured(measured, pressure, length, B0, N, S)[0]


def toe_residual(strain, pull):
    return (TOE.load(strain) - pull * (1 + strain)) / S


@jax.jit
def by_optimistix(pressure, length):
    """Return the roots by a generic root finder under `vmap`, from the default start of a law."""

    def solve_point(p, l):
        pull = braid.hoop_pull(p, l, B0, N)
        solver = optx.Newton(rtol=1e-9, atol=1e-12)
        solution = optx.root_find(toe_residual, solver, TOE.slack_strain + pull / S, args=pull, throw=False)
        return braid.gaylord_force(p, l, B0 * (1 + solution.value), N)

    return jax.vmap(solve_point)(pressure, length)


def by_brentq(pressure, length):
    r, c, w, q0 = 0.5, 0.003, 1e-3, float(np.hypot(0.003, 1e-3))

    def residual(strain, pull):
        toe = 0.5 * (strain + ((strain - c) ** 2 + w**2) ** 0.5 - q0)
        return S * (r * strain + (1 - r) * toe) - pull * (1 + strain)

    pulls = np.asarray(braid.hoop_pull(pressure, length, B0, N))
    return [brentq(residual, 0.0, 1.0, args=(pull,), xtol=1e-12) for pull in pulls]


def by_roots(measured, pressure, length):
    real_roots = []
    for f, p, l in zip(measured, pressure, length, strict=True):
        k, per_area = B0 / (l * S), p / (4 * np.pi * N**2)
        roots = np.roots([k * per_area, 0.0, k * (f - l**2 * per_area) - 1, B0])
        real_roots.append(min(z.real for z in roots if z.real > 0 and abs(z.imag) < 1e-9))
    return real_roots


def measure(states: int) -> list[tuple[str, float, str]]:
    """Return (label, milliseconds for all states, label of the reference)."""
    random = np.random.default_rng(1)
    host = [random.uniform(*ends, states) for ends in ((1e4, 7e5), (0.16, REST), (0.0, 4700.0))]
    pressure, length, measured = map(jnp.asarray, host)
    spare = [np.empty(states) for _ in host]
    few = [a[: min(states, 2000)] for a in host]
    scale = states / len(few[0])
    muscles = {name: Muscle(REST, B0, N, law) for name, law in LAWS.items()}

    def copy(arrays):
        return median_ms(lambda: [np.copyto(s, a) for s, a in zip(spare, arrays, strict=True)], 31)

    cubic_row, toe_row = "strain by the cubic, force measured", "force, smooth toe"
    rows = [("memory copy of two inputs and the force", copy(host), "")]
    for name, m in muscles.items():
        rows.append((f"force, {name}", median_ms(lambda m=m: force(m, pressure, length)), ""))
    rows.append((cubic_row, median_ms(lambda: cubic(measured, pressure, length)), ""))
    for name, m in muscles.items():
        for what, call in GRADIENTS.items():
            took = median_ms(lambda m=m, call=call: call(m, pressure, length), 7)
            rows.append((f"{what}, {name}", took, f"force, {name}"))
    rows.append(
        (
            "optimistix Newton under vmap, smooth toe",
            median_ms(lambda: by_optimistix(pressure, length), 5),
            toe_row,
        )
    )
    rows.append(
        ("scipy brentq in a loop, smooth toe", scale * median_ms(lambda: by_brentq(*few[:2]), 3), toe_row)
    )
    rows.append(
        ("numpy roots in a loop, cubic", scale * median_ms(lambda: by_roots(few[2], *few[:2]), 3), cubic_row)
    )
    return rows


def show(rows: list[tuple[str, float, str]], states: int) -> Table:
    took = {what: ms for what, ms, _ in rows}
    first = rows[0][1]
    table = Table(title=f"{states:,} states, float64, median")
    table.add_column("")
    for header in ("ms", "× copy", "× its forward"):
        table.add_column(header, justify="right")
    for what, ms, against in rows:
        forward = f"{ms / took[against]:.1f}" if against in took else ""
        table.add_row(what, f"{ms:,.1f}", f"{ms / first:,.1f}", forward)
    return table


def main() -> None:
    words, file = arguments()
    states = int(float(words[0])) if words else 1_000_000
    console = Console(width=110)
    rows = measure(states)
    console.print(show(rows, states))
    versions = ", ".join(f"{m.__name__} {m.__version__}" for m in (jax, np, scipy, eqx, optx))
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    console.print(f"{cores} cores, {jax.default_backend()}, Python {platform.python_version()}, {versions}")
    took = {what: ms for what, ms, _ in rows}
    ratios = {f"{what}, over {base}": ms / took[base] for what, ms, base in rows if base in took}
    ratios |= {f"{what}, over the memory copy": ms / rows[0][1] for what, ms in took.items()}
    keep(file, {"states": states} | {f"{what} [ms]": ms for what, ms in took.items()} | ratios)


if __name__ == "__main__":
    main()

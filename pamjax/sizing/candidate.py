"""A candidate muscle: its outputs at the operating points of a spec, and their exact derivatives.

    coordinates  c = (ln L0, θ0, ln D0, ln t, ln p)      of one muscle

    L0  rest length          m        B0 = L0 / sin θ0            thread length
    θ0  braid angle at rest  rad      N = B0 cos θ0 / (π D0)      turns
    D0  diameter at rest     m        of the braid, and outer diameter of the bladder
    t   bladder wall         m
    p   working pressure     Pa

The muscle is a `Bench` of the package `model`: elastic threads, the rubber of the bladder, and the
mechanisms that a calibration transfers. With friction, the force at a point is that after a contraction from
the rest length, as when the muscle lifts a load. Additional equations:

    spacing   s = 4π L R / (n B)           of neighbouring threads; they fit if s is at least their width w
    mesh      P (s − w) / (3.5 μ t λr)     pressure / pressure at which the bladder bulges through the mesh.
              The rubber over an opening a becomes a half sphere, stretched by √2 in both directions, with
              stress σ = 1.75 μ and half the wall: P = 2 σ (t/2) / (a/2) = 3.5 μ t / a. This estimate is
              rough; a safety factor allows for that
    air       [(p + pa) V1 − pa V0] / pa   at ambient pressure and temperature, V without the rubber

Neglects: fittings (mass, price), the ends of the bladder, fatigue, creep, temperature, speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.jit import compile_on_call, list_compiler_options
from pamjax.model import braid, wall
from pamjax.model.balance import Status
from pamjax.model.bench import Bench
from pamjax.model.history import build_time_history
from pamjax.model.mechanism import AbstractMemory, AbstractPressureLoss, AbstractSlip, Past
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.registry import order_mechanisms
from pamjax.units import ATMOSPHERIC_PRESSURE

#: Number of operating points of a candidate; a spec with fewer points repeats its first required one.
POINT_COUNT = 16
#: Bulging pressure × opening / (shear modulus × wall thickness).
_BULGE_FACTOR = 3.5

#: Number of candidates in one compiled batch.
_BATCH_SIZE = 64

#: Names of the outputs at each operating point, and of the muscle as a whole.
POINT_OUTPUTS = ("force", "diameter", "tension", "used", "fit", "mesh", "strain", "burst")
MUSCLE_OUTPUTS = (
    "length", "angle", "rest_diameter", "wall", "pressure", "thread_length", "turns", "bore", "slenderness",
    "mass", "air", "cost", "unsolved", "widest", "bundle",
)  # fmt: skip

COORDINATES = ("rest_length", "braid_angle", "diameter", "wall", "pressure")


class MuscleBuild(NamedTuple):
    """Material properties, counts and manufacturing errors of a candidate, SI.

    Attributes:
        threads: number of threads, both families together.
        thread_diameter: m; thread_area: m², solid; modulus, strength: Pa; density: kg/m³; price: per kg.
        elastic: 1, or 0 for inelastic threads.
        shear, mooney, elongation: of the rubber, Pa, 1 and 1; rubber_density: kg/m³; rubber_price: per kg.
        parallel: number of muscles; packing: diameter of the circle around them / diameter of one.
        length_error, thread_error, turns_error, wall_error: manufacturing errors, m, m, 1, m.
        position_error, pressure_error: errors of the set length, m, and of the pressure, as a fraction of it.
        force_error: model error of the force, as a fraction of the blocked force at the same pressure.
    """

    threads: Any = 0.0
    thread_diameter: Any = 0.0
    thread_area: Any = 0.0
    modulus: Any = 0.0
    strength: Any = 0.0
    density: Any = 0.0
    price: Any = 0.0
    elastic: Any = 1.0
    shear: Any = 0.0
    mooney: Any = 0.0
    elongation: Any = 1.0
    rubber_density: Any = 0.0
    rubber_price: Any = 0.0
    parallel: Any = 1.0
    packing: Any = 1.0
    length_error: Any = 0.0
    thread_error: Any = 0.0
    turns_error: Any = 0.0
    wall_error: Any = 0.0
    position_error: Any = 0.0
    pressure_error: Any = 0.0
    force_error: Any = 0.0


class OperatingPoints(NamedTuple):
    """Operating points of a candidate, (k,) each.

    The length is L0 (1 − contraction) − shortening. The pressure is supply_share × p + pressure, with the
    working pressure p.
    """

    contraction: Float[Array, " k"] | np.ndarray
    shortening: Float[Array, " k"] | np.ndarray
    supply_share: Float[Array, " k"] | np.ndarray
    pressure: Float[Array, " k"] | np.ndarray


#: Parameters of mechanisms by "id.field"; in a batch each is an array.
Numbers = Mapping[str, Any]


def build_bench(c: Array | np.ndarray, build: MuscleBuild, ids: tuple[str, ...], numbers: Numbers) -> Bench:
    """Return the candidate as a bench without sensors.

    Args:
        c: coordinates.
        build: material properties, counts and manufacturing errors.
        ids: transferred mechanisms besides elastic threads and rubber.
        numbers: parameters of these mechanisms by "id.field". "end_taper.radius" is relative to the radius at
            rest; "thread_crimp.load" is divided by the area n A of all threads, Pa.
    """
    rest_length, angle, outer_diameter, t = (
        jnp.exp(c[0]),
        c[1],
        jnp.exp(c[2]),
        jnp.exp(c[3]) + build.wall_error,
    )
    thread, turns = braid.from_angle(rest_length, outer_diameter, angle)
    area = build.threads * build.thread_area
    dimensions = {
        "inner_diameter": outer_diameter - 2 * t,
        "thickness": t,
        "length": rest_length + build.length_error,
    }
    mechanisms_by_id = {
        "braid_elasticity": BraidElasticity(build.elastic / (area * build.modulus)),
        "bladder_elasticity": BladderElasticity(build.shear, build.mooney, **dimensions),
    }
    scales = {
        "end_taper.radius": outer_diameter / 2,
        "thread_crimp.load": area,
        "braid_locking.width": build.threads * build.thread_diameter,
    }
    for kind in order_mechanisms(ids):
        fields = {n.partition(".")[2]: v * scales.get(n, 1.0) for n, v in numbers.items()
                  if n.partition(".")[0] == kind.id}  # fmt: skip
        mechanisms_by_id[kind.id] = kind(**fields)
    mechanisms = tuple(mechanisms_by_id[kind.id] for kind in order_mechanisms(mechanisms_by_id))
    return Bench(thread + build.thread_error, turns + build.turns_error, mechanisms)


def _solve_points(bench: Bench, pressure: Array, length: Array, rest_length: Array) -> tuple[Past, Array]:
    """Return the equilibrium at each point; with memory, after a contraction from the rest length."""
    if not any(bench.find_mechanisms(kind) for kind in (AbstractMemory, AbstractSlip, AbstractPressureLoss)):
        zero = jnp.zeros(())
        return jax.vmap(lambda p, true_length: bench.solve_instant(p, true_length, zero, (zero, zero)))(
            pressure, length
        )
    k = pressure.shape[0]
    path_history = build_time_history(np.arange(2.0 * k), np.arange(2 * k) % 2 == 0, restart=True)
    lengths = jnp.stack([jnp.full(k, rest_length), length], axis=1).ravel()
    past, status = bench.compute_past(jnp.repeat(pressure, 2), lengths, path_history)
    return jax.tree.map(lambda x: x[1::2], past), status[1::2]


def compute_outputs(
    c: Float[Array, " 5"],
    build: MuscleBuild,
    numbers: Numbers,
    points: OperatingPoints,
    ids: tuple[str, ...] = (),
) -> Float[Array, " m"]:
    """Return all outputs of a candidate, (m,), in the order of `locate_output`.

    The outputs at each point come first, then `MUSCLE_OUTPUTS`, SI:

        force     of all muscles, N                diameter  outer, m
        tension   of one thread, N                 used      tension / strength
        fit       spacing / thread width           mesh      pressure / bulging pressure
        strain    hoop strain of the rubber / elongation at break
        burst     hoop pull / thread stiffness
    """
    rest_length, t, working_pressure = jnp.exp(c[0]), jnp.exp(c[3]), jnp.exp(c[4])
    bench = build_bench(c, build, ids, numbers).prepare()
    pressure = jnp.asarray(points.supply_share * working_pressure + points.pressure)
    pressure = pressure * (1 + build.pressure_error)
    real_rest_length = rest_length + build.length_error
    length = jnp.asarray(real_rest_length * (1 - points.contraction) - points.shortening)
    length = length + build.position_error
    past, status = _solve_points(bench, pressure, length, real_rest_length)
    state, n = past.state, build.threads
    blocked_force = braid.gaylord_force(pressure, rest_length, bench.thread_length, bench.turns)
    force = build.parallel * (past.force + build.force_error * blocked_force)
    radius = jnp.maximum(state.radius, 1e-9)
    spacing = 4 * jnp.pi * state.length * radius / (n * state.thread)
    (rubber,) = bench.find_mechanisms(BladderElasticity)
    stretches = jax.vmap(lambda s: jnp.stack(wall.stretch(rubber, s)))(state)
    mesh = pressure * (spacing - build.thread_diameter) / (_BULGE_FACTOR * build.shear * t * stretches[:, 2])
    pull = braid.hoop_pull(pressure, length, bench.thread_length, bench.turns)
    burst = pull / (n * build.thread_area * build.modulus)
    outer_diameter = 2 * radius + 2 * build.thread_diameter
    tension = past.load / n
    point_outputs = (
        force,
        outer_diameter,
        tension,
        tension / (build.thread_area * build.strength),
        spacing / build.thread_diameter,
        mesh,
        (stretches[:, 1] - 1) / build.elongation,
        burst,
    )

    rubber_volume = wall.rubber_volume(rubber)
    rest_volume = braid.volume(rest_length, bench.thread_length, bench.turns) - rubber_volume
    filled_volume = (pressure + ATMOSPHERIC_PRESSURE) * (state.volume - rubber_volume)
    # Point 0 (rest length at supply pressure) is not part of the stroke.
    air = (
        build.parallel
        * (jnp.max(filled_volume[1:]) - ATMOSPHERIC_PRESSURE * rest_volume)
        / ATMOSPHERIC_PRESSURE
    )
    yarn = n * bench.thread_length * build.thread_area * build.density
    mass = build.parallel * (yarn + rubber_volume * build.rubber_density)
    cost = build.parallel * (yarn * build.price + rubber_volume * build.rubber_density * build.rubber_price)
    rest_diameter = jnp.exp(c[2])
    widest = jnp.max(outer_diameter[1:])
    muscle_outputs = (
        rest_length,
        c[1],
        rest_diameter,
        t,
        working_pressure,
        bench.thread_length,
        bench.turns,
        1 - 2 * t / rest_diameter,
        rest_length / widest,
        mass,
        air,
        cost,
        jnp.sum(status != int(Status.OK)).astype(float),
        widest,
        widest * build.packing,
    )
    return jnp.concatenate([jnp.stack(point_outputs).ravel(), jnp.stack(muscle_outputs)])


def locate_output(name: str, point: int | None = None) -> int:
    """Return the index of an output."""
    if point is None:
        return len(POINT_OUTPUTS) * POINT_COUNT + MUSCLE_OUTPUTS.index(name)
    return POINT_OUTPUTS.index(name) * POINT_COUNT + point


@cache
def _compile_evaluation(structure: Any, shapes: tuple[tuple[int, ...], ...], ids: tuple[str, ...]):
    """Return a program of the coordinates and of one array with all other inputs.

    With one array per input, a call would take twice as long.
    """
    ends = np.cumsum([math.prod(shape) for shape in shapes])

    def evaluate(c, packed):
        parts = jnp.split(packed, ends[:-1])
        leaves = [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]
        build, numbers, points = jax.tree.unflatten(structure, leaves)

        def compute(c):
            return compute_outputs(c, build, numbers, points, ids)

        return compute(c), jax.jacfwd(compute)(c)

    return jax.jit(evaluate, compiler_options=list_compiler_options())


@compile_on_call
def _compute_hessian(
    c, weights, build: MuscleBuild, numbers: Numbers, points: OperatingPoints, ids: tuple[str, ...]
):
    def total(x):
        return jnp.vdot(weights, compute_outputs(x, build, numbers, points, ids))

    return jax.jacfwd(jax.jacfwd(total))(c)


@compile_on_call
def _compute_batch(c, build: MuscleBuild, numbers: Numbers, points: OperatingPoints, ids: tuple[str, ...]):
    return jax.vmap(lambda c, build, numbers: compute_outputs(c, build, numbers, points, ids))(
        c, build, numbers
    )


def _convert_to_arrays(tree: Any) -> Any:
    """Return the tree with float arrays: mixed floats and integers would compile twice."""
    return jax.tree.map(lambda x: np.asarray(x, float), tree)


def build_evaluation(
    build: MuscleBuild, numbers: Numbers, points: OperatingPoints, ids: tuple[str, ...]
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Return the function from coordinates, (5,), to the outputs and their Jacobian, (m,) and (m, 5)."""
    leaves, structure = jax.tree.flatten(_convert_to_arrays((build, dict(numbers), points)))
    packed = np.concatenate([leaf.ravel() for leaf in leaves])
    program = _compile_evaluation(structure, tuple(leaf.shape for leaf in leaves), ids)

    def evaluate(c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        y, jacobian = program(np.asarray(c, float), packed)
        return np.asarray(y), np.asarray(jacobian)

    return evaluate


def compute_hessian(
    c, weights, build: MuscleBuild, numbers: Numbers, points: OperatingPoints, ids: tuple[str, ...]
) -> np.ndarray:
    """Return the exact Hessian of a weighted sum of outputs, (5, 5), by forward differentiation."""
    return np.asarray(
        _compute_hessian(*_convert_to_arrays((c, weights, build, dict(numbers), points)), ids=ids)
    )


def evaluate_many(
    c: np.ndarray, build: MuscleBuild, numbers: Numbers, points: OperatingPoints, ids: tuple[str, ...]
) -> np.ndarray:
    """Return the outputs of many candidates, (k, m), in batches of fixed size, so that it compiles once.

    Args:
        c: (k, 5) coordinates.
        build, numbers: each field is a scalar or has shape (k,).
    """
    k = len(c)
    rows = -(-k // _BATCH_SIZE) * _BATCH_SIZE

    def pad(x):
        x = np.asarray(x, float)
        x = np.broadcast_to(x, (k, *x.shape[1:]))
        return np.concatenate([x, np.broadcast_to(x[-1:], (rows - k, *x.shape[1:]))])

    padded_inputs, points = jax.tree.map(pad, (c, build, dict(numbers))), _convert_to_arrays(points)
    batches = []
    for start in range(0, rows, _BATCH_SIZE):
        rows_now = slice(start, start + _BATCH_SIZE)
        c_now, build_now, numbers_now = jax.tree.map(lambda x, at=rows_now: x[at], padded_inputs)
        batches.append(_compute_batch(c_now, build_now, numbers_now, points, ids=ids))
    return np.concatenate([np.asarray(batch) for batch in batches])[:k]

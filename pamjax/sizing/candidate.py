"""A candidate muscle: what it would show at the places that a spec asks about, and its exact slopes.

    coordinates  c = (ln L0, θ0, ln D0, ln t, ln p)      of one muscle

    L0  rest length          m        B0 = L0 / sin θ0            thread length
    θ0  braid angle at rest  rad      N = B0 cos θ0 / (π D0)      turns
    D0  diameter at rest     m        of the threads' surface, and of the bladder's outside
    t   wall of the bladder  m
    p   working pressure     Pa

The muscle is a `Bench` of the model room: elastic threads, the rubber of the bladder, and whatever a
calibration names. A muscle that remembers (friction) is asked at the end of a pull from its rest length,
as it is when it lifts. Derived here beside the model:

    spacing   s = 4π L R / (n B)           of threads side by side; they fit where s is at least their width
    mesh      P (s − w) / (3.5 μ t λr)     how near the bladder is to bulging through: a half sphere of
              rubber over an opening a is stretched by √2 both ways, σ = 1.75 μ, its wall halved:
              P = 2 σ (t/2) / (a/2) = 3.5 μ t / a. Crude, and the safety factor on it is there for that
    air       [(p + pa) V1 − pa V0] / pa   at ambient pressure and temperature, V without the rubber

What it leaves out: fittings (mass, price), the tube's own ends, fatigue, creep, temperature, speed.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.model import braid, wall
from pamjax.model.balance import Status
from pamjax.model.bench import Bench
from pamjax.model.history import build_time_history
from pamjax.model.mechanism import AbstractLine, AbstractMemory, AbstractSlip, Past
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.registry import order_mechanisms

#: Places that one candidate is asked about; a spec with fewer repeats its first.
POINT_COUNT = 16
#: Ambient pressure, Pa.
AMBIENT_PRESSURE = 101325.0
#: Pressure at which a bladder bulges through, over shear modulus, wall and the inverse of the opening.
BULGE_FACTOR = 3.5

#: Candidates that are asked together.
BATCH_SIZE = 64

#: What is told of each place, and of the muscle as a whole.
POINT_OUTPUTS = ("force", "diameter", "tension", "used", "fit", "mesh", "strain", "burst")
MUSCLE_OUTPUTS = (
    "length", "angle", "rest_diameter", "wall", "pressure", "thread_length", "turns", "bore", "slenderness",
    "mass", "air", "cost", "unsolved", "widest", "bundle",
)  # fmt: skip

COORDINATES = ("rest_length", "braid_angle", "diameter", "wall", "pressure")


class MuscleBuild(NamedTuple):
    """What a candidate is made of, and how it is built. SI; every field a number.

    Attributes:
        threads: of both families together.
        thread_diameter: m; thread_area: m², solid; modulus, strength: Pa; density: kg/m³; price: of a kg.
        elastic: 1, or 0 for threads that do not stretch.
        shear, mooney, elongation: of the rubber, Pa, 1 and 1; rubber_density, rubber_price alike.
        parallel: muscles side by side; packing: of the circle around them, over the diameter of one.
        length_error, thread_error, turns_error, wall_error: how far it is built from its drawing, m, m, 1, m.
        force_error: what the model misses of the force, as a share of the blocked force at that pressure.
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
    force_error: Any = 0.0


class OperatingPoints(NamedTuple):
    """Where a candidate is asked: (k,) each.

    The length is L0 (1 − contraction) − shortening; the pressure is share × p + pressure.
    """

    contraction: Float[Array, " k"] | np.ndarray
    shortening: Float[Array, " k"] | np.ndarray
    supply_share: Float[Array, " k"] | np.ndarray
    pressure: Float[Array, " k"] | np.ndarray


#: Numbers of mechanisms by "id.field"; in a batch each an array.
Numbers = Mapping[str, Any]


def build_bench(c: Array | np.ndarray, build: MuscleBuild, ids: tuple[str, ...], numbers: Numbers) -> Bench:
    """The candidate as a bench without sensors.

    Args:
        c: coordinates.
        build: what of.
        ids: mechanisms beside stretching threads and rubber that a calibration hands on.
        numbers: theirs, "id.field"; "end_taper.radius" as a share of the radius at rest, "thread_crimp.load"
            as a share of n A in Pa.
    """
    rest_length, angle, outer_diameter, t = (
        jnp.exp(c[0]),
        c[1],
        jnp.exp(c[2]),
        jnp.exp(c[3]) + build.wall_error,
    )
    thread, turns = braid.from_angle(rest_length, outer_diameter, angle)
    area = build.threads * build.thread_area
    size = {
        "inner_diameter": outer_diameter - 2 * t,
        "thickness": t,
        "length": rest_length + build.length_error,
    }
    mechanisms_by_id = {
        "braid_elasticity": BraidElasticity(build.elastic / (area * build.modulus)),
        "bladder_elasticity": BladderElasticity(build.shear, build.mooney, **size),
    }
    scaled = {
        "end_taper.radius": outer_diameter / 2,
        "thread_crimp.load": area,
        "braid_locking.width": build.threads * build.thread_diameter,
    }
    for kind in order_mechanisms(ids):
        fields = {n.partition(".")[2]: v * scaled.get(n, 1.0) for n, v in numbers.items()
                  if n.partition(".")[0] == kind.id}  # fmt: skip
        mechanisms_by_id[kind.id] = kind(**fields)
    mechanisms = tuple(mechanisms_by_id[kind.id] for kind in order_mechanisms(mechanisms_by_id))
    return Bench(thread + build.thread_error, turns + build.turns_error, mechanisms)


def _solve_points(bench: Bench, pressure: Array, length: Array, rest_length: Array) -> tuple[Past, Array]:
    """The balance at each place; of a muscle that remembers, after a pull from its rest length."""
    if not any(bench.find_mechanisms(kind) for kind in (AbstractMemory, AbstractSlip, AbstractLine)):
        zero = jnp.zeros(())
        return jax.vmap(lambda p, true_length: bench.solve_instant(p, true_length, zero, (zero, zero)))(
            pressure, length
        )
    k = pressure.shape[0]
    pull_history = build_time_history(np.arange(2.0 * k), np.arange(2 * k) % 2 == 0, restart=True)
    lengths = jnp.stack([jnp.full(k, rest_length), length], axis=1).ravel()
    past, status = bench.compute_past(jnp.repeat(pressure, 2), lengths, pull_history)
    return jax.tree.map(lambda x: x[1::2], past), status[1::2]


def compute_outputs(
    c: Float[Array, " 5"],
    build: MuscleBuild,
    numbers: Numbers,
    points: OperatingPoints,
    ids: tuple[str, ...] = (),
) -> Float[Array, " m"]:
    """Everything that a requirement can be about, in the order of `names`.

    force (N, all muscles), diameter (outside, m), tension (one thread, N) and its share of the strength,
    fit (spacing over width), mesh (pressure over that of bulging), strain (of the rubber around, over its
    elongation at break), burst (pull over stiffness) at each place; then what `MUSCLE_OUTPUTS` names, SI.
    """
    rest_length, t, working_pressure = jnp.exp(c[0]), jnp.exp(c[3]), jnp.exp(c[4])
    bench = build_bench(c, build, ids, numbers).prepare()
    pressure = jnp.asarray(points.supply_share * working_pressure + points.pressure)
    length = jnp.asarray((rest_length + build.length_error) * (1 - points.contraction) - points.shortening)
    past, status = _solve_points(bench, pressure, length, rest_length + build.length_error)
    state, n = past.state, build.threads
    blocked_force = braid.gaylord_force(pressure, rest_length, bench.thread_length, bench.turns)
    force = build.parallel * (past.force + build.force_error * blocked_force)
    radius = jnp.maximum(state.radius, 1e-9)
    spacing = 4 * jnp.pi * state.length * radius / (n * state.thread)
    (rubber,) = bench.find_mechanisms(BladderElasticity)
    stretched = jax.vmap(lambda s: jnp.stack(wall.stretch(rubber, s)))(state)
    mesh = pressure * (spacing - build.thread_diameter) / (BULGE_FACTOR * build.shear * t * stretched[:, 2])
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
        (stretched[:, 1] - 1) / build.elongation,
        burst,
    )

    rubber_volume = wall.rubber_volume(rubber)
    rest_volume = braid.volume(rest_length, bench.thread_length, bench.turns) - rubber_volume
    filled_volume = (pressure + AMBIENT_PRESSURE) * (state.volume - rubber_volume)
    # The proof at rest (place 0) is no stroke.
    air = build.parallel * (jnp.max(filled_volume[1:]) - AMBIENT_PRESSURE * rest_volume) / AMBIENT_PRESSURE
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
    """Where an output stands."""
    if point is None:
        return len(POINT_OUTPUTS) * POINT_COUNT + MUSCLE_OUTPUTS.index(name)
    return POINT_OUTPUTS.index(name) * POINT_COUNT + point


@partial(jax.jit, static_argnames="ids")
def _evaluate_candidate(
    c, build: MuscleBuild, numbers: Numbers, points: OperatingPoints, ids: tuple[str, ...]
):
    return compute_outputs(c, build, numbers, points, ids), jax.jacfwd(compute_outputs)(
        c, build, numbers, points, ids
    )


@partial(jax.jit, static_argnames="ids")
def _compute_hessian(
    c, weights, build: MuscleBuild, numbers: Numbers, points: OperatingPoints, ids: tuple[str, ...]
):
    def total(x):
        return jnp.vdot(weights, compute_outputs(x, build, numbers, points, ids))

    return jax.jacfwd(jax.jacfwd(total))(c)


@partial(jax.jit, static_argnames="ids")
def _compute_batch(c, build: MuscleBuild, numbers: Numbers, points: OperatingPoints, ids: tuple[str, ...]):
    return jax.vmap(lambda c, build, numbers: compute_outputs(c, build, numbers, points, ids))(
        c, build, numbers
    )


def _convert_to_arrays(tree: Any) -> Any:
    """Every number as an array of one kind: a float here and an integer there would compile twice."""
    return jax.tree.map(lambda x: np.asarray(x, float), tree)


def evaluate_candidate(
    c, build: MuscleBuild, numbers: Numbers, points: OperatingPoints, ids: tuple[str, ...]
):
    """The outputs of one candidate and their Jacobian in its coordinates, (m,) and (m, 5)."""
    y, jacobian = _evaluate_candidate(*_convert_to_arrays((c, build, dict(numbers), points)), ids=ids)
    return np.asarray(y), np.asarray(jacobian)


def compute_hessian(
    c, weights, build: MuscleBuild, numbers: Numbers, points: OperatingPoints, ids: tuple[str, ...]
) -> np.ndarray:
    """Hessian of a weighted sum of outputs in the coordinates, (5, 5), exact: forward over forward."""
    return np.asarray(
        _compute_hessian(*_convert_to_arrays((c, weights, build, dict(numbers), points)), ids=ids)
    )


def evaluate_many(
    c: np.ndarray, build: MuscleBuild, numbers: Numbers, points: OperatingPoints, ids: tuple[str, ...]
) -> np.ndarray:
    """The outputs of many candidates, (k, m), in batches of one size: one program for any number.

    Args:
        c: (k, 5) coordinates.
        build, numbers: each field a number, or (k,).
    """
    k = len(c)
    rows = -(-k // BATCH_SIZE) * BATCH_SIZE

    def cut(x):
        x = np.asarray(x, float)
        x = np.broadcast_to(x, (k, *x.shape[1:]))
        return np.concatenate([x, np.broadcast_to(x[-1:], (rows - k, *x.shape[1:]))])

    filled, points = jax.tree.map(cut, (c, build, dict(numbers))), _convert_to_arrays(points)
    parts = [
        _compute_batch(
            *jax.tree.map(lambda x, start=start: x[start : start + BATCH_SIZE], filled), points, ids=ids
        )
        for start in range(0, rows, BATCH_SIZE)
    ]
    return np.concatenate([np.asarray(part) for part in parts])[:k]

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
from pamjax.model.history import history
from pamjax.model.mechanism import AbstractLine, AbstractMemory, AbstractSlip, Past
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.registry import in_order

#: Places that one candidate is asked about; a spec with fewer repeats its first.
PLACES = 16
#: Ambient pressure, Pa.
AMBIENT = 101325.0
#: Pressure at which a bladder bulges through, over shear modulus, wall and the inverse of the opening.
BULGE = 3.5

#: Candidates that are asked together.
BATCH = 64

#: What is told of each place, and of the muscle as a whole.
EACH = ("force", "diameter", "tension", "used", "fit", "mesh", "strain", "burst")
WHOLE = (
    "length", "angle", "rest_diameter", "wall", "pressure", "thread_length", "turns", "bore", "slenderness",
    "mass", "air", "cost", "unsolved", "widest", "bundle",
)  # fmt: skip

COORDINATES = ("rest_length", "braid_angle", "diameter", "wall", "pressure")


class Made(NamedTuple):
    """What a candidate is made of, and how it is built. SI; every field a number.

    Attributes:
        threads: of both families together.
        thread_diameter: m; thread_area: m², solid; modulus, strength: Pa; density: kg/m³; price: of a kg.
        elastic: 1, or 0 for threads that do not stretch.
        shear, mooney, elongation: of the rubber, Pa, 1 and 1; rubber_density, rubber_price alike.
        parallel: muscles side by side; packing: of the circle around them, over the diameter of one.
        off_length, off_thread, off_turns, off_wall: how far it is built from its drawing, m, m, 1, m.
        off_force: what the model misses of the force, as a share of the blocked force at that pressure.
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
    off_length: Any = 0.0
    off_thread: Any = 0.0
    off_turns: Any = 0.0
    off_wall: Any = 0.0
    off_force: Any = 0.0


class Places(NamedTuple):
    """Where a candidate is asked: (k,) each.

    The length is L0 (1 − contraction) − shortening; the pressure is share × p + pressure.
    """

    contraction: Float[Array, " k"] | np.ndarray
    shortening: Float[Array, " k"] | np.ndarray
    share: Float[Array, " k"] | np.ndarray
    pressure: Float[Array, " k"] | np.ndarray


#: Numbers of mechanisms by "id.field"; in a batch each an array.
Numbers = Mapping[str, Any]


def bench(c: Array | np.ndarray, made: Made, ids: tuple[str, ...], numbers: Numbers) -> Bench:
    """The candidate as a bench without sensors.

    Args:
        c: coordinates.
        made: what of.
        ids: mechanisms beside stretching threads and rubber that a calibration hands on.
        numbers: theirs, "id.field"; "end_taper.radius" as a share of the radius at rest, "thread_crimp.load"
            as a share of n A in Pa.
    """
    rest, angle, outside, t = jnp.exp(c[0]), c[1], jnp.exp(c[2]), jnp.exp(c[3]) + made.off_wall
    thread, turns = braid.from_angle(rest, outside, angle)
    area = made.threads * made.thread_area
    size = {"inner_diameter": outside - 2 * t, "thickness": t, "length": rest + made.off_length}
    own = {
        "braid_elasticity": BraidElasticity(made.elastic / (area * made.modulus)),
        "bladder_elasticity": BladderElasticity(made.shear, made.mooney, **size),
    }
    scaled = {
        "end_taper.radius": outside / 2,
        "thread_crimp.load": area,
        "braid_locking.width": made.threads * made.thread_diameter,
    }
    for kind in in_order(ids):
        fields = {n.partition(".")[2]: v * scaled.get(n, 1.0) for n, v in numbers.items()
                  if n.partition(".")[0] == kind.id}  # fmt: skip
        own[kind.id] = kind(**fields)
    mechanisms = tuple(own[kind.id] for kind in in_order(own))
    return Bench(thread + made.off_thread, turns + made.off_turns, mechanisms)


def _passed(one: Bench, pressure: Array, length: Array, rest: Array) -> tuple[Past, Array]:
    """The balance at each place; of a muscle that remembers, after a pull from its rest length."""
    if not any(one.of(kind) for kind in (AbstractMemory, AbstractSlip, AbstractLine)):
        zero = jnp.zeros(())
        return jax.vmap(lambda p, at: one.instant(p, at, zero, (zero, zero)))(pressure, length)
    k = pressure.shape[0]
    way = history(np.arange(2.0 * k), np.arange(2 * k) % 2 == 0, restart=True)
    lengths = jnp.stack([jnp.full(k, rest), length], axis=1).ravel()
    past, status = one.passed(jnp.repeat(pressure, 2), lengths, way)
    return jax.tree.map(lambda x: x[1::2], past), status[1::2]


def outputs(
    c: Float[Array, " 5"], made: Made, numbers: Numbers, places: Places, ids: tuple[str, ...] = ()
) -> Float[Array, " m"]:
    """Everything that a requirement can be about, in the order of `names`.

    force (N, all muscles), diameter (outside, m), tension (one thread, N) and its share of the strength,
    fit (spacing over width), mesh (pressure over that of bulging), strain (of the rubber around, over its
    elongation at break), burst (pull over stiffness) at each place; then what `WHOLE` names, SI.
    """
    rest, t, working = jnp.exp(c[0]), jnp.exp(c[3]), jnp.exp(c[4])
    one = bench(c, made, ids, numbers).prepared()
    pressure = jnp.asarray(places.share * working + places.pressure)
    length = jnp.asarray((rest + made.off_length) * (1 - places.contraction) - places.shortening)
    past, status = _passed(one, pressure, length, rest + made.off_length)
    state, n = past.state, made.threads
    blocked = braid.gaylord_force(pressure, rest, one.thread_length, one.turns)
    force = made.parallel * (past.force + made.off_force * blocked)
    radius = jnp.maximum(state.radius, 1e-9)
    spacing = 4 * jnp.pi * state.length * radius / (n * state.thread)
    (rubber,) = one.of(BladderElasticity)
    stretched = jax.vmap(lambda s: jnp.stack(wall.stretch(rubber, s)))(state)
    mesh = pressure * (spacing - made.thread_diameter) / (BULGE * made.shear * t * stretched[:, 2])
    pull = braid.hoop_pull(pressure, length, one.thread_length, one.turns)
    burst = pull / (n * made.thread_area * made.modulus)
    outside = 2 * radius + 2 * made.thread_diameter
    tension = past.load / n
    each = (
        force, outside, tension, tension / (made.thread_area * made.strength), spacing / made.thread_diameter,
        mesh, (stretched[:, 1] - 1) / made.elongation, burst,
    )  # fmt: skip

    solid = wall.rubber(rubber)
    empty = braid.volume(rest, one.thread_length, one.turns) - solid
    filled = (pressure + AMBIENT) * (state.volume - solid)
    # The proof at rest (place 0) is no stroke.
    air = made.parallel * (jnp.max(filled[1:]) - AMBIENT * empty) / AMBIENT
    yarn = n * one.thread_length * made.thread_area * made.density
    mass = made.parallel * (yarn + solid * made.rubber_density)
    cost = made.parallel * (yarn * made.price + solid * made.rubber_density * made.rubber_price)
    rest_diameter = jnp.exp(c[2])
    widest = jnp.max(outside[1:])
    whole = (
        rest, c[1], rest_diameter, t, working, one.thread_length, one.turns, 1 - 2 * t / rest_diameter,
        rest / widest, mass, air, cost, jnp.sum(status != int(Status.OK)).astype(float), widest,
        widest * made.packing,
    )  # fmt: skip
    return jnp.concatenate([jnp.stack(each).ravel(), jnp.stack(whole)])


def index(name: str, place: int | None = None) -> int:
    """Where an output stands."""
    if place is None:
        return len(EACH) * PLACES + WHOLE.index(name)
    return EACH.index(name) * PLACES + place


@partial(jax.jit, static_argnames="ids")
def _shown(c, made: Made, numbers: Numbers, places: Places, ids: tuple[str, ...]):
    return outputs(c, made, numbers, places, ids), jax.jacfwd(outputs)(c, made, numbers, places, ids)


@partial(jax.jit, static_argnames="ids")
def _curved(c, weights, made: Made, numbers: Numbers, places: Places, ids: tuple[str, ...]):
    def total(x):
        return jnp.vdot(weights, outputs(x, made, numbers, places, ids))

    return jax.jacfwd(jax.jacfwd(total))(c)


@partial(jax.jit, static_argnames="ids")
def _batch(c, made: Made, numbers: Numbers, places: Places, ids: tuple[str, ...]):
    return jax.vmap(lambda c, made, numbers: outputs(c, made, numbers, places, ids))(c, made, numbers)


def _arrays(tree: Any) -> Any:
    """Every number as an array of one kind: a float here and an integer there would compile twice."""
    return jax.tree.map(lambda x: np.asarray(x, float), tree)


def shown(c, made: Made, numbers: Numbers, places: Places, ids: tuple[str, ...]):
    """The outputs of one candidate and their Jacobian in its coordinates, (m,) and (m, 5)."""
    y, slope = _shown(*_arrays((c, made, dict(numbers), places)), ids=ids)
    return np.asarray(y), np.asarray(slope)


def curved(c, weights, made: Made, numbers: Numbers, places: Places, ids: tuple[str, ...]) -> np.ndarray:
    """Hessian of a weighted sum of outputs in the coordinates, (5, 5), exact: forward over forward."""
    return np.asarray(_curved(*_arrays((c, weights, made, dict(numbers), places)), ids=ids))


def many(c: np.ndarray, made: Made, numbers: Numbers, places: Places, ids: tuple[str, ...]) -> np.ndarray:
    """The outputs of many candidates, (k, m), in batches of one size: one program for any number.

    Args:
        c: (k, 5) coordinates.
        made, numbers: each field a number, or (k,).
    """
    k = len(c)
    rows = -(-k // BATCH) * BATCH

    def cut(x):
        x = np.asarray(x, float)
        x = np.broadcast_to(x, (k, *x.shape[1:]))
        return np.concatenate([x, np.broadcast_to(x[-1:], (rows - k, *x.shape[1:]))])

    filled, places = jax.tree.map(cut, (c, made, dict(numbers))), _arrays(places)
    parts = [
        _batch(*jax.tree.map(lambda x, at=at: x[at : at + BATCH], filled), places, ids=ids)
        for at in range(0, rows, BATCH)
    ]
    return np.concatenate([np.asarray(part) for part in parts])[:k]

"""Tapered ends: the net agrees with a net of rings, its table, and known values of the paper's muscle."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq, minimize

from pamjax.model.bench import record_bench
from pamjax.model.history import build_time_history
from pamjax.model.mechanisms import end_taper
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.mechanisms.end_taper import EndTaper
from pamjax.model.net import Net, solve_net
from pamjax.model.net_table import tabulate_net
from pamjax.model.state import Cylinder
from tests.agreement import ROUNDING, agree
from tests.model.mechanisms import triangle
from tests.model.mechanisms.typical import LENGTH, PRESSURE, THREAD, TURNS, bench

NU = 2 * np.pi * TURNS
REST = np.sqrt(THREAD**2 - LENGTH**2) / NU
CONTRACTION = np.array([0.001, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.37])
GAYLORD = PRESSURE * (3 * (LENGTH * (1 - CONTRACTION)) ** 2 - THREAD**2) / (4 * np.pi * TURNS**2)
STILL = build_time_history(None, np.arange(CONTRACTION.size) == 0)


@cache
def net_at(length, fitting):
    """Return force (N), mean and middle diameter (m) of the net at the paper's pressure."""
    if not hasattr(net_at, "compiled"):
        net_at.compiled = jax.jit(
            lambda at, rf: (
                jax.grad(lambda z: solve_net(z, THREAD, TURNS, rf).volume)(at),
                solve_net(at, THREAD, TURNS, rf),
            )
        )
    slope, net = net_at.compiled(length, fitting)
    return -PRESSURE * float(slope), 2 * float(net.mean_radius), 2 * float(net.mid_radius)


def rings(force, fitting, count):
    """Return length, mean and middle diameter (m) of half a net of rings under a force.

    The rings are pin-jointed and maximise P V + F L. The function uses nothing of `net.py`: no first
    integral, no quadrature, no long muscle.
    """
    part, turn, pull = THREAD / 2 / count, np.pi * TURNS / count, force / PRESSURE

    def rise(r):
        # The search may leave the range of a thread temporarily.
        return np.sqrt(np.maximum(part**2 - np.diff(r) ** 2 - r[:-1] * r[1:] * turn**2, 1e-30))

    def potential(scaled):
        r = np.concatenate([[fitting], 0.01 * scaled])
        low, high, step = r[:-1], r[1:], np.diff(r)
        up = rise(r)
        area = np.pi * (low**2 + low * high + high**2) / 3 + pull
        slope = np.zeros_like(r)
        slope[:-1] += np.pi * (2 * low + high) / 3 * up + area / up * (step - 0.5 * high * turn**2)
        slope[1:] += np.pi * (low + 2 * high) / 3 * up + area / up * (-step - 0.5 * low * turn**2)
        return -1e6 * np.sum(area * up), -1e4 * slope[1:]

    middle = np.sqrt((THREAD**2 / (2 * np.pi * TURNS**2) - pull) / (3 * np.pi))
    along = np.linspace(0, THREAD / 2, count + 1)[1:]
    start = middle + (fitting - middle) * np.exp(-2 * NU * along / THREAD)
    options = {"maxiter": 20000, "maxfun": 40000, "maxcor": 60, "ftol": 1e-16, "gtol": 1e-9}
    solution = minimize(potential, 100 * start, jac=True, method="L-BFGS-B", options=options)
    r = np.concatenate([[fitting], 0.01 * solution.x])
    up = rise(r)
    return np.array([2 * np.sum(up), np.sum((r[:-1] + r[1:]) * up) / np.sum(up), 2 * r[-1]])


@pytest.mark.parametrize("fitting", [REST, 0.0111])
@pytest.mark.parametrize(
    "contraction",
    [pytest.param(0.02, marks=pytest.mark.slow), pytest.param(0.05, marks=pytest.mark.slow), 0.15, 0.3],
)
def test_net_agrees_with_rings(contraction, fitting):
    force, *_ = net_at(LENGTH * (1 - contraction), fitting)
    coarse, fine = (rings(force, fitting, count) for count in (100, 200))
    length, mean, mid = fine + (fine - coarse) / 3
    again, of_mean, of_mid = net_at(float(length), fitting)
    assert abs(again - force) < 0.05, f"{again - force} N"
    assert abs(of_mean - mean) < 0.03e-3
    assert abs(of_mid - mid) < 0.03e-3


@cache
def shown(share, radius=REST):
    return record_bench(
        bench(EndTaper(share, radius)), np.full(8, PRESSURE), LENGTH * (1 - CONTRACTION), STILL
    )


@pytest.mark.slow
def test_force_and_diameters_of_the_paper_s_muscle():
    """−467 N at contraction 0.15. At 0.2 the middle is wider than a cylinder, and the mean is narrower."""
    tapered, cylinder = shown(1.0), shown(0.0)
    agree(cylinder.force, GAYLORD, 1e-12)
    assert abs(float(tapered.force[4] - cylinder.force[4]) + 466.6) < 0.1
    assert abs(1e3 * float(tapered.diameter[5]) - 46.15) < 0.05
    assert abs(2e3 * float(tapered.states.state.radius[5]) - 50.92) < 0.05
    assert np.all(np.diff(np.asarray(tapered.force)) < 0)


def test_fittings_of_the_muscle_diameter_have_no_effect_at_rest():
    force, mean, mid = net_at(LENGTH, REST)
    assert abs(force - PRESSURE * (3 * LENGTH**2 - THREAD**2) / (4 * np.pi * TURNS**2)) < 0.1
    assert abs(mean - 2 * REST) < 1e-8
    assert abs(mid - 2 * REST) < 1e-8


def test_force_is_linear_in_the_share():
    half, full, none = (np.asarray(shown(s).force) for s in (0.5, 1.0, 0.0))
    agree(half, 0.5 * (full + none), 1e-9, 1e3)


def test_narrow_fittings_reduce_the_force_at_rest():
    """Section D1: −194 N with fittings of 11.1 mm, and none with fittings of the muscle's diameter."""
    gaylord = PRESSURE * (3 * LENGTH**2 - THREAD**2) / (4 * np.pi * TURNS**2)
    # A radius printed to 0.1 mm has an error of at most 0.05 mm, which is 6 N here.
    for radius, lost, within in ((0.0111, -194.0, 6.0), (REST, 0.0, 0.1)):
        reading = record_bench(bench(EndTaper(1.0, radius)), np.full(8, PRESSURE), np.full(8, LENGTH), STILL)
        assert abs(float(reading.force[0]) - gaylord - lost) < within


@jax.jit
def slopes(length, thread):
    """Return ∂V/∂L at a thread length, m², from the table of a thread at rest and from the net itself."""
    table = tabulate_net(THREAD, TURNS, 0.0121)

    def by_table(z):
        return table(z, thread).volume + z * (thread**2 - z**2) / (4 * jnp.pi * TURNS**2)

    exact = jax.vmap(jax.grad(lambda z: solve_net(z, thread, TURNS, 0.0121).volume))(length)
    return jax.vmap(jax.grad(by_table))(length), exact


@pytest.mark.slow
@pytest.mark.parametrize("stretched", [1.0, 1.1, 1.3])
def test_table_agrees_with_the_net(stretched):
    thread = THREAD * stretched
    by_table, exact = slopes(jnp.linspace(0.6, 0.93, 12) * thread, thread)
    assert np.max(np.abs(by_table - exact)) * PRESSURE < 0.1


@pytest.mark.slow
def test_stretched_threads_use_the_correct_table_entry():
    compliance, fitting = 6e-6, 0.0121
    slopes_of = jax.jit(jax.grad(lambda z, b: solve_net(z, b, TURNS, fitting).volume, argnums=(0, 1)))

    def force(length):
        def pull(b):
            return PRESSURE * float(slopes_of(length, b)[1]) - (b / THREAD - 1) / compliance

        return -PRESSURE * float(slopes_of(length, brentq(pull, THREAD, 1.08 * THREAD))[0])

    soft = bench(BraidElasticity(compliance), EndTaper(1.0, fitting))
    length = LENGTH * (1 - CONTRACTION)
    forces = np.asarray(record_bench(soft, np.full(length.size, PRESSURE), length, STILL).force)
    agree(forces, [force(z) for z in length], 2e-4, 1e3)
    unstretched = np.asarray(
        record_bench(bench(EndTaper(1.0, fitting)), np.full(length.size, PRESSURE), length, STILL).force
    )
    assert np.max(np.abs(forces - unstretched)) > 20.0


@pytest.mark.slow
def test_table_continues_as_a_cylinder():
    length = THREAD * jnp.linspace(0.2, 1.01, 12)
    by_table, _ = slopes(length, THREAD)
    cylinder = (THREAD**2 - 3 * length**2) / (4 * np.pi * TURNS**2)
    assert np.all(np.isfinite(by_table))
    assert abs(float(by_table[0] - cylinder[0])) * PRESSURE < 1.0


def test_share_scales_the_difference_between_net_and_cylinder():
    # A quarter of a net with 8 ml less volume, 2 mm less mean radius, 1 mm wider middle: the mean diameter
    # decreases by twice a quarter of 2 mm.
    taper = EndTaper(0.25, 0.0121, table=lambda length, thread: Net(-8e-6, -2e-3, 1e-3))
    at = triangle.state(0.2)
    shape = taper.shape(at)
    agree(shape.volume - at.volume, -2e-6, ROUNDING, 1e-3)
    agree(shape.diameter - at.diameter, -1e-3, ROUNDING, 1e-1)
    agree(shape.radius - at.radius, 0.25e-3, ROUNDING, 1e-1)
    for name in ("length", "thread", "turns"):
        agree(getattr(shape, name), getattr(at, name), ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("prepare", [False, True])
def test_middle_is_wider_than_a_cylinder_and_mean_is_narrower(prepare):
    """Section D1, contraction 0.2: middle 51 mm, cylinder 48.5 mm, mean 46.2 mm."""
    taper, at = EndTaper(1.0, REST), Cylinder()(jnp.asarray(0.8 * LENGTH), THREAD, TURNS)

    def compute_shape(state):
        return (taper.prepare(THREAD, TURNS) if prepare else taper).shape(state)

    shape = jax.jit(compute_shape)(at)
    assert abs(2e3 * float(shape.radius) - 51.0) < 0.1
    assert abs(2e3 * float(at.radius) - 48.5) < 0.05
    assert abs(1e3 * float(shape.diameter) - 46.2) < 0.1
    assert 0.9 < float(shape.volume / at.volume) < 0.98


def test_net_depends_on_braid_and_fittings(monkeypatch):
    arguments = []
    monkeypatch.setattr(
        end_taper, "tabulate_net", lambda *of: arguments.append(of) or (lambda *at: Net(-8e-6, 0, 0))
    )
    EndTaper(1.0, 0.0121).prepare(0.3, 1.5)
    shape = EndTaper(1.0, 0.0121).shape(triangle.state(0.2))
    agree(
        np.array(arguments, float), [[0.3, 1.5, 0.0121], [triangle.THREAD, triangle.TURNS, 0.0121]], ROUNDING
    )
    agree(shape.volume - triangle.state(0.2).volume, -8e-6, ROUNDING, 1e-3)

"""What is commanded gives what was wanted, derivatives are those of differences, a table keeps its word."""

import subprocess
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.control.export import ExportedController, export, narrow_range
from pamjax.control.inverse import CommandLimit, Inverse, compute_static_force, inverse
from pamjax.control.neglected import compute_friction_half_loop
from pamjax.control.standalone import Controller
from pamjax.errors import BadInput
from pamjax.model.bench import Bench, record_bench
from pamjax.model.history import build_time_history
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.mechanisms.braid_friction import BraidFriction
from pamjax.model.mechanisms.rig_compliance import RigCompliance
from pamjax.model.muscle import Muscle, predict
from pamjax.model.thread import LinearThread
from tests.agreement import BY_DIFFERENCE, SOLVED, agree, difference

#: The paper's muscle with soft threads.
MUSCLE = Muscle(0.2357, 0.2512, 1.09, LinearThread(144 * 0.0858e-6 * 20e9))


@pytest.fixture(scope="module")
def of():
    return inverse(MUSCLE, (20e3, 650e3), (0.17, 0.2357))


@pytest.fixture(scope="module")
def states(of):
    """Random pressures and lengths, and the force of another program at them."""
    rng = np.random.default_rng(1)
    pressure, length = (rng.uniform(*ends, 500) for ends in (of.pressures, of.lengths))
    return pressure, length, np.asarray(predict(MUSCLE, jnp.asarray(pressure), jnp.asarray(length)).force)


def test_the_pressure_that_gives_a_force_is_the_one_that_gave_it(of, states):
    pressure, length, force = states
    found = of.pressure(force, length)
    assert np.all(np.asarray(found.status) == CommandLimit.OK)
    agree(found.value, pressure, SOLVED, scale=650e3)


def test_the_length_that_gives_a_force_is_the_one_that_gave_it(of, states):
    pressure, length, force = states
    found = of.length(force, pressure)
    assert np.all(np.asarray(found.status) == CommandLimit.OK)
    agree(found.value, length, SOLVED)


def test_derivatives_are_those_of_differences(of):
    force, length, pressure = 800.0, 0.2, 300e3
    by_pressure, by_length = of.pressure(force, length), of.length(force, pressure)
    agree(by_pressure.by_force, difference(lambda f: of.pressure(f, length).value, force, 1.0), BY_DIFFERENCE)
    agree(
        by_pressure.by_given, difference(lambda l: of.pressure(force, l).value, length, 1e-4), BY_DIFFERENCE
    )
    agree(by_length.by_force, difference(lambda f: of.length(f, pressure).value, force, 1.0), BY_DIFFERENCE)
    agree(by_length.by_given, difference(lambda p: of.length(force, p).value, pressure, 1e3), BY_DIFFERENCE)
    at = float(by_length.value[0])
    agree(by_length.stiffness, difference(lambda l: of.force(pressure, l)[0], at, 1e-4), BY_DIFFERENCE)
    # With the other sign they would not be.
    wrong = -np.asarray(by_pressure.by_given)
    with pytest.raises(AssertionError):
        agree(wrong, difference(lambda l: of.pressure(force, l).value, length, 1e-4), BY_DIFFERENCE)


def test_the_stiffness_has_the_slopes_of_its_differences(of):
    pressure, length = 300e3, 0.2
    got = of.stiffness_slopes(pressure, length)[0]
    by_pressure = difference(lambda p: of.force(p, length)[1][0], pressure, 1e3)
    by_length = difference(lambda l: of.force(pressure, l)[1][0], length, 1e-4)
    agree(got, [by_pressure, by_length], BY_DIFFERENCE)
    # That along a command, at one force, is another: the length moves with the pressure.
    along = difference(lambda p: of.length(800.0, p).stiffness[0], pressure, 1e3)
    with pytest.raises(AssertionError):
        agree(along, by_pressure, BY_DIFFERENCE)


def test_a_command_is_differentiable_in_the_muscles_own_numbers(of):
    def command(stiffness):
        soft = Muscle(0.2357, 0.2512, 1.09, LinearThread(stiffness))
        return Inverse(soft, of.pressures, of.lengths).pressure(800.0, 0.2).value[0]

    stiffness = 144 * 0.0858e-6 * 20e9
    slope = jax.grad(lambda s: _implicit(s))(stiffness)
    agree(slope, difference(command, stiffness, 1e-3 * stiffness), BY_DIFFERENCE)


def _implicit(stiffness):
    from pamjax.control.inverse import _find_root

    soft = Muscle(0.2357, 0.2512, 1.09, LinearThread(stiffness))
    low, high = jnp.asarray(20e3), jnp.asarray(650e3)
    return _find_root(lambda p: compute_static_force(soft, p, jnp.asarray(0.2))[0] - 800.0, low, high)


@pytest.mark.parametrize(
    ("force", "length", "limit", "value"),
    [
        (9000.0, 0.22, CommandLimit.TOO_STRONG, 650e3),
        (-50.0, 0.22, CommandLimit.TOO_WEAK, 20e3),
        (500.0, 0.25, CommandLimit.OUTSIDE, None),
        (500.0, 0.16, CommandLimit.OUTSIDE, None),
    ],
)
def test_what_cannot_be_met_says_which_limit_binds(of, force, length, limit, value):
    found = of.pressure(force, length)
    assert CommandLimit(int(found.status[0])) == limit
    assert np.isfinite(found.value[0])
    if value is not None:
        agree(found.value, [value], SOLVED)


def test_beyond_the_locking_angle_pressure_commands_nothing():
    below = inverse(MUSCLE, (20e3, 650e3), (0.13, 0.2357))
    # 3 L² < B²: more pressure pushes.
    assert CommandLimit(int(below.pressure(100.0, 0.14).status[0])) != CommandLimit.OK
    kept = narrow_range(below)
    assert 0.145 < kept.lengths[0] < 0.17
    with pytest.raises(BadInput, match="range of pressure and length in which pressure pulls"):
        narrow_range(inverse(MUSCLE, (20e3, 650e3), (0.13, 0.14)))


@pytest.fixture(scope="module")
def written(of, tmp_path_factory) -> ExportedController:
    return export(of, tmp_path_factory.mktemp("robot"), force_sd=doubt)


def doubt(pressure, length):
    """How surely a force is known, N; any smooth law will do."""
    return 1.0 + pressure / 1e5 * np.exp(-length / 0.1)


def worst(robot, of, seed):
    """Largest errors at other random points than those at which the stated ones were measured."""
    rng = np.random.default_rng(seed)
    pressure, length = (rng.uniform(*ends, 3000) for ends in (robot.pressures, robot.lengths))
    force, stiffness = of.force(pressure, length)
    by_pressure, by_length = of.stiffness_slopes(pressure, length).T
    true = {
        "force": force, "stiffness": stiffness, "pull": of.pull(pressure, length),
        "stiffness_by_pressure": by_pressure, "stiffness_by_length": by_length,
        "sd": doubt(pressure, length),
    }  # fmt: skip
    off = {name: np.abs(getattr(robot, name)(pressure, length) - values) for name, values in true.items()}
    off["pressure"] = np.abs(robot.pressure(force, length)[0] - pressure)
    held = np.clip(pressure, *robot.holding)
    off["length"] = np.abs(robot.length(of.force(held, length)[0], held)[0] - length)
    return {name: one.max() for name, one in off.items()}


def test_a_table_is_as_good_as_it_says_and_a_wrong_one_is_caught(written, of):
    robot = Controller(written.files[0])
    assert robot.error["pressure"] < 1e-3 * 650e3
    assert robot.error["length"] < 1e-5
    found = worst(robot, of, seed=99)
    assert set(found) == set(robot.error) - {"friction"}
    assert all(found[name] <= robot.error[name] for name in found)
    robot._table["pressure"] = robot._table["pressure"] + 2 * robot.error["pressure"] * (
        np.indices(robot._table["pressure"].shape).sum(axis=0) == 1
    )
    assert worst(robot, of, seed=99)["pressure"] > robot.error["pressure"]


def test_a_table_says_which_limit_binds(written):
    robot = Controller(written.files[0])
    _, status = robot.pressure(np.array([500.0, 1e5, -1e3, 500.0]), np.array([0.2, 0.2, 0.2, 0.3]))
    assert status.tolist() == [
        CommandLimit.OK,
        CommandLimit.TOO_STRONG,
        CommandLimit.TOO_WEAK,
        CommandLimit.OUTSIDE,
    ]


def test_a_table_knows_nothing_outside_and_says_so(written):
    robot = Controller(written.files[0])
    for force, length in ((np.nan, 0.2), (300.0, np.nan), (300.0, 0.3)):
        assert robot.pressure(force, length)[1] == CommandLimit.OUTSIDE
    assert np.isnan(robot.force(4e6, 0.2))
    assert np.isnan(robot.sd(400e3, 0.3))
    # The ends themselves are inside, whatever rounding made of them.
    assert np.isfinite(robot.force(robot.pressures[1] * (1 + 1e-15), robot.lengths[0]))
    assert f"{robot.lengths[0] * 1e3:.4g} mm to {robot.lengths[1] * 1e3:.4g} mm" in str(written)


def test_a_table_goes_down_to_no_pressure_where_the_muscle_does(tmp_path):
    of = inverse(MUSCLE, (0.0, 650e3), (0.17, 0.2357))
    robot = Controller(export(of, tmp_path).files[0])
    pressure, status = robot.pressure([0.0, 50.0], 0.21)
    assert status.tolist() == [0, 0]
    assert np.all(np.abs(pressure - of.pressure([0.0, 50.0], 0.21).value) <= robot.error["pressure"])
    # Without pressure no force holds a length.
    assert robot.length(0.0, 0.0)[1] == CommandLimit.OUTSIDE


def test_a_table_knows_how_its_answers_change(written, of):
    robot = Controller(written.files[0])
    pressures, lengths = of.pressure([300.0, 500.0], 0.2), of.length([300.0, 500.0], 400e3)
    agree(robot.pressure_slopes(pressures.value, 0.2), [pressures.by_force, pressures.by_given], 1e-4)
    agree(robot.length_slopes(400e3, lengths.value), [lengths.by_force, lengths.by_given], 1e-4)


@pytest.mark.slow
def test_a_table_holds_friction_and_nothing_of_the_rig(tmp_path):
    rubbed, rig = BraidFriction(coefficient=0.4), RigCompliance(1e-6)
    threads = BraidElasticity(4e-6)
    given, rigid = (Bench(0.2512, 1.09, (threads, rubbed, *m)) for m in ((rig,), ()))
    ends = (100e3, 600e3), (0.19, 0.2357)
    robot = Controller(export(inverse(given, *ends), tmp_path).files[0])
    at = np.array([200e3, 500e3]), np.array([0.2, 0.22])
    loops = compute_friction_half_loop(rigid, *at)
    assert np.all(loops > 1.0)
    assert np.all(np.abs(robot.friction(*at) - loops) < robot.error["friction"])
    assert robot.error["friction"] < 0.01 * loops.min()
    # Nobody said how surely this muscle is known.
    assert np.all(np.isnan(robot.sd(*at)))
    assert np.all(np.abs(robot.force(*at) - inverse(rigid, *ends).force(*at)[0]) < robot.error["force"])
    soft = record_bench(given, *at, build_time_history(None, np.ones(2, dtype=bool))).past.force
    assert np.all(robot.force(*at) - soft > 1.0)


@pytest.mark.slow
def test_a_muscle_held_open_by_its_rubber_is_exported_from_where_pressure_pulls():
    rubber = BladderElasticity(0.5e6, 0.0, 0.012, 0.0015, 0.18)
    stiff = Bench(0.1925, 1.6, (BraidElasticity(1e-6), rubber))
    of = inverse(stiff, (0.0, 400e3), (0.11, 0.18))
    kept = narrow_range(of)
    assert 0 < kept.pressures[0] <= 0.3 * 400e3
    assert kept.pressures[1] == 400e3
    assert np.ptp(kept.lengths) > 0.5 * np.ptp(of.lengths)


def test_the_table_needs_numpy_alone(written):
    program = (
        "import sys; sys.path.insert(0, '.'); from controller import Controller;"
        "c = Controller('controller.npz'); print(c.pressure(500.0, 0.2)[0]);"
        "assert not {'jax', 'pamjax', 'scipy'} & set(sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=written.files[0].parent,
        capture_output=True,
        text=True,
        check=True,
    )
    assert 20e3 < float(done.stdout) < 650e3


@pytest.mark.slow
def test_a_bench_is_inverted_without_its_memory():
    bench = Bench(0.2512, 1.09, (BraidElasticity(4e-6), BladderElasticity(3e5, 0.1, 0.019, 0.0016, 0.2357)))
    of = inverse(bench, (100e3, 650e3), (0.19, 0.23))
    force, _ = of.force([200e3, 500e3], [0.2, 0.22])
    agree(of.pressure(force, [0.2, 0.22]).value, [200e3, 500e3], SOLVED)


if __name__ == "__main__":
    # python -m tests.control.test_inverse FOLDER: microseconds a point of an exported table.
    robot = Controller(f"{sys.argv[1]}/controller.npz")
    rng = np.random.default_rng(0)
    many = 100_000
    length = rng.uniform(*robot.lengths, many)
    force = robot.force(rng.uniform(*robot.pressures, many), length)
    begin = time.perf_counter()
    robot.pressure(force, length)
    print(f"{1e6 * (time.perf_counter() - begin) / many:.2f} us a point")

"""Commands reach their target, derivatives agree with differences, and a table has its stated accuracy."""

import subprocess
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pamjax.control.export
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
    """Return random pressures and lengths, and their forces from another program."""
    rng = np.random.default_rng(1)
    pressure, length = (rng.uniform(*ends, 500) for ends in (of.pressures, of.lengths))
    return pressure, length, np.asarray(predict(MUSCLE, jnp.asarray(pressure), jnp.asarray(length)).force)


def test_pressure_for_a_force_is_recovered(of, states):
    pressure, length, force = states
    command = of.pressure(force, length)
    assert np.all(np.asarray(command.status) == CommandLimit.OK)
    agree(command.value, pressure, SOLVED, scale=650e3)


def test_length_for_a_force_is_recovered(of, states):
    pressure, length, force = states
    command = of.length(force, pressure)
    assert np.all(np.asarray(command.status) == CommandLimit.OK)
    agree(command.value, length, SOLVED)


def test_derivatives_agree_with_differences(of):
    force, length, pressure = 800.0, 0.2, 300e3
    by_pressure, by_length = of.pressure(force, length), of.length(force, pressure)
    agree(
        by_pressure.slope_by_force,
        difference(lambda f: of.pressure(f, length).value, force, 1.0),
        BY_DIFFERENCE,
    )
    agree(
        by_pressure.slope_by_given,
        difference(lambda l: of.pressure(force, l).value, length, 1e-4),
        BY_DIFFERENCE,
    )
    agree(
        by_length.slope_by_force,
        difference(lambda f: of.length(f, pressure).value, force, 1.0),
        BY_DIFFERENCE,
    )
    agree(
        by_length.slope_by_given,
        difference(lambda p: of.length(force, p).value, pressure, 1e3),
        BY_DIFFERENCE,
    )
    at = float(by_length.value[0])
    agree(by_length.stiffness, difference(lambda l: of.force(pressure, l)[0], at, 1e-4), BY_DIFFERENCE)
    # Negative control: the opposite sign.
    opposite = -np.asarray(by_pressure.slope_by_given)
    with pytest.raises(AssertionError):
        agree(opposite, difference(lambda l: of.pressure(force, l).value, length, 1e-4), BY_DIFFERENCE)


def test_slopes_of_the_stiffness_agree_with_differences(of):
    pressure, length = 300e3, 0.2
    got = of.stiffness_slopes(pressure, length)[0]
    by_pressure = difference(lambda p: of.force(p, length)[1][0], pressure, 1e3)
    by_length = difference(lambda l: of.force(pressure, l)[1][0], length, 1e-4)
    agree(got, [by_pressure, by_length], BY_DIFFERENCE)
    # Negative control: at constant force the length changes with the pressure.
    at_constant_force = difference(lambda p: of.length(800.0, p).stiffness[0], pressure, 1e3)
    with pytest.raises(AssertionError):
        agree(at_constant_force, by_pressure, BY_DIFFERENCE)


def test_command_is_differentiable_in_the_parameters(of):
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
def test_infeasible_command_reports_the_active_limit(of, force, length, limit, value):
    command = of.pressure(force, length)
    assert CommandLimit(int(command.status[0])) == limit
    assert np.isfinite(command.value[0])
    if value is not None:
        agree(command.value, [value], SOLVED)


def test_no_pressure_is_returned_beyond_the_locking_angle():
    wide = inverse(MUSCLE, (20e3, 650e3), (0.13, 0.2357))
    # 3 L² < B²: the force decreases with pressure.
    assert CommandLimit(int(wide.pressure(100.0, 0.14).status[0])) != CommandLimit.OK
    narrowed = narrow_range(wide)
    assert 0.145 < narrowed.lengths[0] < 0.17
    with pytest.raises(BadInput, match="range of pressure and length in which pressure increases the force"):
        narrow_range(inverse(MUSCLE, (20e3, 650e3), (0.13, 0.14)))


@pytest.fixture(scope="module")
def written(of, tmp_path_factory) -> ExportedController:
    return export(of, tmp_path_factory.mktemp("robot"), force_sd=force_sd)


def force_sd(pressure, length):
    """Return an artificial sd of the force, N: a smooth function."""
    return 1.0 + pressure / 1e5 * np.exp(-length / 0.1)


def measure_errors(robot, of, seed):
    """Return the largest errors at random points other than those of the stated accuracy."""
    rng = np.random.default_rng(seed)
    pressure, length = (rng.uniform(*ends, 3000) for ends in (robot.pressures, robot.lengths))
    force, stiffness = of.force(pressure, length)
    by_pressure, by_length = of.stiffness_slopes(pressure, length).T
    true = {
        "force": force, "stiffness": stiffness, "pull": of.pull(pressure, length),
        "stiffness_by_pressure": by_pressure, "stiffness_by_length": by_length,
        "sd": force_sd(pressure, length),
    }  # fmt: skip
    errors = {name: np.abs(getattr(robot, name)(pressure, length) - values) for name, values in true.items()}
    errors["pressure"] = np.abs(robot.pressure(force, length)[0] - pressure)
    holding_pressure = np.clip(pressure, *robot.holding)
    errors["length"] = np.abs(
        robot.length(of.force(holding_pressure, length)[0], holding_pressure)[0] - length
    )
    return {name: values.max() for name, values in errors.items()}


def test_table_has_its_stated_accuracy_and_a_wrong_table_is_detected(written, of):
    robot = Controller(written.files[0])
    assert robot.error["pressure"] < 1e-3 * 650e3
    assert robot.error["length"] < 1e-5
    errors = measure_errors(robot, of, seed=99)
    assert set(errors) == set(robot.error) - {"friction"}
    assert all(errors[name] <= robot.error[name] for name in errors)
    robot._table["pressure"] = robot._table["pressure"] + 2 * robot.error["pressure"] * (
        np.indices(robot._table["pressure"].shape).sum(axis=0) == 1
    )
    assert measure_errors(robot, of, seed=99)["pressure"] > robot.error["pressure"]


def test_table_reports_the_active_limit(written):
    robot = Controller(written.files[0])
    _, status = robot.pressure(np.array([500.0, 1e5, -1e3, 500.0]), np.array([0.2, 0.2, 0.2, 0.3]))
    assert status.tolist() == [
        CommandLimit.OK,
        CommandLimit.TOO_STRONG,
        CommandLimit.TOO_WEAK,
        CommandLimit.OUTSIDE,
    ]


def test_table_reports_points_outside_its_range(written):
    robot = Controller(written.files[0])
    for force, length in ((np.nan, 0.2), (300.0, np.nan), (300.0, 0.3)):
        assert robot.pressure(force, length)[1] == CommandLimit.OUTSIDE
    assert np.isnan(robot.force(4e6, 0.2))
    assert np.isnan(robot.sd(400e3, 0.3))
    # The ends are inside the range, also with a rounding error.
    assert np.isfinite(robot.force(robot.pressures[1] * (1 + 1e-15), robot.lengths[0]))
    assert f"{robot.lengths[0] * 1e3:.4g} mm to {robot.lengths[1] * 1e3:.4g} mm" in str(written)


def test_table_includes_zero_pressure(tmp_path):
    of = inverse(MUSCLE, (0.0, 650e3), (0.17, 0.2357))
    robot = Controller(export(of, tmp_path).files[0])
    pressure, status = robot.pressure([0.0, 50.0], 0.21)
    assert status.tolist() == [0, 0]
    assert np.all(np.abs(pressure - of.pressure([0.0, 50.0], 0.21).value) <= robot.error["pressure"])
    # Without pressure, the muscle has no stiffness, and no length can be commanded.
    assert robot.length(0.0, 0.0)[1] == CommandLimit.OUTSIDE


def test_table_has_derivatives(written, of):
    robot = Controller(written.files[0])
    pressures, lengths = of.pressure([300.0, 500.0], 0.2), of.length([300.0, 500.0], 400e3)
    agree(
        robot.pressure_slopes(pressures.value, 0.2),
        [pressures.slope_by_force, pressures.slope_by_given],
        1e-4,
    )
    agree(robot.length_slopes(400e3, lengths.value), [lengths.slope_by_force, lengths.slope_by_given], 1e-4)


@pytest.mark.slow
def test_table_includes_friction_but_no_rig_errors(tmp_path):
    friction, rig = BraidFriction(coefficient=0.4), RigCompliance(1e-6)
    threads = BraidElasticity(4e-6)
    compliant, rigid = (Bench(0.2512, 1.09, (threads, friction, *m)) for m in ((rig,), ()))
    ends = (100e3, 600e3), (0.19, 0.2357)
    robot = Controller(export(inverse(compliant, *ends), tmp_path).files[0])
    points = np.array([200e3, 500e3]), np.array([0.2, 0.22])
    loops = compute_friction_half_loop(rigid, *points)
    assert np.all(loops > 1.0)
    assert np.all(np.abs(robot.friction(*points) - loops) < robot.error["friction"])
    assert robot.error["friction"] < 0.01 * loops.min()
    # The sd of this muscle's force is unknown.
    assert np.all(np.isnan(robot.sd(*points)))
    assert np.all(
        np.abs(robot.force(*points) - inverse(rigid, *ends).force(*points)[0]) < robot.error["force"]
    )
    soft = record_bench(compliant, *points, build_time_history(None, np.ones(2, dtype=bool))).states.force
    assert np.all(robot.force(*points) - soft > 1.0)


@pytest.mark.slow
def test_table_starts_at_the_contact_pressure_of_the_bladder():
    rubber = BladderElasticity(0.5e6, 0.0, 0.012, 0.0015, 0.18)
    stiff = Bench(0.1925, 1.6, (BraidElasticity(1e-6), rubber))
    of = inverse(stiff, (0.0, 400e3), (0.11, 0.18))
    narrowed = narrow_range(of)
    assert 0 < narrowed.pressures[0] <= 0.3 * 400e3
    assert narrowed.pressures[1] == 400e3
    assert np.ptp(narrowed.lengths) > 0.5 * np.ptp(of.lengths)


def test_table_reader_needs_only_numpy(written):
    program = (
        "import sys; sys.path.insert(0, '.'); from controller import Controller;"
        "c = Controller('controller.npz'); print(c.pressure(500.0, 0.2)[0]);"
        "assert not {'jax', 'pamjax', 'scipy'} & set(sys.modules)"
    )
    process = subprocess.run(
        [sys.executable, "-c", program],
        cwd=written.files[0].parent,
        capture_output=True,
        text=True,
        check=True,
    )
    assert 20e3 < float(process.stdout) < 650e3


@pytest.mark.slow
def test_command_ignores_the_memory_of_a_bench():
    bench = Bench(0.2512, 1.09, (BraidElasticity(4e-6), BladderElasticity(3e5, 0.1, 0.019, 0.0016, 0.2357)))
    of = inverse(bench, (100e3, 650e3), (0.19, 0.23))
    force, _ = of.force([200e3, 500e3], [0.2, 0.22])
    agree(of.pressure(force, [0.2, 0.22]).value, [200e3, 500e3], SOLVED)


if __name__ == "__main__":
    # python -m tests.control.test_inverse FOLDER: microseconds per point of an exported table.
    robot = Controller(f"{sys.argv[1]}/controller.npz")
    rng = np.random.default_rng(0)
    point_count = 100_000
    length = rng.uniform(*robot.lengths, point_count)
    force = robot.force(rng.uniform(*robot.pressures, point_count), length)
    begin = time.perf_counter()
    robot.pressure(force, length)
    print(f"{1e6 * (time.perf_counter() - begin) / point_count:.2f} us per point")


def test_interrupted_export_leaves_the_folder_as_it_was(of, tmp_path, monkeypatch):
    """A trial table has no stated errors; a robot must never read one."""
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot" / "controller.npz").write_bytes(b"an older table")

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(pamjax.control.export, "_fit_rough", interrupt)
    with pytest.raises(KeyboardInterrupt):
        export(of, tmp_path / "robot")
    assert [path.name for path in (tmp_path / "robot").iterdir()] == ["controller.npz"]
    assert (tmp_path / "robot" / "controller.npz").read_bytes() == b"an older table"

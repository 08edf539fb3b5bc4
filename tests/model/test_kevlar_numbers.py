"""Effect of each mechanism on the article's muscle, compared with values computed outside this package.

The values are from a table of signatures, each for one typical amplitude: force residual from the ideal braid
at 138 and 689 kPa near rest and near free contraction; diameter residual at 689 kPa; width of the loop at a
contraction of 0.15. They were read from a simulated recording *near* these points. A printed value must
therefore be reached, within half its last digit, somewhere within `NEAR`. This matters most for the bladder:
near rest its force falls by 2 N per 0.001 of contraction. Differences are explained at their rows.
"""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.model.history import build_time_history
from pamjax.model.muscle import Muscle, predict
from pamjax.model.thread import RecruitmentToe
from pamjax.parameter import list_values, replace_values
from tests.agreement import ROUNDING, agree
from tests.model.mechanisms.typical import AREA, LENGTH, PRESSURE, THREAD, TURNS, full

pytestmark = pytest.mark.slow

LOW, HIGH = 137.895e3, PRESSURE

#: Contractions at which a column may have been read. Free contraction is that of a latex bladder: at the
#: low pressure it follows from the bladder of the table (−313 N), at the high one it is stated (0.356).
NEAR = {
    "rest": (0.0, 0.0035, 0.007),
    "middle": (0.146, 0.148, 0.150),
    LOW: (0.233, 0.2345, 0.236),
    HIGH: (0.354, 0.3555, 0.357),
}

LATEX = 0.4e6
SIZE = {"inner_diameter": 19.025e-3, "thickness": 1.5875e-3, "length": LENGTH}
WALLED = ("bladder_elasticity", "viscoelastic_creep", "mullins_softening")
MUSCLE = {f"{id}.{name}": value for id in WALLED for name, value in SIZE.items()}
RUBS = {"braid_friction.presliding": 1e-6}

#: Rows of the compiled program: three strokes to free contraction at 1 mm/s and 1 Hz, padded.
ROWS, CYCLES, SPEED = 512, 3, 1e-3


class Static(NamedTuple):
    """Force at (138, 689) kPa near rest and near free contraction, N; diameter at 689 kPa, mm.

    Texts as printed; empty if none is printed.
    """

    numbers: dict[str, float]
    rest: tuple[str, str]
    free: tuple[str, str]
    diameter: tuple[str, str, str] = ("0.00", "0.00", "0.00")


class Loop(NamedTuple):
    """Force of lengthening minus force of shortening, third cycle, contraction 0.15, N."""

    numbers: dict[str, float]
    width: tuple[str, str]


def elastic(modulus):
    return {"braid_elasticity.compliance": 1 / (AREA * modulus)}


STATIC = {
    "A1 elastic threads, 80 GPa": Static(
        elastic(80e9), ("-1.3", "-32.5"), ("-1.0", "-20.9"), ("1.16", "0.58", "0.33")
    ),
    # Amplitude 0.1 %; with this load 138 kPa gives 0.6 of the bedding-in, as printed (8.3 N per thread).
    "A3 bedding-in": Static(
        {"thread_slip.bedding": 1e-3, "thread_slip.load": 144 * 8.3},
        ("-0.7", "-5.8"), ("-0.7", "-5.8"), ("0.21", "0.12", "0.09"),
    ),
    "A4 slip of 0.3 mm": Static(
        {"thread_slip.step": 0.3e-3 / THREAD, "thread_slip.when": 0.0, "thread_slip.during": 0.05},
        ("-1.4", "-7.0"), ("-1.4", "-7.0"), ("0.25", "0.15", "0.11"),
    ),
    "B1 latex": Static({"bladder_elasticity.modulus": LATEX}, ("-210", "-210"), ("-313", "-270")),
    "B2 Mooney-Rivlin, C10 0.12 and C01 0.08 MPa": Static(
        {"bladder_elasticity.modulus": LATEX, "bladder_elasticity.mooney": 0.4},
        ("-208", "-208"), ("-227", "-187"),
    ),
    "B7 latex 5 % stiffer, as of 15 K": Static(
        {"bladder_elasticity.modulus": 0.05 * LATEX}, ("-10.5", "-10.5"), ("", "-14")
    ),
    "G1 rig of 5 kN/mm": Static(
        {"rig_compliance.compliance": 1 / 5e6}, ("-2.5", "-61"), ("-0.6", "-2.5"), ("0.74", "0.20", "0.01")
    ),
    "G2 force zero": Static({"force_offset.offset": 5.0}, ("5", "5"), ("5", "5")),
    "G3 force gain": Static({"force_gain.gain": 0.01}, ("9.5", "47"), ("3", "3")),
    # The gauge reads less than the true pressure: recorded minus true is negative.
    "G4 pressure zero": Static({"pressure_offset.offset": -3e3}, ("21", "21"), ("7", "1")),
    "G5 pressure gain": Static({"pressure_gain.gain": -0.01}, ("9.5", "47"), ("3", "3")),
    "G6 length zero": Static(
        {"length_offset.offset": -0.5e-3}, ("6.5", "33"), ("5", "21"), ("-0.40", "-0.19", "-0.11")
    ),
    "G7 turns": Static({"turns": TURNS + 0.005}, ("-9", "-43"), ("-3", "-3"), ("-0.12", "-0.20", "-0.27")),
}  # fmt: skip

LOOPS = {
    "E1 Coulomb": Loop({"braid_friction.constant": 5.0} | RUBS, ("10", "10")),
    "E2 pivots": Loop({"braid_friction.coefficient": 0.2} | RUBS, ("3.4", "17")),
    # The scale of friction on the area is not printed: the scale of the first loop must fit the second.
    "E3 area": Loop({"braid_friction.coefficient": 0.373, "braid_friction.girth": 1.0} | RUBS, ("3.8", "19")),
    # The reference pressure is 300 kPa here and 590 kPa in the table (E2): a constant factor.
    "E4 Hertz": Loop(
        {
            "braid_friction.coefficient": 0.2 * (590 / 300) ** (1 / 3),
            "braid_friction.exponent": 2 / 3,
        }
        | RUBS,
        ("5.5", "16"),
    ),
    "E6 viscous": Loop({"viscous_damping.coefficient": 2e3}, ("4", "4")),
    "F2 line": Loop({"pressure_drop.impedance": 2e3 / 1e-5}, ("6", "6")),
    "G8 late by half a second": Loop({"channel_lag.lag": 0.5}, ("-11", "-56")),
    # Two branches with 10 % of the latex modulus each.
    "B5 relaxation": Loop({"viscoelastic_creep.modulus": 0.2 * LATEX}, ("10", "13")),
}


@cache
def program():
    model = full()
    names, start = list(list_values(model)), {k: float(v) for k, v in list_values(model).items()} | MUSCLE

    @jax.jit
    def shown(x, pressure, length, past):
        reading = replace_values(model, dict(zip(names, x, strict=True)))(pressure, length, past)
        return jnp.stack([reading.force, reading.diameter])

    def run(numbers, pressure, length, time):
        n, first = len(length), np.arange(len(length)) == 0
        x = np.array(list((start | numbers).values()))
        filled = np.r_[length, np.full(ROWS - n, length[-1])]
        return np.asarray(
            shown(x, np.full(ROWS, pressure), filled, build_time_history(time, first, size=ROWS))
        )[:, :n]  # fmt: skip

    return run


@cache
def bare(pressure, times, lengths):
    return program()({}, pressure, np.array(lengths), np.array(times))


def residual(numbers, pressure, time, length):
    """Return the contribution of mechanisms to force, N, and diameter, mm."""
    less = bare(pressure, tuple(time), tuple(length))
    return (program()(numbers, pressure, length, time) - less) * np.array([[1.0], [1e3]])


def places(numbers, pressure):
    """Return force and diameter residuals near rest, in the middle, and near free contraction."""
    contraction = np.r_[NEAR["rest"], NEAR["middle"], NEAR[pressure]]
    return residual(numbers, pressure, np.arange(9.0), LENGTH * (1 - contraction)).reshape(2, 3, 3)


def strokes(pressure):
    """Return time, s, and length, m, of three strokes to free contraction and back."""
    half = LENGTH * NEAR[pressure][1]
    time = np.arange(0, 2 * half * CYCLES / SPEED, 1.0)
    travelled = SPEED * time % (2 * half)
    return time, LENGTH - np.minimum(travelled, 2 * half - travelled)


def branches(numbers, pressure, cycle=CYCLES):
    """Return contraction and force residual of shortening, and of lengthening, in one cycle."""
    time, length = strokes(pressure)
    force = residual(numbers, pressure, time, length)[0]
    which = np.floor(SPEED * time / (2 * LENGTH * NEAR[pressure][1])) == cycle - 1
    lengthens = np.diff(length, prepend=length[0] + 1) > 0
    contraction = 1 - length / LENGTH
    return [(contraction[rows], force[rows]) for rows in (which & ~lengthens, which & lengthens)]


def widths(numbers, pressure):
    (x, short), (y, long) = branches(numbers, pressure)
    at = np.array(NEAR["middle"])
    return np.interp(at, y[::-1], long[::-1]) - np.interp(at, x, short)


def assert_rounds(value, text):
    """Assert that the printed value is reached near its point, within half of its last digit."""
    if not text:
        return
    half = 0.5 * 10.0 ** -len(text.partition(".")[2])
    low, high = np.min(value) - half, np.max(value) + half
    slip = 1e-9 * half
    assert low - slip <= float(text) <= high + slip, f"got {value}, printed {text}"


@pytest.mark.parametrize("row", STATIC)
def test_residuals_of_force_and_diameter(row):
    row_values = STATIC[row]
    for k, pressure in enumerate((LOW, HIGH)):
        force, diameter = places(row_values.numbers, pressure)
        assert_rounds(force[0], row_values.rest[k])
        assert_rounds(force[2], row_values.free[k])
    for value, text in zip(diameter, row_values.diameter, strict=True):
        assert_rounds(value, text)


@pytest.mark.parametrize("row", LOOPS)
def test_widths_of_loops(row):
    row_values = LOOPS[row]
    for pressure, text in zip((LOW, HIGH), row_values.width, strict=True):
        assert_rounds(widths(row_values.numbers, pressure), text)


def test_wrong_values_are_rejected():
    """The comparison rejects threads that are 5 % too soft, and a loop that is 10 % too wide."""
    with pytest.raises(AssertionError):
        assert_rounds(places(elastic(76e9), HIGH)[0, 0], STATIC["A1 elastic threads, 80 GPa"].rest[1])
    with pytest.raises(AssertionError):
        assert_rounds(widths({"braid_friction.coefficient": 0.22} | RUBS, HIGH), LOOPS["E2 pivots"].width[1])


def test_a2_a_toe_of_recruited_filaments():
    """The toe of the table is a thread law; `thread_crimp` has another form and agrees within 10 %."""
    law = RecruitmentToe(AREA * 112e9, crimp=2e-3, spread=1.2e-3)
    toe = elastic(112e9) | {"thread_crimp.crimp": 2e-3, "thread_crimp.load": 500.0}
    printed = {LOW: ("-3.0", "-2.7"), HIGH: ("-35", "-27")}
    for pressure, (rest, free) in printed.items():
        length = LENGTH * (1 - np.r_[NEAR["rest"], NEAR["middle"], NEAR[pressure]])
        less = bare(pressure, tuple(np.arange(9.0)), tuple(length))
        reading = predict(Muscle(LENGTH, THREAD, TURNS, law), np.full(9, pressure), length)
        force, diameter = (
            np.asarray(reading.force) - less[0],
            1e3 * (np.asarray(reading.diameter) - less[1]),
        )
        assert_rounds(force[:3], rest)
        assert_rounds(force[6:], free)
        agree(places(toe, pressure)[0].ravel(), force, 0.1)
    for k, text in enumerate(("1.25", "0.66", "0.42")):
        assert_rounds(diameter[3 * k : 3 * k + 3], text)


def test_a6_four_broken_threads():
    """Only n E A matters, so 140 of 144 threads act like 144 softer ones: 1/35 more than A1.

    At 138 kPa and free contraction this is -0.028 N, for -0.98 N of A1; the table truncates it to -0.02.
    """
    for pressure, rest, free in ((LOW, "-0.04", ""), (HIGH, "-0.9", "-0.6")):
        whole = places(elastic(80e9), pressure)
        force, diameter = places(elastic(80e9 * 140 / 144), pressure) - whole
        assert_rounds(force[0], rest)
        assert_rounds(force[2], free)
        # To first order; the second order is a few percent of it.
        agree(force, whole[0] / 35, 0.03)
    assert_rounds(diameter[0], "0.03")


def test_b1_is_largest_at_a_tenth_of_contraction():
    contraction = np.linspace(0, 0.35, 36)
    force = residual(
        STATIC["B1 latex"].numbers, HIGH, np.arange(36.0), LENGTH * (1 - contraction)
    )[0]  # fmt: skip
    assert 0.09 < contraction[np.argmin(force)] < 0.15
    assert_rounds(force[10], "-346")


def test_b5_relaxes_towards_the_equilibrium_curve():
    """At free contraction −16 and −12 N in the third cycle; after the stroke the force at rest is too high.

    The table prints 14 to 45 N there without the time after the stroke; here 56 and 66 N at its end,
    decaying through this range.
    """
    numbers = LOOPS["B5 relaxation"].numbers
    for pressure, text in ((LOW, "-16"), (HIGH, "-12")):
        (x, short), _ = branches(numbers, pressure)
        assert_rounds(np.interp(NEAR[pressure], x, short), text)
    time, length = strokes(LOW)
    wait = np.arange(1, 150) * 5.0
    held = residual(
        numbers, LOW, np.r_[time, time[-1] + wait], np.r_[length, np.full(149, LENGTH)]
    )[0, time.size :]  # fmt: skip
    assert held[0] > 45
    assert held[-1] < 14
    assert np.all(np.diff(held) < 0)


def test_b6_softening_is_twice_the_printed_value():
    """A quarter of the latex stress at first stretch is a quarter of B1: 78 and 67 N, printed 39 and 34.

    At first stretch, the stretch *equals* its maximum. A step function of their difference is evaluated at
    its jump, where its value is commonly one half: an eighth of B1, as printed. In pamjax it is one there,
    because the rubber is as stiff as without earlier stretch. Later strokes have no softening, as printed.
    """
    numbers = {"mullins_softening.modulus": 0.25 * LATEX}
    for pressure, text in ((LOW, "-39"), (HIGH, "-34")):
        time, length = strokes(pressure)
        virgin = np.arange(time.size) <= LENGTH * NEAR[pressure][1] / SPEED
        force = residual(numbers, pressure, time, length)[0]
        rubber = residual(STATIC["B1 latex"].numbers, pressure, time, length)[0]
        agree(force[virgin], 0.25 * rubber[virgin], 1e-2, 1.0)
        assert_rounds(0.5 * force[virgin][-4:], text)
        assert abs(force[-1]) < 0.5


def test_b3_contact_is_lost_from_29_to_92_kpa():
    """Below this pressure a latex bladder carries all of it: the threads have no load, the braid no force."""
    for contractions, text in ((NEAR["rest"], "29"), ((0.356, 0.3575, 0.36), "92")):
        pressures = []
        for contraction in contractions:
            length = LENGTH * (1 - contraction)
            radius = np.sqrt(THREAD**2 - length**2) / (2 * np.pi * TURNS)
            inner, outer = 9.5125e-3, 11.1e-3
            bore = np.sqrt(radius**2 - (outer**2 - inner**2) * LENGTH / length)
            hoop, axial = (radius + bore) / (inner + outer), length / LENGTH
            # ∂W/∂R = P ∂V/∂R = 2πRLP, W = V μ/2 (λc² + ...), at a fixed length.
            rubber = np.pi * (outer**2 - inner**2) * LENGTH
            slope = (1 + radius / bore) / (inner + outer)
            stress = LATEX * (hoop - 1 / (axial**2 * hoop**3))
            pressures.append(rubber * stress * slope / (2 * np.pi * radius * length) / 1e3)
            numbers = STATIC["B1 latex"].numbers
            below, above = (
                program()(numbers, 1e3 * (pressures[-1] + d), np.array([length]), np.zeros(1))[1, 0]
                for d in (-1, 1)
            )
            agree(above, 2 * radius, ROUNDING)
            assert below < 2 * radius * (1 - 1e-4)
        assert_rounds(np.array(pressures), text)


def test_e1_and_e2_have_half_a_loop_at_the_ends():
    for name, pressure, rest, free in (
        ("E1 Coulomb", LOW, "5", "5"), ("E1 Coulomb", HIGH, "5", "5"),
        ("E2 pivots", LOW, "2", "1.5"), ("E2 pivots", HIGH, "10", "6"),
    ):  # fmt: skip
        (x, short), (y, long) = branches(LOOPS[name].numbers, pressure)
        assert_rounds(np.interp(NEAR["rest"], y[::-1], long[::-1]), rest)
        assert_rounds(-np.interp(NEAR[pressure], x, short), free)


def test_g8_is_28_newtons_at_mid_stroke():
    assert_rounds(widths(LOOPS["G8 late by half a second"].numbers, HIGH) / 2, "-28")

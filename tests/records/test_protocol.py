"""A protocol gives the samples of a bench; an invalid protocol is refused."""

import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.records.protocol import PAPER_PROTOCOL, Protocol, read_protocol
from pamjax.units import compute_si_factor
from tests.agreement import ROUNDING, agree

REST = 0.2
BOTH = ["1 bar", "300 kPa"]


def test_strokes_have_constant_speed_at_each_pressure():
    plan = Protocol(
        kind="strokes", pressures=BOTH, contractions=[0.1, 0.2], cycles=2, speed="2 mm/s", rate="2 Hz"
    )
    schedule = plan.build_schedule(REST)
    agree(np.diff(schedule.time), 0.5, 1e-9)
    agree(np.unique(schedule.pressure), [1e5, 3e5], ROUNDING)
    for pressure, contraction in zip((1e5, 3e5), (0.1, 0.2), strict=True):
        length = schedule.length[schedule.pressure == pressure]
        agree([length.max(), length.min()], [REST, REST * (1 - contraction)], ROUNDING)
        # 1 mm per sample, except in the last step before the reversal.
        assert np.max(np.abs(np.diff(length))) < 1e-3 + 1e-12
    assert set(schedule.cycle) == {1, 2}
    # Both directions of a stroke have the same lengths.
    one_cycle = schedule.length[(schedule.pressure == 1e5) & (schedule.cycle == 1)]
    np.testing.assert_array_equal(one_cycle, one_cycle[::-1])


def test_a_stroke_may_lengthen():
    schedule = Protocol(kind="strokes", pressures=["1 bar"], contractions=[-0.1]).build_schedule(REST)
    agree([schedule.length.min(), schedule.length.max()], [REST, 1.1 * REST], ROUNDING)


def test_ramps_fill_and_vent_at_each_length():
    plan = Protocol(kind="ramps", pressures=BOTH, contractions=[0.0, 0.1], cycles=3, duration="4 s")
    schedule = plan.build_schedule(REST)
    assert schedule.time.size == 2 * 2 * 3 * 9
    agree(np.unique(schedule.length), [0.9 * REST, REST], ROUNDING)
    for cycle, top in zip(range(1, 7), [1e5, 3e5] * 3, strict=True):
        pressure = schedule.pressure[schedule.cycle == cycle][:9]
        agree(pressure, top * np.array([0, 1, 2, 3, 4, 3, 2, 1, 0]) / 4, ROUNDING)


def test_holds_keep_each_pair_of_settings():
    plan = Protocol(kind="holds", pressures=BOTH, contractions=[0.0, 0.1, 0.2], duration="3 s")
    schedule = plan.build_schedule(REST)
    assert schedule.time.size == 2 * 3 * 3
    pairs = {(p, round(x, 9)) for p, x in zip(schedule.pressure, schedule.length, strict=True)}
    assert len(pairs) == 6


@pytest.mark.parametrize(("interval", "diameter_count"), [(0, 0), (1, 18), (5, 4)])
def test_diameter_is_recorded_at_its_own_interval(interval, diameter_count):
    plan = Protocol(
        kind="holds", pressures=BOTH, contractions=[0, 0.1, 0.2], duration="3 s", diameter_every=interval
    )
    assert plan.build_schedule(REST).diameter_measured.sum() == diameter_count


def test_protocol_of_the_paper_has_ten_isobars_of_three_strokes():
    schedule = PAPER_PROTOCOL.build_schedule(0.235744)
    agree(np.unique(schedule.pressure) / compute_si_factor("psi"), np.arange(10, 101, 10), 1e-9)
    assert set(schedule.cycle) == {1, 2, 3}
    assert 4000 < schedule.time.size < 6000


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pressures": ["3 mm"]}, "pressure"),
        ({"pressures": ["-3 bar"]}, r"`pressures` must be gauge pressures of at least 0; got -300 kPa"),
        (
            {"rate": "1e9 Hz"},
            "a protocol must have at most 1000000 samples; got .* Reduce `rate`, `duration` or `cycles`.",
        ),
        ({"kind": "holds", "rate": "1e6 Hz"}, "a protocol must have at most 1000000 samples; got 2e\\+07 in"),
        ({"rate": "0 Hz"}, "`rate` must be positive; got 0 in"),
        ({"speed": "-1 mm/s"}, "`speed` must be positive; got -0.001 in"),
        ({"contractions": [0.1, 0.2, 0.3]}, "one for each pressure; got 3 for 2 pressures in"),
    ],
)
def test_impossible_protocol_is_refused(change, message):
    plan = Protocol(**{"kind": "strokes", "pressures": BOTH, "contractions": [0.1]} | change)
    with pytest.raises(BadInput, match=message):
        plan.build_schedule(REST)


PROTOCOL = '[protocol]\nkind = "ramps"\npressures = ["3 bar"]\ncontractions = [0.0]\n'


def test_a_protocol_is_read_from_toml(tmp_path):
    (tmp_path / "plan.toml").write_text(PROTOCOL)
    assert read_protocol(tmp_path / "plan.toml") == Protocol(
        kind="ramps", pressures=["3 bar"], contractions=[0.0]
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "plan.toml does not exist. Check the path."),
        ("kind = ", "plan.toml must be TOML; got"),
        ("", r"a protocol must have one table, \[protocol\]; got none in plan.toml."),
        (
            PROTOCOL + "[more]\n",
            r"a protocol must have one table, \[protocol\]; got protocol, more in plan.toml.",
        ),
        (
            PROTOCOL.replace("pressures", "presures"),
            r"`pressures` must be stated \(plan.toml\). Write a list, as ",
        ),
        (
            PROTOCOL + "cycels = 2\n",
            r"unknown entry `cycels` in \[protocol\] \(plan.toml\). Did you mean `cycles`",
        ),
        (PROTOCOL + "rat = 2\n", r"unknown entry `rat` in \[protocol\] .* Did you mean `rate`"),
        (PROTOCOL.replace("kind", "# kind"), r"`kind` must be stated \(plan.toml\). Write \"strokes\", "),
        (
            PROTOCOL + "xyz = 2\n",
            r"unknown entry `xyz` in \[protocol\] .* Valid names are `kind`, `pressures`, ",
        ),
        (
            PROTOCOL.replace("ramps", "rams"),
            """`kind` must be "strokes", "ramps" or "holds"; got 'rams' in plan.toml.""",
        ),
        (PROTOCOL.replace("[0.0]", "[0.95]"), "`contractions` must be less than 0.9; got 0.95 in plan.toml."),
        (
            PROTOCOL.replace("[0.0]", "0.1"),
            "`contractions` must be a list in brackets; got 0.1 in plan.toml. Write",
        ),
        (PROTOCOL.replace("[0.0]", "[]"), r"`contractions` must not be empty; got \[\] in plan.toml."),
        (PROTOCOL + "cycles = 0\n", "`cycles` must be at least 1; got 0 in plan.toml."),
        (PROTOCOL + "cycles = 2.5\n", "`cycles` must be a whole number; got 2.5 in plan.toml."),
        (
            PROTOCOL + "rate = 2\n",
            """`rate` must be a text in quotes; got 2 in plan.toml. Write a number and its unit,""",
        ),
    ],
)
def test_invalid_protocol_file_is_refused(tmp_path, text, message):
    if text is not None:
        (tmp_path / "plan.toml").write_text(text)
    with pytest.raises(BadInput, match=message):
        read_protocol(tmp_path / "plan.toml")

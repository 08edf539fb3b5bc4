"""Shapes of the effects outside the library, on variables that are written down by hand."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax import DiagnosisSettings
from pamjax.diagnosis.templates.templates import TEMPLATES, TemplateContext, build_templates
from pamjax.records.blocks import Blocks
from tests.agreement import ROUNDING, agree

N = 241
TIME = np.linspace(0.0, 60.0, N)
LENGTH = 0.2 - 0.03 * (0.5 - 0.5 * np.cos(2 * np.pi * TIME / 30))
PREDICTION = np.stack([100 + 50 * np.sin(TIME), np.full(N, 0.02)])


@pytest.fixture
def context():
    """Return two strokes of 30 mm of a muscle of 200 mm, at two pressures, without misfit."""
    label = (TIME >= 30).astype(int)
    return TemplateContext(
        time=TIME,
        pressure=np.where(label == 0, 2e5, 4e5),
        length=LENGTH,
        rest_length=0.2,
        force=PREDICTION[0].copy(),
        blocks=Blocks(label, ("isobar 200 kPa", "isobar 400 kPa"), "isobars"),
        prediction=PREDICTION,
        by_pressure=np.stack([np.full(N, 2e-4), np.zeros(N)]),
        by_length=np.stack([np.full(N, 3e3), np.zeros(N)]),
        by_stiffness=np.stack([np.full(N, 5.0), np.full(N, 1e-4)]),
    )


def list_family(context, family):
    """Return the templates of one family, by description."""
    return {each.description: each for each in build_templates(context) if each.id == family}


def test_places_of_a_family_share_its_probability(context):
    templates = build_templates(context)
    for family in TEMPLATES.keys() - {"clipping", "stuck_length", "stuck_force", "interference"}:
        shares = [each.share for each in templates if each.id == family]
        assert len(shares) > 1
        agree(sum(shares), 1.0, ROUNDING)


def test_interference_has_one_of_all_frequencies(context):
    noise = np.random.default_rng(1).standard_normal(N)
    shares = {each.share for each in list_family(replace(context, force=noise), "interference").values()}
    assert shares == {1 / N}


def test_zero_step_is_one_newton_after_its_moment(context):
    steps = [
        each
        for each in build_templates(context)
        if each.id == "zero_step" and "force zero" in each.description
    ]
    assert len(steps) == 96
    for template in steps:
        force, diameter = template.columns[0]
        assert set(force) == {0.0, 1.0}
        assert np.all(np.diff(force) >= 0)
        assert f"{TIME[np.argmax(force)]:.1f} s" in template.description
        agree(diameter, 0.0, ROUNDING)


def test_a_break_of_threads_changes_force_and_diameter(context):
    shapes = [each.columns[0] for each in build_templates(context) if each.id == "thread_break"]
    after = shapes[-1][0] != 0
    assert any(np.array_equal(shape, after * context.by_stiffness) for shape in shapes)
    assert any(np.array_equal(shape[0], after * PREDICTION[0]) for shape in shapes)


def test_a_stop_is_proportional_to_the_motion_beyond_it(context):
    stops = list_family(context, "stop")
    contraction = 1 - LENGTH / 0.2
    # 24 places divide the 15 % of contraction into 25 parts.
    agree(stops["a stop beyond 6.0% contraction"].columns[0, 0], np.maximum(contraction - 0.06, 0), ROUNDING)
    agree(stops["a stop below 6.0% contraction"].columns[0, 0], np.maximum(0.06 - contraction, 0), ROUNDING)


def test_bending_at_low_pressure_has_half_its_force_at_the_named_pressure(context):
    bending = list_family(replace(context, pressure=np.where(TIME < 30, 1.5e5, 3e5)), "buckling")
    low = bending["bending beyond 6.0% contraction below 150 kPa"].columns[0, 0]
    beyond = np.maximum(1 - LENGTH / 0.2 - 0.06, 0)
    # Half of the highest pressure above it, at a transition of 0.08 of it, leaves 1 / (1 + exp(6.25)).
    agree(low, beyond * np.where(TIME < 30, 0.5, 0.00192673466), 1e-8)


def test_only_a_repeated_largest_reading_is_clipped(context):
    assert not list_family(context, "clipping")
    clipped = replace(context, force=np.minimum(PREDICTION[0], 130.0))
    (template,) = list_family(clipped, "clipping").values()
    agree(template.columns[0, 0], -np.maximum(PREDICTION[0] - 130, 0), ROUNDING)
    equal = int(np.count_nonzero(clipped.force == 130.0))
    stricter = replace(clipped, settings=DiagnosisSettings(min_clipped_readings=equal + 1))
    assert not list_family(stricter, "clipping")


def test_a_ripple_has_both_phases_of_its_period(context):
    # Six periods over the stroke of 30 mm.
    ripple = list_family(context, "length_ripple")["a force with a period of 5 mm in length"]
    phase = 2 * np.pi * (LENGTH - LENGTH.min()) / 0.005
    agree(ripple.columns[:, 0], [np.cos(phase), np.sin(phase)], 1e-9, 1.0)


def test_a_few_fixed_lengths_do_not_resolve_a_ripple(context):
    # Four lengths 10 mm apart: each period of the family, up to 7.5 mm, is shorter than 20 mm.
    levels = replace(context, length=0.2 - 0.01 * (np.arange(N) // (N // 4 + 1)))
    assert not list_family(levels, "length_ripple")
    # Sixteen lengths 2 mm apart resolve periods above 4 mm.
    finer = replace(context, length=0.2 - 0.002 * (np.arange(N) // (N // 16 + 1)))
    periods = {float(says.split()[6]) for says in list_family(finer, "length_ripple")}
    assert min(periods) > 4.0
    assert max(periods) == pytest.approx(7.5)


def test_interference_finds_the_frequency_of_the_residual(context):
    disturbed = replace(context, force=PREDICTION[0] + np.sin(2 * np.pi * TIME / 3.0))
    says = next(iter(list_family(disturbed, "interference")))
    assert says == "a disturbance with a period of 3 s in force"


def test_one_block_differs_by_a_force_or_a_length(context):
    blocks = list_family(context, "single_block")
    second = (TIME >= 30).astype(float)
    agree(blocks["isobar 400 kPa alone, with another force zero"].columns[0, 0], second, ROUNDING)
    agree(blocks["isobar 400 kPa alone, with another length"].columns[0, 0], 3e3 * second, ROUNDING)


def test_a_stuck_length_is_replaced_by_a_line_between_its_neighbours(context):
    assert not list_family(context, "stuck_length")
    stuck = LENGTH.copy()
    stuck[20:40] = LENGTH[20]
    (template,) = list_family(replace(context, length=stuck), "stuck_length").values()
    line = np.interp(TIME, TIME[[20, 40]], LENGTH[[20, 40]])
    expected = np.where(np.isin(np.arange(N), range(21, 40)), 3e3 * (line - LENGTH[20]), 0.0)
    agree(template.columns[0, 0], expected, 1e-9, 3e3 * 0.03)
    stricter = replace(context, length=stuck, settings=DiagnosisSettings(min_stuck_readings=21))
    assert not list_family(stricter, "stuck_length")


def test_without_time_no_course_in_time_is_tried(context):
    families = {each.id for each in build_templates(replace(context, time=None))}
    assert not families & {"zero_step", "thread_break", "interference"}
    assert "stop" in families


def test_finer_places_are_between_the_neighbours_and_divide_the_share(context):
    stops = [each for each in build_templates(context) if each.description.startswith("a stop beyond")]
    coarse = stops[9]
    finer = [each for each in coarse.refine() if each.description.startswith("a stop beyond")]
    touching = [np.count_nonzero(each.columns[0, 0]) for each in (stops[8], *finer, stops[10])]
    # The further the place, the fewer rows touch the stop.
    assert touching == sorted(touching, reverse=True)
    assert touching[0] > touching[-1]
    agree(sum(each.share for each in finer), coarse.share, ROUNDING)
    # Places can be refined again.
    assert len(finer[3].refine()) == 2 * len(finer)


def test_finer_places_reach_the_ends(context):
    stops = [each for each in build_templates(context) if each.description.startswith("a stop beyond")]
    coarse = np.max(1 - LENGTH / 0.2) / 25
    for k, end in ((0, 0.0), (-1, 25 * coarse)):
        places = [
            float(each.description.split()[3].rstrip("%")) / 100
            for each in stops[k].refine()
            if each.description.startswith("a stop beyond")
        ]
        assert min(abs(place - end) for place in places) < 0.2 * coarse


def test_finer_moments_are_whole_rows(context):
    later = replace(context, **_repeat_rows(context, 9))
    breaks = [each for each in build_templates(later) if each.id == "thread_break"]
    first_rows = {int(np.argmax(each.columns[0, 0] != 0)) for each in breaks[30].refine()}
    low, high = (int(np.argmax(breaks[k].columns[0, 0] != 0)) for k in (27, 33))
    assert first_rows == set(first_rows) & set(range(low + 1, high))
    assert len(first_rows) == 14


def _repeat_rows(context, times):
    """Return the arrays of a context, each row repeated."""
    names = ("time", "pressure", "length", "force", "prediction", "by_pressure", "by_length", "by_stiffness")
    arrays = {name: np.repeat(getattr(context, name), times, axis=-1) for name in names}
    return arrays | {"blocks": replace(context.blocks, label=np.repeat(context.blocks.label, times))}


def test_a_stuck_force_keeps_the_prediction_of_its_first_row(context):
    stuck = PREDICTION[0].copy()
    stuck[20:40] = stuck[20]
    assert stuck[20] < stuck.max()
    (template,) = list_family(replace(context, force=stuck), "stuck_force").values()
    inside = np.isin(np.arange(N), range(21, 40))
    agree(template.columns[0, 0], np.where(inside, PREDICTION[0][20] - PREDICTION[0], 0.0), ROUNDING)
    assert not list_family(context, "stuck_force")

"""Drawn recordings conceal what was drawn, with the drawn size, and repeat by their seed."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pamjax.benchmark.other_forms.case_files import build_bank_case, write_bank
from pamjax.benchmark.other_forms.draw import (
    BANK_KINDS,
    MAX_MISSTATED_RATIO,
    MIN_MISSTATED_RATIO,
    _build_plan,
    _draw_braid,
    _get_prior_sd,
    draw_bank_recording,
)
from pamjax.benchmark.other_forms.library import OTHER_FORMS
from pamjax.benchmark.other_forms.outside import OUTSIDE_FAMILIES
from pamjax.benchmark.other_forms.scales import build_scales
from pamjax.benchmark.other_forms.size import BaselineFit, compute_size, scale_to_size
from pamjax.benchmark.setups import build_reference_setup, draw_setup
from pamjax.diagnosis.templates.templates import TEMPLATES
from pamjax.model.registry import EXCLUSIVE_PAIRS, MECHANISMS
from pamjax.records.blocks import find_blocks
from pamjax.records.case import read_case

FORMS = {
    f"{id}-{k}": form for group in (OTHER_FORMS, {id: (f,) for id, f in OUTSIDE_FAMILIES.items()})
    for id, forms in group.items() for k, form in enumerate(forms)
}  # fmt: skip


def build_bench(seed=2, law="inelastic"):
    """Return a muscle with strokes, its scales, and its baseline."""
    rng = np.random.default_rng(seed)
    setup = draw_setup(rng, rows=300, law=law)
    plan, braid = _build_plan(setup.plan), _draw_braid(setup.muscle_toml, rng)
    scales = build_scales(braid, plan, find_blocks(setup.plan).label, rng)
    assert not scales.is_isometric
    rows = np.isfinite(setup.plan.diameter)
    return scales, BaselineFit(braid, plan, setup.muscle_toml.sensors, _get_prior_sd(setup.muscle_toml), rows)


@pytest.fixture(scope="module")
def bench():
    return build_bench()


def draw(kind, seed, correlation=0.5):
    return draw_bank_recording(kind, correlation, np.random.default_rng(seed))


def test_every_mechanism_of_the_library_has_a_form():
    assert set(OTHER_FORMS) == {kind.id for kind in MECHANISMS}
    # Families without a template show what the diagnosis says of an effect that nobody described.
    assert len(OUTSIDE_FAMILIES.keys() - {**TEMPLATES, "stuck": 0, "ripple": 0}) == 3


@pytest.mark.parametrize("name", FORMS)
def test_form_is_neutral_at_zero_and_reaches_its_size(name, bench):
    scales, baseline = bench
    without, amplitudes = baseline.simulate([]), []
    for seed in range(8):
        form = FORMS[name](np.random.default_rng(seed), scales)
        neutral = baseline.simulate([form.build(0.0)])
        for channel in ("pressure", "length", "force", "diameter"):
            np.testing.assert_allclose(getattr(neutral, channel), getattr(without, channel), rtol=1e-9)

        def measure(effect):
            return compute_size(baseline.compute_effect(baseline.simulate([effect]), without))

        amplitude = scale_to_size(form, 1.0, 6.0, measure)
        # Some shapes cannot reach the size: the refitted baseline absorbs them.
        if amplitude is not None:
            assert 0 < amplitude <= form.limit
            assert measure(form.build(amplitude)) == pytest.approx(6.0, rel=0.15)
            amplitudes.append(amplitude)
            break
    assert amplitudes


@pytest.mark.parametrize("id", ["pressure_drop", "viscous_damping"])
def test_effect_of_motion_has_no_size_at_fixed_lengths(id, bench):
    """Rounding gives fixed lengths a flow of about 1e-21 m³/s."""
    scales = replace(bench[0], speed=0.0, flow=1e-21)
    for draw_form in OTHER_FORMS[id]:
        assert draw_form(np.random.default_rng(0), bench[0]).limit > 100.0
        assert draw_form(np.random.default_rng(0), scales).limit < 1e-9


def test_change_that_the_baseline_absorbs_has_no_size(bench):
    """Negative control: a longer thread is no effect, because the baseline is refitted."""
    _, baseline = bench
    longer = replace(baseline.braid, thread=baseline.braid.thread + baseline.prior_sd[0])
    readings = replace(baseline, braid=longer).simulate([])
    size = compute_size(baseline.compute_effect(readings, baseline.simulate([])))
    shift = (readings.force - baseline.simulate([]).force) / baseline.compute_noise(
        readings.pressure, readings.length
    )[0]
    assert np.sqrt(np.mean(shift**2)) > 1.0
    assert size < 0.1


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("kind", BANK_KINDS)
def test_recording_conceals_its_kind_in_the_drawn_size(kind, seed):
    recording = draw(kind, seed)
    mechanisms = [e.id for e in recording.effects if e.in_library]
    count, has_outside = BANK_KINDS[kind]
    assert len(mechanisms) == len(set(mechanisms)) == count
    assert len(recording.effects) == count + has_outside
    assert not any(pair <= set(mechanisms) for pair in EXCLUSIVE_PAIRS)
    for effect in recording.effects:
        assert effect.size == pytest.approx(effect.target, rel=0.15)
        assert 2.0 <= effect.target <= 30.0
    assert np.nanmin(recording.exact.force) > -1.0 or mechanisms


def test_same_seed_gives_the_same_recording_and_another_seed_another_one():
    first, again, other = draw("pair", 5), draw("pair", 5), draw("pair", 6)
    assert build_bank_case(first, "x").checksum == build_bank_case(again, "x").checksum
    assert first.effects == again.effects
    assert build_bank_case(first, "x").checksum != build_bank_case(other, "x").checksum


def test_third_of_the_recordings_has_misstated_sensors():
    setup = build_reference_setup()
    setup = replace(setup, plan=setup.plan.select(np.arange(setup.plan.n) % 12 == 0))
    drawn = [draw_bank_recording("nothing", 0.0, np.random.default_rng(k), setup) for k in range(120)]
    ratios = [r.sensor_ratios for r in drawn]
    assert 25 < sum(r.misstated for r in drawn) < 56
    for recording, ratio in zip(drawn, ratios, strict=True):
        assert (set(ratio.values()) == {1.0}) == (not recording.misstated)
        assert all(MIN_MISSTATED_RATIO <= value <= MAX_MISSTATED_RATIO for value in ratio.values())


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_noise_has_the_true_sd_and_correlation(correlation):
    recording = next(r for k in range(99) if (r := draw("nothing", k, correlation)).misstated)
    noise = (recording.recording.force - recording.exact.force) / recording.sensors.force
    # 1700 samples with an integrated correlation of up to 19.
    assert np.std(noise) == pytest.approx(1.0, abs=0.35 if correlation else 0.1)
    assert np.mean(noise[1:] * noise[:-1]) / np.mean(noise**2) == pytest.approx(correlation, abs=0.12)


def test_key_and_folders_have_what_was_injected(tmp_path):
    drawn = [draw(kind, 3) for kind in ("mixed", "nothing")]
    key = json.loads(write_bank(tmp_path / "bank", drawn, [{"number": 3}, {"number": 4}]).read_text())
    assert list(key["cases"]) == ["r-001", "r-002"]
    mixed, nothing = key["cases"].values()
    assert nothing["effects"] == []
    assert not nothing["unexplained"]
    assert (mixed["kind"], mixed["number"], mixed["unexplained"]) == ("mixed", 3, True)
    assert [e["id"] for e in mixed["effects"]] == [e.id for e in drawn[0].effects]
    assert [e["size"] for e in mixed["effects"]] == [e.size for e in drawn[0].effects]
    case = read_case(tmp_path / "bank" / "r-001")
    # The folder gives the recording that `pamjax prove` diagnoses, and nothing in it names an effect.
    assert case.checksum == build_bank_case(drawn[0], "r-001").checksum
    assert case.muscle_toml.sensors.force == pytest.approx(drawn[0].muscle_toml.sensors.force, rel=1e-6)
    assert not any(effect.id in case.text for effect in drawn[0].effects)

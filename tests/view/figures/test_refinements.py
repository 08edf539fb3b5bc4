"""The figure of refinements: every curve exists, and the first is the default of its mechanism."""

import numpy as np
import pytest

from pamjax.model.registry import MECHANISMS
from pamjax.parameter import list_field_meanings
from pamjax.view.figures import refinements
from tests.agreement import SOLVED, agree

CURVES = (
    *("drifts", "rubbers", "lockings", "contacts", "loops", "strengths", "pressure_loops"),
    *("softenings", "relaxations", "pressure_drops", "end_losses", "beddings", "coats", "dampings"),
)

#: Refinements that set the scale or the phase of another one.
SCALES = {"warmup_time", "period", "swing_cosine", "weakening_speed", "cyclic_energy"}


def list_refinements(kind):
    """Return the names of the refinements of a mechanism."""
    return [n for n, m in list_field_meanings(kind).items() if m.is_refinement and n not in SCALES]


@pytest.mark.slow
def test_every_refinement_has_a_curve(monkeypatch):
    drawn = set()

    def record(kind):
        def build(*values, **named_values):
            mechanism, defaults = kind(*values, **named_values), kind()
            drawn.update(
                (kind.id, name)
                for name in list_refinements(kind)
                if getattr(mechanism, name) != getattr(defaults, name)
            )
            return mechanism

        return build

    for kind in MECHANISMS:
        monkeypatch.setattr(refinements, kind.__name__, record(kind), raising=False)
    for name in CURVES:
        getattr(refinements, f"compute_{name}")()
    assert drawn == {(kind.id, name) for kind in MECHANISMS for name in list_refinements(kind)}
    assert ("braid_locking", "stretch") in drawn


def test_stretched_threads_touch_later():
    first, rounded, stretched = (force for _, force in refinements.compute_contacts().values())
    x, unstretched = refinements.compute_lockings()["exponent 1"]
    # Without `stretch`, the strain changes only the thread length b in the force: its third power and cos θ.
    agree(first, unstretched, 0.05, np.max(unstretched))
    assert np.all(stretched < first + 1e-6)
    starts = [x[np.argmax(force < 0.02 * np.max(first))] for force in (first, rounded, stretched)]
    assert starts[2] < starts[0] - 1 < starts[1] - 2


def test_a_coat_becomes_thinner_in_proportion_to_the_diameter():
    (_, bare), _, (contraction, coat) = refinements.compute_coats().values()
    agree(bare, 3.0, SOLVED)
    length = refinements.DEMO_REST_LENGTH * (1 - contraction / 100)
    diameter = np.sqrt(refinements.DEMO_THREAD_LENGTH**2 - length**2)
    agree(coat * diameter / (coat * diameter)[0], 1.0, SOLVED)


@pytest.mark.parametrize("name", CURVES)
def test_refined_forms_differ_visibly_from_the_first(name):
    curves = list(getattr(refinements, f"compute_{name}")().values())
    assert 2 <= len(curves) <= len(refinements.LINES)
    x, first = curves[0]
    for other_x, other in curves[1:]:
        agree(other_x, x, SOLVED, 1.0)
        assert np.all(np.isfinite(other))
        assert np.max(np.abs(other - first)) > 0.04 * np.ptp(first)


def test_drifts_reach_their_amplitudes():
    drifts = {name: zero for name, (_, zero) in refinements.compute_drifts().items()}
    # After an hour: 10 N by a slope and by a root, 10 N less e^(-6) by a warm-up, two periods of the swing.
    agree([drifts[n][-1] for n in ("rate", "root")], 10.0, SOLVED)
    agree(drifts["warmup"][-1], 10.0 * (1 - np.exp(-6.0)), SOLVED)
    agree(np.max(drifts["swing"]), 3.0, 1e-3)


def test_loops_are_shifted_by_asymmetry_and_narrowed_by_speed():
    loops = {name: force for name, (_, force) in refinements.compute_loops().items()}
    even, shifted, fast = loops.values()
    assert np.max(shifted) > 1.2 * np.max(even)
    assert np.min(shifted) > 0.8 * np.min(even)
    assert np.median(np.abs(fast)) < 0.8 * np.median(np.abs(even))


def test_stretch_alone_moves_friction_at_a_fixed_length():
    sliding, still = (force for _, force in refinements.compute_pressure_loops().values())
    # Shorter threads at falling pressure act as lengthening.
    assert np.min(sliding) < -5
    assert np.max(sliding) > 4
    agree(still, 0.0, SOLVED, 1.0)


def test_only_cyclic_softening_continues_after_the_first_cycle():
    first, cyclic = (
        force.reshape(3, -1)
        for force in (force[:360] for _, force in refinements.compute_softenings().values())
    )
    # The third cycle against the second one.
    agree(first[2], first[1], SOLVED, 1.0)
    assert np.all(np.abs(cyclic[2]) < 0.8 * np.abs(cyclic[1]))


def test_pressure_drop_is_proportional_to_flow_or_to_its_square():
    for power, (flow, drop) in zip((1, 2, 2), refinements.compute_pressure_drops().values(), strict=True):
        agree(drop[-1] / drop[-31], (flow[-1] / flow[-31]) ** power, 1e-2)


def test_damper_differs_between_directions_by_its_asymmetry():
    even, sided, _ = (force for _, force in refinements.compute_dampings().values())
    agree(sided[[0, -1]], [0.5 * even[0], 1.5 * even[-1]], 1e-3)


def test_every_panel_has_a_title_and_a_unit():
    figure = refinements.plot_refinements()
    figure.draw_without_rendering()
    assert len(figure.axes) == len(CURVES)
    for panel in figure.axes:
        assert panel.get_title("left")
        assert panel.get_xlabel()[-1] == panel.get_ylabel()[-1] == "]"

"""Figure of the refinements: what each further parameter of a mechanism does to its textbook form.

drift      zero of the load cell over time
locking    force of jammed threads against contraction: power of the overlap; start of contact, and stretch
friction   loops of force against contraction; strength against speed; loops of force against pressure
damping    force of a damper against speed
rubber     force of the bladder against contraction
creep      relaxing stress against time
softening  force of the part of the wall that softens, against contraction
supply     pressure drop against flow
bedding    permanent elongation against the largest load so far
coat       error of the outer diameter against contraction
"""

# Mechanisms take plain numbers here; their fields are typed as arrays.
# pyright: reportArgumentType=false

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pamjax.model.history import build_time_history
from pamjax.model.mechanism import AbstractStoredEnergy, Past
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.braid_friction import BraidFriction
from pamjax.model.mechanisms.braid_locking import BraidLocking
from pamjax.model.mechanisms.diameter_offset import DiameterOffset
from pamjax.model.mechanisms.end_taper import EndTaper
from pamjax.model.mechanisms.force_drift import ForceDrift
from pamjax.model.mechanisms.mullins_softening import MullinsSoftening
from pamjax.model.mechanisms.pressure_drop import PressureDrop
from pamjax.model.mechanisms.thread_slip import ThreadSlip
from pamjax.model.mechanisms.viscoelastic_creep import ViscoelasticCreep
from pamjax.model.mechanisms.viscous_damping import ViscousDamping
from pamjax.model.state import Cylinder, State
from pamjax.view.figures.mechanism_demo import DEMO_REST_LENGTH, DEMO_THREAD_LENGTH, DEMO_TURNS
from pamjax.view.theme import DOUBLE_COLUMN, OKABE_ITO, add_panel_letters, apply_theme, create_figure

#: Colours and styles of the textbook form and of its refinements.
LINES = (
    {"color": OKABE_ITO["black"], "ls": "-"},
    {"color": OKABE_ITO["blue"], "ls": "--"},
    {"color": OKABE_ITO["vermilion"], "ls": "-."},
    {"color": OKABE_ITO["green"], "ls": ":"},
)

#: Pressure and sampling interval of the friction loops, Pa and s.
_LOOP_PRESSURE, _LOOP_TIME_STEP = 350e3, 0.5

#: Dimensions of the bladder, m.
_TUBE = {"inner_diameter": 19e-3, "thickness": 1.6e-3, "length": DEMO_REST_LENGTH}

Curves = dict[str, tuple[np.ndarray, np.ndarray]]


class _Panel(NamedTuple):
    """A panel: its mechanism, curves and axis labels.

    Attributes:
        is_log: whether the abscissa has a logarithmic scale.
        headroom: extra height for the legend, as a share of the range of the curves.
    """

    mechanism_id: str
    curves: Curves
    abscissa: str
    ordinate: str
    is_log: bool = False
    headroom: float = 0.0


def plot_refinements() -> Figure:
    """Return the figure: a panel for each mechanism with a refinement; more for friction and jamming."""
    panels = _list_panels()
    with apply_theme():
        figure = create_figure(DOUBLE_COLUMN, 15.4)
        axes = figure.subplots((len(panels) + 1) // 2, 2).ravel().tolist()
        for unused in axes[len(panels) :]:
            unused.remove()
        for ax, panel in zip(axes, panels, strict=False):
            _draw_panel(ax, panel)
        add_panel_letters(axes[: len(panels)])
    return figure


def _list_panels() -> list[_Panel]:
    contraction, force, speed = "contraction [%]", "force [N]", "speed [mm/s]"
    return [
        _Panel("force_drift", compute_drifts(), "time [min]", "zero [N]", headroom=0.45),
        _Panel("bladder_elasticity", compute_rubbers(), contraction, force),
        _Panel("braid_locking", compute_lockings(), contraction, force),
        _Panel("braid_locking", compute_contacts(), contraction, force),
        _Panel("braid_friction", compute_loops(), contraction, force, headroom=0.45),
        _Panel("braid_friction", compute_strengths(), speed, "strength [1]", is_log=True),
        _Panel("braid_friction", compute_pressure_loops(), "pressure [kPa]", force),
        _Panel("mullins_softening", compute_softenings(), contraction, force),
        _Panel("viscoelastic_creep", compute_relaxations(), "time [s]", "stress [1]", is_log=True),
        _Panel("pressure_drop", compute_pressure_drops(), "flow [ml/s]", "drop [kPa]"),
        _Panel("end_taper", compute_end_losses(), contraction, force),
        _Panel("thread_slip", compute_beddings(), "largest load [N]", "elongation [%]"),
        _Panel("diameter_offset", compute_coats(), contraction, "diameter error [mm]"),
        _Panel("viscous_damping", compute_dampings(), speed, force),
    ]


def _draw_panel(ax: Axes, panel: _Panel) -> None:
    for style, (label, (x, y)) in zip(LINES, panel.curves.items(), strict=False):
        ax.plot(x, y, label=label, lw=1.2, **style)
    ax.set(xlabel=panel.abscissa, ylabel=panel.ordinate, title=panel.mechanism_id)
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + panel.headroom * (high - low))
    if panel.is_log:
        ax.set_xscale("log")
    ax.legend(loc="best" if len(panel.curves) < 4 else "upper left")


def compute_drifts() -> Curves:
    """Return the zero over an hour, N, by form; the first is the textbook's."""
    minutes = np.linspace(0, 60, 241)
    time_history = build_time_history(60 * minutes, minutes == 0)
    nothing = jnp.zeros(minutes.size)
    past = Past(_build_state(np.full(minutes.size, DEMO_REST_LENGTH)), nothing, nothing, nothing)
    forms = {
        "rate": ForceDrift(rate=10 / 3600),
        "warmup": ForceDrift(warmup=10.0),
        "root": ForceDrift(root=10 / 60),
        "swing": ForceDrift(swing_sine=3.0),
    }
    return {
        name: (minutes, np.asarray(drift.to_recorded_outputs(nothing, nothing, past, time_history)[0]))
        for name, drift in forms.items()
    }


def compute_lockings() -> Curves:
    """Return the force of jammed threads near rest length, N, by exponent."""
    return {
        f"exponent {exponent:g}": _compute_force(BraidLocking(0.3e6, 0.2, exponent), 0.15)
        for exponent in (1.0, 1.5, 3.0)
    }


def compute_contacts() -> Curves:
    """Return the force of jammed threads near rest length, N, at a strain of the threads of 1 %, by form."""
    unloaded = jnp.asarray(DEMO_THREAD_LENGTH), jnp.asarray(DEMO_TURNS)
    forms = {
        "rounding 0.01, stretch 0": BraidLocking(0.3e6, 0.2),
        "rounding 0.1": BraidLocking(0.3e6, 0.2, rounding=0.1),
        "stretch 1, at 1 % strain": BraidLocking(0.3e6, 0.2, stretch=1.0),
    }
    return {name: _compute_force(form.prepare(*unloaded), 0.15, 0.01) for name, form in forms.items()}


def compute_rubbers() -> Curves:
    """Return the force of a latex bladder, N, by stiffening."""
    return {
        f"stiffening {share:g}": _compute_force(BladderElasticity(0.4e6, **_TUBE, stiffening=share), 0.35)
        for share in (0.0, 0.02, 0.05)
    }


def compute_loops() -> Curves:
    """Return loops of friction at a constant pressure, N, by form; the fast loop is ten times as fast."""
    stroke = np.abs((np.arange(241) / 60 + 1) % 2 - 1)
    contraction = 0.05 + 0.1 * stroke
    forms = {
        "even": (BraidFriction(0.3, presliding=2e-3), 1.0),
        "asymmetry 0.4": (BraidFriction(0.3, presliding=2e-3, asymmetry=0.4), 1.0),
        "weakening 0.5, fast": (
            BraidFriction(0.3, presliding=2e-3, weakening=0.5, weakening_speed=2e-3),
            0.1,
        ),
    }
    loops: Curves = {}
    for name, (friction, pace) in forms.items():
        length = DEMO_REST_LENGTH * (1 - contraction)
        time = pace * _LOOP_TIME_STEP * np.arange(length.size)
        nothing = jnp.zeros(length.size)
        past = Past(_build_state(length), nothing + _LOOP_PRESSURE, nothing, nothing)
        loops[name] = (100 * contraction[120:], _compute_friction(friction, past, time)[120:])
    return loops


def compute_pressure_loops() -> Curves:
    """Return friction at a fixed length while threads stretch with pressure, 1 % at 400 kPa, N, by form."""
    pressure = 2e5 + 2e5 * np.abs((np.arange(241) / 60 + 1) % 2 - 1)
    time, nothing = np.arange(pressure.size, dtype=float), jnp.zeros(pressure.size)
    lengths = nothing + DEMO_REST_LENGTH, DEMO_THREAD_LENGTH * (1 + 0.01 * jnp.asarray(pressure) / 4e5)
    past = Past(Cylinder()(*lengths, nothing + DEMO_TURNS), jnp.asarray(pressure), nothing, nothing)
    unloaded = jnp.asarray(DEMO_THREAD_LENGTH), jnp.asarray(DEMO_TURNS)
    loops: Curves = {}
    for share in (1.0, 0.0):
        friction = BraidFriction(0.3, presliding=5e-4, stretch=share).prepare(*unloaded)
        loops[f"stretch {share:g}"] = (1e-3 * pressure[120:], _compute_friction(friction, past, time)[120:])
    return loops


def _compute_friction(friction: BraidFriction, past: Past, time: np.ndarray) -> np.ndarray:
    """Return the force of friction at some states and times, s, N."""
    strains = jax.vmap(friction.strains)(past.state, past.pressure)
    stress = friction.stresses(build_time_history(time, time == 0), strains, past)[:, 0]
    return np.asarray(stress / past.state.thread)


def compute_strengths() -> Curves:
    """Return the strength of friction at a speed over that at rest, by weakening."""
    speed = np.geomspace(1e-4, 0.1, 200)
    return {
        f"weakening {share:g}": (
            1e3 * speed,
            np.asarray(BraidFriction(weakening=share, weakening_speed=2e-3).speed_factor(jnp.asarray(speed))),
        )
        for share in (0.0, 0.5)
    }


def compute_dampings() -> Curves:
    """Return the force of a damper, N, against the speed of lengthening, by form."""
    speed = np.linspace(-5e-3, 5e-3, 160)
    # Five samples at each speed, over which the rate is computed.
    time = np.tile(np.arange(5.0), speed.size)
    length = DEMO_REST_LENGTH + np.repeat(speed, 5) * time
    nothing = jnp.zeros(length.size)
    history, past = build_time_history(time, time == 0), Past(_build_state(length), *[nothing] * 3)
    forms = {
        "even": ViscousDamping(2e3),
        "asymmetry 0.5": ViscousDamping(2e3, asymmetry=0.5),
        "power 0.5": ViscousDamping(2e3, power=0.5),
    }
    return {
        name: (1e3 * speed, np.asarray(damper.stresses(history, jnp.asarray(length)[:, None], past))[2::5, 0])
        for name, damper in forms.items()
    }


def compute_relaxations() -> Curves:
    """Return the stress after a step of stretch, over its first value, by spectrum."""
    time = np.geomspace(0.1, 1e4, 300)
    curves: Curves = {}
    for name, share, spectrum in (
        ("two branches", 0.5, 0.0),
        ("logarithm of time", 0.5, 1.0),
        ("power 0.3 of time", 1 / (1 + 1000.0**-0.3), 1.0),
    ):
        times, shares = ViscoelasticCreep(1.0, share, 1.0, 1000.0, spectrum=spectrum).list_branches()
        curves[name] = (time, np.exp(-time[:, None] / np.asarray(times)) @ np.asarray(shares))
    return curves


def compute_softenings() -> Curves:
    """Return the force of the softening part of the wall over three cycles, N, by form."""
    contraction = 0.1 + 0.2 * np.abs((np.arange(361) / 60 + 1) % 2 - 1)
    length = DEMO_REST_LENGTH * (1 - contraction)
    steps = np.arange(length.size)
    history, state = build_time_history(10.0 * steps, steps == 0), _build_state(length)
    past = Past(state, *[jnp.zeros(length.size)] * 3)
    forms = {
        "first stretch": MullinsSoftening(0.1e6, **_TUBE),
        "every cycle": MullinsSoftening(cyclic_modulus=0.1e6, cyclic_energy=2.0, **_TUBE),
    }
    curves: Curves = {}
    for name, softening in forms.items():
        strains = jax.vmap(lambda s, m=softening: m.strains(s, jnp.asarray(0.0)))(state)
        stress = np.asarray(softening.stresses(history, strains, past))[:, 0]
        slope = _compute_slope(lambda s, m=softening: m.strains(s, jnp.asarray(0.0))[0], length)
        curves[name] = (100 * contraction, stress * slope)
    return curves


def compute_end_losses() -> Curves:
    """Return the change of the force by the ends at a constant pressure, N, by form."""
    contraction = np.linspace(0.02, 0.3, 113)
    length = DEMO_REST_LENGTH * (1 - contraction)
    rest = Cylinder()(*(jnp.asarray(v) for v in (DEMO_REST_LENGTH, DEMO_THREAD_LENGTH, DEMO_TURNS)))
    fitting = float(rest.radius)
    forms = {
        "net": EndTaper(1.0, fitting),
        "cones of 12 mm": EndTaper(0.0, fitting, cone_height=12e-3),
    }

    def compute_added_volume(state: State, ends: EndTaper) -> Array:
        return ends.shape(state).volume - state.volume

    return {
        name: (
            100 * contraction,
            -_LOOP_PRESSURE * _compute_slope(lambda s, e=ends: compute_added_volume(s, e), length),
        )
        for name, ends in forms.items()
    }


def compute_pressure_drops() -> Curves:
    """Return the pressure drop, kPa, against the flow, by form."""
    flow = np.linspace(-20, 20, 161)
    volume = jnp.asarray(np.concatenate([[0.0], np.cumsum(0.5 * (flow[1:] + flow[:-1]))]) * 1e-6)
    time = np.arange(flow.size, dtype=float)
    nothing = jnp.zeros(flow.size)
    pressure = jnp.full(flow.size, _LOOP_PRESSURE)
    state = eqx.tree_at(lambda s: s.volume, _build_state(np.full(flow.size, DEMO_REST_LENGTH)), volume)
    past, history = Past(state, pressure, nothing, nothing), build_time_history(time, time == 0)
    forms = {
        "laminar": PressureDrop(impedance=2e8),
        "turbulence": PressureDrop(turbulence=4e12),
        f"gas at {1e-3 * _LOOP_PRESSURE:.0f} kPa": PressureDrop(turbulence=4e12, compressibility=1.0),
    }
    inner = slice(5, -5)
    return {
        name: (flow[inner], 1e-3 * np.asarray(pressure - drop.pressure(history, past))[inner])
        for name, drop in forms.items()
    }


def compute_beddings() -> Curves:
    """Return the permanent elongation of the threads, %, against the largest load so far, by exponent."""
    load = jnp.linspace(0.0, 1000.0, 201)
    time, nothing = np.arange(load.size, dtype=float), jnp.zeros(load.size)
    history = build_time_history(time, time == 0)
    past = Past(_build_state(np.full(load.size, DEMO_REST_LENGTH)), nothing, load, nothing)
    return {
        f"exponent {exponent:g}": (
            np.asarray(load),
            100 * np.asarray(ThreadSlip(1e-3, 500.0, exponent).extension(history, past)),
        )
        for exponent in (1.0, 2.0, 5.0)
    }


def compute_coats() -> Curves:
    """Return the error of the outer diameter by a coat, mm, by thinning."""
    contraction = np.linspace(0, 0.3, 121)
    state, nothing = _build_state(DEMO_REST_LENGTH * (1 - contraction)), jnp.zeros(contraction.size)
    time = np.arange(contraction.size, dtype=float)
    past, history = Past(state, nothing, nothing, nothing), build_time_history(time, time == 0)
    coats = {f"thinning {power:g}": DiameterOffset(3e-3, thinning=power) for power in (0.0, 0.7, 1.0)}
    return {
        name: (
            100 * contraction,
            1e3 * np.asarray(coat.to_recorded_outputs(nothing, nothing, past, history)[1]),
        )
        for name, coat in coats.items()
    }


def _build_state(length: np.ndarray) -> State:
    """Return the cylinder at some lengths, m."""
    values = jnp.asarray(length)
    return Cylinder()(values, jnp.full_like(values, DEMO_THREAD_LENGTH), jnp.full_like(values, DEMO_TURNS))


def _compute_force(
    mechanism: AbstractStoredEnergy, stroke: float, strain: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return contraction, %, and the force of a stored energy at constant strain of the threads, N."""
    contraction = np.linspace(0, stroke, 150)
    force = _compute_slope(mechanism.energy, DEMO_REST_LENGTH * (1 - contraction), strain)
    return 100 * contraction, force


def _compute_slope(energy: Callable[[State], Array], length: np.ndarray, strain: float = 0.0) -> np.ndarray:
    """Return the derivative of an energy of the state by the length, at constant strain of the threads."""
    thread_length = jnp.asarray(DEMO_THREAD_LENGTH * (1 + strain))

    def compute_energy(value):
        return energy(Cylinder()(value, thread_length, jnp.asarray(DEMO_TURNS)))

    return np.asarray(jax.vmap(jax.grad(compute_energy))(jnp.asarray(length)))

"""Friction between the braid threads: rate-independent hysteresis with presliding."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from pamjax.model import scan
from pamjax.model.form_error import FormError, list_powers
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractMemory, Description, Past
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter

#: Radius of the contact patch of two threads, m. Only the product of radius and μ is identifiable.
PATCH_RADIUS = 0.5e-3

#: Reference pressure, Pa, of the presliding distance. At it the strength does not depend on the exponent m.
PRESLIDING_PRESSURE = 3e5

#: Pressure, Pa, below which the strength is proportional to pressure: a power below one is too steep at zero.
MIN_FRICTION_PRESSURE = 1e3

#: Minimum cosine of the braid angle: a negative power of the radius of a straight muscle is infinite.
_MIN_ANGLE_COSINE = 1e-3

#: Presliding distances of the elements, over the largest one. The elements have equal weights, so that force
#: rises in four straight pieces of decreasing slope.
ELEMENT_SHARES = (0.25, 0.5, 0.75, 1.0)


class BraidFriction(AbstractMemory):
    """Four elastic stops in parallel (Maxwell slip), driven by the muscle length or the braid angle. One set
    has a constant strength, the other a strength that increases with pressure.

        force  q = Fc mean(y) + μ mean(z)
        y  <-  clip(y + du / x,       −(1 − a) g, (1 + a) g)        x = d [1 − w (3/4, 2/4, 1/4, 0)]
        z  <-  clip(z + Sr du / x,    −(1 − a) g S, (1 + a) g S)    g = 1 − c [1 − exp(−(v/vs)²)]
        S  =  (2/3) r L/N · P (P/Pr)^(m−1) (sin θ)^(p−1) (cos θ)^k,      Sr = (2/3) r B/N · Pr
        du =  B d[(1 − h) L / b + h θ − γ P / B],   sin θ = L / B,   b = B0 + e (B − B0)
        v  =  du/dt

        Fc  constant     N      Coulomb force that does not depend on pressure
        μ   coefficient  1      friction coefficient between threads, contact patches of radius r = 0.5 mm
        m   exponent     1      power of pressure: 1 for constant patches, 2/3 for Hertzian patches
        p   reach        1      power of length: 1 for crossings that rotate, 0 for a constant lever arm
        k   girth        1      power of radius: 0 for crossings that rotate, 1 for the lateral area 2πRL
        d   presliding   m      distance after a reversal until the full force, at Pr = 300 kPa
        h   angle        1      sliding variable: 0 is the length, 1 is the braid angle
        e   stretch      1      share of the thread's stretch that causes sliding: 1 for crossings that rotate
        w   spread       1      difference between the elements: 0 all slip together, 1 one after the other
        γ   give         m/Pa   displacement in the braid for a change of pressure alone
        s   start        1      deflection of the elements before the first sample, −1 to 1
        c   weakening    1      share of the strength that is lost at high speed (Stribeck)
        vs  weakening_speed m/s speed at which 63 % of this share are lost
        a   asymmetry    1      strength for lengthening 1 + a, for shortening 1 − a

    Derivation of S: the two thread families press on each other with the force P π R L in total. A crossing
    turns by d(2θ) = 2 dL / (2πRN) against a torque (2/3) μ r per newton. The work for dL is therefore
    (2/3) μ r P L/N.

    The stiffness of an element does not change with its strength. Its work is therefore never less than its
    stored energy: ∫ q du >= 0 from a relaxed state, for every path of length and pressure. A stiffness
    proportional to the strength would produce energy when pressure rises on a deflected element.
    With `give` the stress also changes the volume, −∂(q u)/∂P = q γ. The integral ∮ (F dL − V dP) includes
    this change.

    This holds at any speed and asymmetry, because the limits of an element include zero. While all elements
    slip, asymmetry adds a S in both directions. This resembles an error of the length.

    Neutral: Fc = μ = 0. For d → 0 it is Coulomb friction. Neglects: changes of friction by wear,
    by temperature, or by time at rest.
    Source: the stop operator of Prandtl and Ishlinskii; strength derived here; Davis & Caldwell, Int. J.
    Robot. Res. 25, 359, 2006 (patches); Tondu & Lopez, IEEE Control Syst. 20(2), 15, 2000 (area); Vo-Minh
    et al., IEEE/ASME Trans. Mechatron. 16, 177, 2011 (Maxwell slip in a muscle); Armstrong-Hélouvry, Dupont &
    Canudas de Wit, Automatica 30, 1083, 1994 (Stribeck, with this exponent of two).
    """

    id: ClassVar[str] = "braid_friction"
    uses_rate: ClassVar[bool] = True
    about: ClassVar[Description] = Description(
        title="friction between braid threads",
        equation="F = F0 + Fc mean(y) + mu mean(z),  stops -(1 - a) g <= y, z/S <= (1 + a) g\n"
        "S = (2/3) r P L/N cos(angle)^k,   g = 1 - c (1 - e^(-(v/vs)^2))",
        signature="Force is higher while the muscle lengthens and lower while it shortens, by the same"
        " amount at every speed. After a reversal it changes from one to the other within the presliding"
        " distance.",
        neglects="wear, temperature, time at rest",
        confusable=("viscous_damping", "channel_lag", "viscoelastic_creep", "pressure_drop"),
        experiment="Repeat the stroke three times as fast: the loop of friction does not change. Record a"
        " hold: friction remains, the effect of a delay disappears immediately, and rubber relaxes.",
        source="derived here; Davis & Caldwell 2006; Vo-Minh et al. 2011; Armstrong-Helouvry et al. 1994",
    )
    form_error: ClassVar[FormError] = FormError(
        (
            *list_powers("pressure", 2), *list_powers("length", 2), "pressure length", "direction",
            "direction pressure", "direction length", "speed",
        ),
        # The course after a reversal may be faster or slower.
        shape_factors=({"presliding": 0.3}, {"presliding": 3.0}),
    )  # fmt: skip

    coefficient: Scalar = parameter(
        "1", low=0.0, high=5.0, neutral=0.0,
        about="friction coefficient between threads, for contact patches of 0.5 mm radius",
        source="aramid on aramid 0.2 to 0.3, rubber up to 1; wider range for patches of another size",
        default=0.0,
    )  # fmt: skip
    constant: Scalar = parameter(
        "N", low=0.0, high=500.0, neutral=0.0, about="Coulomb force that does not depend on pressure",
        source="some newtons for a small muscle, more where rubber slides", default=0.0,
    )  # fmt: skip
    exponent: Scalar = parameter(
        "1", low=0.5, high=2.0, about="exponent of pressure in the friction strength",
        source="2/3 for elastic contacts of round threads, 1 for patches of constant size, more if the"
        " bladder reaches the braid only above a pressure",
        default=1.0,
    )  # fmt: skip
    reach: Scalar = parameter(
        "1", low=-1.0, high=1.0, about="exponent of length in the friction strength",
        source="1 for crossings that rotate, and for friction on the lateral area", default=1.0,
    )  # fmt: skip
    girth: Scalar = parameter(
        "1", low=-1.0, high=2.0, about="exponent of radius in the friction strength",
        source="0 for crossings that rotate, 1 for friction on the lateral area", default=0.0,
    )  # fmt: skip
    presliding: Scalar = parameter(
        "m", show="mm", low=1e-6, high=0.05, scale="log",
        about="distance after a reversal until the full friction force, at 300 kPa",
        source="0.5 to 5 % of a stroke", default=1e-3,
    )  # fmt: skip
    angle: Scalar = parameter(
        "1", low=0.0, high=1.0, about="sliding variable: 0 is the length, 1 is the braid angle",
        source="at 1 a frictional moment gives a force that grows as 1/cos(angle) towards rest length",
        default=0.0,
    )  # fmt: skip
    spread: Scalar = parameter(
        "1", low=0.0, high=1.0, about="relative difference between the presliding distances of the elements",
        source="0: all distances are equal; 1: four distances, evenly spaced up to the largest", default=1.0,
    )  # fmt: skip
    give: Scalar = parameter(
        "m/Pa", show="mm/MPa", low=0.0, high=2e-8,
        about="displacement in the braid for a change of pressure alone",
        source="of the order of the thread stretch, some mm at 1 MPa", default=0.0,
    )  # fmt: skip
    start: Scalar = parameter(
        "1", low=-1.0, high=1.0,
        about="deflection before the first sample over that of full friction; 1 after lengthening",
        source="the full range", default=0.0,
    )  # fmt: skip

    weakening: Scalar = parameter(
        "1", low=0.0, high=0.95, is_refinement=True, about="share of the strength that is lost at high speed",
        source="0.15 to 0.85 in Tondu & Lopez 2000; 0 is Coulomb friction", default=0.0,
    )  # fmt: skip
    weakening_speed: Scalar = parameter(
        "m/s", show="mm/s", low=1e-6, high=1.0, scale="log", is_refinement=True,
        about="speed at which 63 % of this share are lost",
        source="0.1 m/s in Tondu & Lopez 2000; less for threads that creep", default=1e-2,
    )  # fmt: skip
    asymmetry: Scalar = parameter(
        "1", low=-0.9, high=0.9, is_refinement=True,
        about="relative excess of the strength while the muscle lengthens",
        source="loops of muscles are often wider on one side; at 1 one direction has no friction",
        default=0.0,
    )  # fmt: skip

    stretch: Scalar = parameter(
        "1", low=0.0, high=1.0, is_refinement=True, about="share of the thread's stretch that causes sliding",
        source="1 for crossings that rotate; 0 for sliding on the bladder or on the fittings", default=1.0,
    )  # fmt: skip

    unloaded_thread: Scalar | None = None

    def prepare(self, thread_length: Scalar, turns: Scalar) -> BraidFriction:
        return eqx.tree_at(lambda m: m.unloaded_thread, self, thread_length, is_leaf=lambda x: x is None)

    def strains(self, state: State, pressure: Scalar) -> Float[Array, "1 ..."]:
        braid_angle = jnp.arctan2(state.length, 2 * jnp.pi * state.turns * state.radius)
        thread = state.thread
        if self.unloaded_thread is not None:
            thread = self.unloaded_thread + self.stretch * (thread - self.unloaded_thread)
        sliding = (1 - self.angle) * state.length / thread + self.angle * braid_angle
        return jnp.stack([sliding - self.give * pressure / state.thread])

    def strength(self, pressure: Array, state: State) -> Array:
        """Return the full friction force for a coefficient of one, N."""
        power = (jnp.maximum(pressure, MIN_FRICTION_PRESSURE) / PRESLIDING_PRESSURE) ** (self.exponent - 1)
        angle_cosine = jnp.maximum(2 * jnp.pi * state.turns * state.radius / state.thread, _MIN_ANGLE_COSINE)
        arm = state.length * (state.length / state.thread) ** (self.reach - 1) * angle_cosine**self.girth
        return 2 / 3 * PATCH_RADIUS * jnp.maximum(pressure, 0.0) * power * arm / state.turns

    def speed_factor(self, speed: Array) -> Array:
        """Return the strength at a speed, m/s, over that at rest."""
        return 1 + self.weakening * jnp.expm1(-((speed / self.weakening_speed) ** 2))

    def full_sliding_stress(self, past: Past) -> Float[Array, "1 ..."]:
        """Return the largest stress in which every element slips, slowly; stress × strain is in J."""
        width = (1 + jnp.abs(self.asymmetry)) * (
            self.constant + self.coefficient * self.strength(past.pressure, past.state)
        )
        return (width * past.state.thread)[None]

    def stresses(self, history: History, strains: Float[Array, "n 1"], past: Past) -> Float[Array, "n 1"]:
        state, shares = past.state, 1 + self.spread * (jnp.asarray(ELEMENT_SHARES) - 1)
        displacements = history.increments(strains[:, 0]) * state.thread / self.presliding
        factor = self.speed_factor(history.rate(strains[:, 0]) * state.thread)
        # One reference for the recording, so that the stiffness is the same at every pressure.
        reference = 2 / 3 * PATCH_RADIUS * PRESLIDING_PRESSURE * state.thread[0] / state.turns[0]
        # Two columns, constant and proportional to pressure, with four elements each.
        widths = jnp.stack([factor, factor * self.strength(past.pressure, state)], axis=1)
        widths = widths[:, :, None] * jnp.ones_like(shares)
        stiffness = jnp.stack([jnp.ones_like(reference), reference])[:, None] / shares
        high, low = (1 + self.asymmetry) * widths, -(1 - self.asymmetry) * widths
        start = self.start * jnp.where(self.start > 0, high, -low)
        stops = scan.apply_stop_operator(displacements, stiffness, high, history.restart, start, low)
        force = jnp.mean(stops, axis=2) @ jnp.stack([self.constant, self.coefficient])
        return (force * state.thread)[:, None]

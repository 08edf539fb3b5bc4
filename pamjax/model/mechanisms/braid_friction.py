"""Threads rub on each other: a force that turns with the motion and remembers where it turned."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from pamjax.model import scan
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractMemory, Description, Past
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter

#: Radius of the patch on which two threads press, m: only its product with μ can be found.
PATCH_RADIUS = 0.5e-3

#: Pressure at which the presliding distance is meant, and at which every exponent gives one strength, Pa.
PRESLIDING_PRESSURE = 3e5

#: Below this pressure, Pa, the strength is proportional to it: a power less than one is too steep at zero.
MIN_FRICTION_PRESSURE = 1e3

#: Cosine of the braid angle below which a muscle is straight, and no power of its radius is asked for.
MIN_ANGLE_COSINE = 1e-3

#: Presliding distances of the elements, over that of the last one. Equal weights: force rises in four
#: straight pieces, each less steep than the one before.
ELEMENT_SHARES = (0.25, 0.5, 0.75, 1.0)


class BraidFriction(AbstractMemory):
    """Four elastic stops in parallel (Maxwell slip), on the braid's angle; once on a constant strength
    and once on one that grows with pressure.

        force  q = Fc mean(y) + μ mean(z)
        y  <-  clip(y + du / x,       −1, 1)              x = d [1 − w (3/4, 2/4, 1/4, 0)]
        z  <-  clip(z + Sr du / x,    −S, S)
        S  =  (2/3) r L/N · P (P/Pr)^(m−1) (sin θ)^(p−1) (cos θ)^k,      Sr = (2/3) r B/N · Pr
        du =  B d[(1 − h) sin θ + h θ − γ P / B],   sin θ = L / B;  du = dL for a stiff thread and h = 0

        Fc  constant     N      Coulomb force that no pressure presses for
        μ   coefficient  1      friction of thread on thread, on patches of radius r = 0.5 mm
        m   exponent     1      1: patches of one size; 2/3: patches that grow as those of Hertz
        p   reach        1      power of length: 1 at crossings that turn, 0 where the arm stays the same
        k   girth        1      power of radius: 0 at crossings that turn, 1 on the lateral area 2πRL
        d   presliding   m      distance after a turn from which the force is full, at Pr = 300 kPa
        h   angle        1      what rubs: 0 as the length moves, 1 as the braid's angle turns
        w   spread       1      how far the elements differ: 0 gives way at once, 1 little by little
        γ   give         m/Pa   what moves when only the pressure changes
        s   start        1      how far the elements were dragged before the first sample, −1 to 1

    Derivation of S (E2): the families press on each other with P π R L in all; a crossing turns by
    d(2θ) = 2 dL / (2πRN), against a torque (2/3) μ r per newton; the work of a dL is (2/3) μ r P L/N.

    An element keeps its stiffness while its strength changes with pressure, so its work is never less
    than what it stores: ∫ q du >= 0 from a relaxed state, for every path of length and pressure. (A
    stiffness that followed the strength would make energy when pressure rises on a dragged element.)
    With `give` the stress also moves some volume, −∂(q u)/∂P = q γ: ∮ (F dL − V dP) counts it.

    Neutral: Fc = μ = 0. As d → 0 it is Coulomb's force. What it leaves out: sliding that grows weaker
    with speed (Stribeck), loops that are wider in one direction.
    Source: the stop operator of Prandtl and Ishlinskii; strength derived here; Davis & Caldwell, Int. J.
    Robot. Res. 25, 359, 2006 (patches); Tondu & Lopez, IEEE Control Syst. 20(2), 15, 2000 (area); Vo-Minh
    et al., IEEE/ASME Trans. Mechatron. 16, 177, 2011 (Maxwell slip in a muscle).
    """

    id: ClassVar[str] = "braid_friction"
    about: ClassVar[Description] = Description(
        title="friction between braid threads",
        equation="F = F0 + Fc mean(y) + mu mean(z),  stops |y| <= 1, |z| <= (2/3) r P L/N cos(angle)^k",
        signature="Force is higher while the muscle lengthens and lower while it shortens, by the same at"
        " every speed; after a turn it crosses over within the presliding distance.",
        leaves_out="weakening with speed, loops that are wider in one direction",
        confusable=("viscous_damping", "channel_lag", "viscoelastic_creep", "pressure_drop"),
        experiment="The same stroke three times as fast: friction keeps its loop. A hold: friction stays,"
        " a lag ends at once, rubber relaxes.",
        source="derived here; Davis & Caldwell 2006; Vo-Minh et al. 2011",
    )

    coefficient: Scalar = parameter(
        "1", low=0.0, high=5.0, neutral=0.0, about="friction of thread on thread, patches of 0.5 mm radius",
        source="aramid on aramid 0.2 to 0.3, rubber to 1; wider for patches of another size", default=0.0,
    )  # fmt: skip
    constant: Scalar = parameter(
        "N", low=0.0, high=500.0, neutral=0.0, about="Coulomb force at any pressure",
        source="some newtons for a small muscle, more where rubber rubs", default=0.0,
    )  # fmt: skip
    exponent: Scalar = parameter(
        "1", low=0.5, high=1.0, about="power of pressure with which the strength grows",
        source="2/3 for elastic contacts of round threads, 1 for patches of one size", default=1.0,
    )  # fmt: skip
    reach: Scalar = parameter(
        "1", low=-1.0, high=1.0, about="power of length with which the strength grows",
        source="1 for crossings that turn, and for friction on the lateral area", default=1.0,
    )  # fmt: skip
    girth: Scalar = parameter(
        "1", low=-1.0, high=2.0, about="power of radius with which the strength grows",
        source="0 for crossings that turn, 1 for friction on the lateral area", default=0.0,
    )  # fmt: skip
    presliding: Scalar = parameter(
        "m", show="mm", low=1e-6, high=0.05, scale="log",
        about="distance after a turn from which the force is full, at 300 kPa",
        source="0.5 to 5 % of a stroke", default=1e-3,
    )  # fmt: skip
    angle: Scalar = parameter(
        "1", low=0.0, high=1.0, about="what rubs: 0 as the length moves, 1 as the braid's angle turns",
        source="at 1 a moment of friction is a force that grows as 1/cos(angle) towards rest", default=0.0,
    )  # fmt: skip
    spread: Scalar = parameter(
        "1", low=0.0, high=1.0, about="how far the distances of the elements differ",
        source="0 is one element; 1 spreads four evenly up to the distance", default=1.0,
    )  # fmt: skip
    give: Scalar = parameter(
        "m/Pa", show="mm/MPa", low=0.0, high=2e-8, about="what moves in the braid when only pressure changes",
        source="of the order of the thread stretch, some mm at 1 MPa", default=0.0,
    )  # fmt: skip
    start: Scalar = parameter(
        "1", low=-1.0, high=1.0, about="how far it was dragged before the first sample; 1: by lengthening",
        source="all there is", default=0.0,
    )  # fmt: skip

    def strains(self, state: State, pressure: Scalar) -> Float[Array, "1 ..."]:
        turned = jnp.arctan2(state.length, 2 * jnp.pi * state.turns * state.radius)
        moved = (1 - self.angle) * state.length / state.thread + self.angle * turned
        return jnp.stack([moved - self.give * pressure / state.thread])

    def strength(self, pressure: Array, state: State) -> Array:
        """Full friction, N, of a coefficient of one."""
        power = (jnp.maximum(pressure, MIN_FRICTION_PRESSURE) / PRESLIDING_PRESSURE) ** (self.exponent - 1)
        wide = jnp.maximum(2 * jnp.pi * state.turns * state.radius / state.thread, MIN_ANGLE_COSINE)
        arm = state.length * (state.length / state.thread) ** (self.reach - 1) * wide**self.girth
        return 2 / 3 * PATCH_RADIUS * jnp.maximum(pressure, 0.0) * power * arm / state.turns

    def full_sliding_stress(self, past: Past) -> Float[Array, "1 ..."]:
        """The stress once every element was dragged all the way by lengthening; times its strain, J."""
        width = self.strength(past.pressure, past.state)
        return ((self.constant + self.coefficient * width) * past.state.thread)[None]

    def stresses(self, history: History, strains: Float[Array, "n 1"], past: Past) -> Float[Array, "n 1"]:
        state, shares = past.state, 1 + self.spread * (jnp.asarray(ELEMENT_SHARES) - 1)
        moved = history.increments(strains[:, 0]) * state.thread / self.presliding
        width = self.strength(past.pressure, state)
        # One number for the whole recording, so that the stiffness is the same at every pressure.
        whole = 2 / 3 * PATCH_RADIUS * PRESLIDING_PRESSURE * state.thread[0] / state.turns[0]
        # Two columns, constant and pressed; four elements in each.
        widths = jnp.stack([jnp.ones_like(width), width], axis=1)[:, :, None] * jnp.ones_like(shares)
        stiffness = jnp.stack([jnp.ones_like(whole), whole])[:, None] / shares
        stops = scan.apply_stop_operator(moved, stiffness, widths, history.restart, self.start * widths)
        force = jnp.mean(stops, axis=2) @ jnp.stack([self.constant, self.coefficient])
        return (force * state.thread)[:, None]

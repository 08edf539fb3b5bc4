"""The rubber relaxes: its stress fades towards that of the resting wall."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from pamjax.model import wall
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractMemory, Description, Past
from pamjax.model.scan import relax_states
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter


class ViscoelasticCreep(AbstractMemory):
    """Two Maxwell branches beside the wall (a Prony series), on the stresses of the wall or on the force:

        dq_i/dt = −q_i / τ_i + V μ_i dS/dt,   S = ½ ∂(I1 − 3)/∂(λz, λc)
        μ_1 = μ g,   μ_2 = μ (1 − g)

        dp_i/dt = −p_i / τ_i + f_i dF/dt,     f_1 = f g,  f_2 = f (1 − g),     Σ p_i joins the force

        q_i     stress    J    of branch i on the stretches (λz, λc); Σ q_i · (λz, λc) joins the potential
        S       stress    1    of a neo-Hookean wall, per modulus and rubber
        μ       modulus   Pa   shear modulus that a fast stretch meets and rest forgets
        g       share     1    of the short branch
        f       force     1    share of the muscle's whole force that a fast change meets and rest forgets
        τ_1,2   times     s    of relaxation
        V                 m³   rubber, π t (d + t) l

    As τ → ∞ this is one more neo-Hookean wall, less its stress where the memory begins; as τ → 0 it
    vanishes. Between samples S is taken to run straight in time, and is then integrated exactly, so that
    uneven steps and long gaps are right.

    It only loses energy. With c = S − q / (V μ_i), dc/dt = (S − c) / τ, the loss is V μ_i (S − c) ·
    (λ(S) − λ(c)) / τ: not negative, as stresses of a convex energy rise with their stretches. A relaxing
    *net* force of the bladder could gain energy, since that force is not monotone in length.

    f is the textbook's relaxation of the force itself, for muscles whose force creeps after a step of
    pressure too. At one pressure it only loses energy, as force rises with length; a path on which
    pressure moves may gain some from it, since what creeps is not told.

    The wall is taken to have rested before the recording. Neutral: μ = f = 0. It needs no
    `bladder_elasticity`. What it leaves out: more decades of time than two, dependence of relaxation
    on stretch and temperature, creep of the threads.
    Source: quasi-linear viscoelasticity (Fung 1972) in Prony form; the proof derived here.
    """

    id: ClassVar[str] = "viscoelastic_creep"
    about: ClassVar[Description] = Description(
        title="the rubber relaxes: force drifts after a stroke",
        equation="dq_i/dt = -q_i/tau_i + V mu_i dS/dt;  W = sum q_i . (lz, lc);  S = d(I1 - 3)/d(lz, lc) / 2;"
        "  dp_i/dt = -p_i/tau_i + f_i dF/dt",
        signature="After shortening, a hold shows force that rises; after lengthening, force that falls."
        " Loops as of friction, but of the same width at every pressure, widest near rest, and"
        " shrinking over the first cycles. Diameter stays.",
        leaves_out="decades of time beyond two branches; temperature; creep of the threads",
        confusable=("braid_friction", "force_drift", "mullins_softening", "viscous_damping"),
        experiment="Holds of 300 s at one length, approached from both sides; a loop without pressure.",
        source="Fung 1972, quasi-linear viscoelasticity as a Prony series",
    )

    modulus: Scalar = parameter(
        "Pa", show="MPa", low=0.0, high=2e6, neutral=0.0, about="shear modulus that relaxes",
        source="5 to 25 % of the rubber's own in gum rubber, more in filled rubber", default=0.0,
    )  # fmt: skip
    share: Scalar = parameter(
        "1", low=0.0, high=1.0, about="share of what relaxes in the short time",
        source="two terms for two decades of time", default=0.5,
    )  # fmt: skip
    time_short: Scalar = parameter(
        "s", low=0.05, high=60.0, scale="log", about="shorter time of relaxation",
        source="from a sample to a minute", default=10.0,
    )  # fmt: skip
    time_long: Scalar = parameter(
        "s", low=10.0, high=1e4, scale="log", about="longer time of relaxation",
        source="from a stroke to hours", default=200.0,
    )  # fmt: skip
    force: Scalar = parameter(
        "1", show="%", low=0.0, high=0.5, neutral=0.0, about="share of the whole force that relaxes",
        source="some percent in the first minutes", default=0.0,
    )  # fmt: skip
    inner_diameter: Scalar = wall.declare_inner_diameter()
    thickness: Scalar = wall.declare_thickness()
    length: Scalar = wall.declare_length()

    def strains(self, state: State, pressure: Scalar) -> Float[Array, "k ..."]:
        return jnp.stack([*wall.stretch(self, state)[:2], state.length])

    def stresses(self, history: History, strains: Float[Array, "n k"], past: Past) -> Float[Array, "n k"]:
        stiffness = self.modulus * wall.rubber_volume(self)
        times = jnp.stack([self.time_short, self.time_long])
        shares = jnp.stack([self.share, 1 - self.share])
        passed = history.step[:, None] / times
        # The mean of e^(−x) over a step, by which a stretch made during it has already relaxed.
        waiting = jnp.where(passed > 0, passed, 1.0)
        relaxed = jnp.where(passed > 0, -jnp.expm1(-waiting) / waiting, 1.0)
        axial, hoop, _ = strains.T
        elastic = wall.neo_hookean_stresses(wall.Stretch(axial, hoop, 1 / (axial * hoop)))
        steps = jnp.stack([history.increments(stress) for stress in (*elastic, past.force)], axis=1)
        kicks = steps[:, None, :] * (shares * relaxed)[:, :, None]
        branches = relax_states(kicks, jnp.exp(-passed)[:, :, None], history.restart)
        return jnp.sum(branches, axis=1) * jnp.stack([stiffness, stiffness, self.force])

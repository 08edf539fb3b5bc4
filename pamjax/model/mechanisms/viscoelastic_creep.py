"""Stress relaxation of the rubber."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from pamjax.model import wall
from pamjax.model.form_error import FormError
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractMemory, Description, Past
from pamjax.model.scan import relax_states
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter


class ViscoelasticCreep(AbstractMemory):
    """Two Maxwell branches parallel to the wall (a Prony series), on stresses of the wall or on the force:

        dq_i/dt = −q_i / τ_i + V μ_i dS/dt,   S = ½ ∂(I1 − 3)/∂(λz, λc)
        μ_1 = μ g,   μ_2 = μ (1 − g)

        dp_i/dt = −p_i / τ_i + f_i dF/dt,     f_1 = f g,  f_2 = f (1 − g),     Σ p_i is added to the force

        q_i     stress    J    of branch i on (λz, λc); Σ q_i · (λz, λc) is added to the potential
        S       stress    1    of a neo-Hookean wall, per modulus and rubber volume
        μ       modulus   Pa   shear modulus that relaxes
        g       share     1    share of the branch with the shorter time
        f       force     1    share of the muscle's total force that relaxes
        τ_1,2   times     s    relaxation times
        V                 m³   volume of the rubber, π t (d + t) l

    For τ → ∞ this is another neo-Hookean wall, minus its stress at the first sample. For τ → 0 it vanishes.
    S is assumed linear in time between samples, and is integrated exactly, so that unequal steps and long
    gaps are correct.

    It only dissipates energy. With c = S − q / (V μ_i), dc/dt = (S − c) / τ, the loss is V μ_i (S − c) ·
    (λ(S) − λ(c)) / τ. It is not negative, because the stresses of a convex energy increase with their
    stretches. Relaxation of the *net* force of the bladder could gain energy, since that force is not
    monotone in length.

    f is the empirical relaxation of the total force, for muscles whose force also creeps after a pressure
    step. At constant pressure it only dissipates energy, because force increases with length. If pressure
    changes it may gain some energy, because it does not specify which part relaxes.

    The wall is assumed to be relaxed before the recording. Neutral: μ = f = 0. It does not require
    `bladder_elasticity`. What it leaves out: more than two decades of time, dependence of relaxation on
    stretch and temperature, creep of the threads.
    Source: quasi-linear viscoelasticity (Fung 1972) in Prony form; the proof derived here.
    """

    id: ClassVar[str] = "viscoelastic_creep"
    about: ClassVar[Description] = Description(
        title="stress relaxation of the rubber",
        equation="dq_i/dt = -q_i/tau_i + V mu_i dS/dt;  W = sum q_i . (lz, lc);  S = d(I1 - 3)/d(lz, lc) / 2;"
        "  dp_i/dt = -p_i/tau_i + f_i dF/dt",
        signature="In a hold, force increases after shortening, and decreases after lengthening. The loops"
        " resemble those of friction, but have the same width at every pressure. They are widest near rest"
        " length, and become narrower over the first cycles. Diameter does not change.",
        leaves_out="relaxation times beyond the two branches, temperature, creep of the threads",
        confusable=("braid_friction", "force_drift", "mullins_softening", "viscous_damping"),
        experiment="Record holds of 300 s at one length, approached from both sides. Record a loop without"
        " pressure.",
        source="Fung 1972, quasi-linear viscoelasticity as a Prony series",
    )
    form_error: ClassVar[FormError] = FormError(
        ("pressure", "length", "pressure length", "direction"),
        alternatives=(
            {"time_short": 0.25, "time_long": 0.25},
            {"time_short": 4.0},
            {"time_long": 4.0},
        ),
    )

    modulus: Scalar = parameter(
        "Pa", show="MPa", low=0.0, high=2e6, neutral=0.0, about="shear modulus that relaxes",
        source="5 to 25 % of the rubber's shear modulus in gum rubber, more in filled rubber", default=0.0,
    )  # fmt: skip
    share: Scalar = parameter(
        "1", low=0.0, high=1.0, about="share of the relaxation with the shorter time",
        source="two branches for two decades of time", default=0.5,
    )  # fmt: skip
    time_short: Scalar = parameter(
        "s", low=0.05, high=60.0, scale="log", about="shorter relaxation time",
        source="from a sample interval to a minute", default=10.0,
    )  # fmt: skip
    time_long: Scalar = parameter(
        "s", low=10.0, high=1e4, scale="log", about="longer relaxation time", source="from a stroke to hours",
        default=200.0,
    )  # fmt: skip
    force: Scalar = parameter(
        "1", show="%", low=0.0, high=0.5, neutral=0.0, about="share of the total force that relaxes",
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
        step_ratio = history.step[:, None] / times
        # The mean of e^(−x) over a step: a stretch during the step has already relaxed to this share.
        safe_ratio = jnp.where(step_ratio > 0, step_ratio, 1.0)
        mean_decay = jnp.where(step_ratio > 0, -jnp.expm1(-safe_ratio) / safe_ratio, 1.0)
        axial, hoop, _ = strains.T
        elastic = wall.neo_hookean_stresses(wall.Stretch(axial, hoop, 1 / (axial * hoop)))
        steps = jnp.stack([history.increments(stress) for stress in (*elastic, past.force)], axis=1)
        increments = steps[:, None, :] * (shares * mean_decay)[:, :, None]
        branches = relax_states(increments, jnp.exp(-step_ratio)[:, :, None], history.restart)
        return jnp.sum(branches, axis=1) * jnp.stack([stiffness, stiffness, self.force])

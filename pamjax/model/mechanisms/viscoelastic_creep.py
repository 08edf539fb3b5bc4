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

#: Positions of the inner branches between the shortest and the longest time, on a logarithmic scale.
_BRANCH_POSITIONS = (1 / 3, 2 / 3)

#: Smallest share of the shorter or of the longer time in a power law.
_MIN_SHARE = 1e-6


class ViscoelasticCreep(AbstractMemory):
    """Four Maxwell branches parallel to the wall (a Prony series), on stresses of the wall or on the force:

        dq_i/dt = −q_i / τ_i + V μ w_i dS/dt,   S = ½ ∂(I1 − 3)/∂(λz, λc)
        dp_i/dt = −p_i / τ_i + f w_i dF/dt,     Σ p_i is added to the force
        w_i = (1 − b) (g, 0, 0, 1 − g) + b w'_i,     w'_i ~ g^(1−i/3) (1 − g)^(i/3),     Σ w'_i = 1
        τ_i = τ_1^(1−i/3) τ_2^(i/3),     i = 0, 1, 2, 3

        q_i     stress    J    of branch i on (λz, λc); Σ q_i · (λz, λc) is added to the potential
        S       stress    1    of a neo-Hookean wall, per modulus and rubber volume
        μ       modulus   Pa   shear modulus that relaxes
        g       share     1    share of the branch with the shorter time
        b       spectrum  1    0 for two relaxation times, 1 for a power law of time between them
        f       force     1    share of the muscle's total force that relaxes
        τ_1,2   times     s    shortest and longest relaxation time
        V                 m³   volume of the rubber, π t (d + t) l

    With b = 1 the weights are a power of the relaxation time, as those of a fractional element (spring-pot).
    Its order is α = ln(g / (1 − g)) / ln(τ_2 / τ_1): the stress falls as t^(−α) between the times. It falls
    with the logarithm of time for g = ½. One branch for each factor of ten in time is accurate to 4 % of the
    relaxing stress. The times may thus differ by a factor of 1000.

    For τ → ∞ this is another neo-Hookean wall, minus its stress at the first sample. For τ → 0 it vanishes.
    S is assumed linear in time between samples, and is integrated exactly, so that unequal steps and long
    gaps are correct.

    It only dissipates energy. With c = S − q / (V μ w_i), dc/dt = (S − c) / τ, the loss is V μ w_i (S − c) ·
    (λ(S) − λ(c)) / τ. It is not negative, because the stresses of a convex energy increase with their
    stretches. Relaxation of the *net* force of the bladder could gain energy, since that force is not
    monotone in length.

    f is the empirical relaxation of the total force, for muscles whose force also creeps after a pressure
    step. At constant pressure it only dissipates energy, because force increases with length. If pressure
    changes it may gain some energy, because it does not specify which part relaxes.

    The wall is assumed to be relaxed before the recording. Neutral: μ = f = 0. It does not require
    `bladder_elasticity`. Neglects: more than three decades of time, dependence of relaxation
    on stretch and temperature, creep of the threads.
    Source: quasi-linear viscoelasticity (Fung 1972) in Prony form; Bagley & Torvik, J. Rheol. 27, 201
    (1983) for fractional elements; the proof and the weights derived here.
    """

    id: ClassVar[str] = "viscoelastic_creep"
    about: ClassVar[Description] = Description(
        title="stress relaxation of the rubber",
        equation="dq_i/dt = -q_i/tau_i + V mu w_i dS/dt;  W = sum q_i . (lz, lc);"
        "  S = d(I1 - 3)/d(lz, lc) / 2\n"
        "dp_i/dt = -p_i/tau_i + f w_i dF/dt;  w = (g, 0, 0, 1 - g), or a power law of tau_i with b = 1",
        signature="In a hold, force increases after shortening, and decreases after lengthening. The loops"
        " resemble those of friction, but have the same width at every pressure. They are widest near rest"
        " length, and become narrower over the first cycles. Diameter does not change.",
        neglects="relaxation times outside the range of the branches, temperature, creep of the threads",
        confusable=("braid_friction", "force_drift", "mullins_softening", "viscous_damping"),
        experiment="Record holds of 300 s at one length, approached from both sides. Record a loop without"
        " pressure.",
        source="Fung 1972, quasi-linear viscoelasticity as a Prony series; Bagley & Torvik 1983 (power law)",
    )
    form_error: ClassVar[FormError] = FormError(
        ("pressure", "length", "pressure length", "direction"),
        shape_factors=(
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

    spectrum: Scalar = parameter(
        "1", low=0.0, high=1.0, is_refinement=True,
        about="share of a power-law spectrum between the two relaxation times",
        source="0 for two branches; 1 for a power law, which gum rubber follows over many decades",
        default=0.0,
    )  # fmt: skip

    def strains(self, state: State, pressure: Scalar) -> Float[Array, "k ..."]:
        return jnp.stack([*wall.stretch(self, state)[:2], state.length])

    def list_branches(self) -> tuple[Float[Array, " 4"], Float[Array, " 4"]]:
        """Return the relaxation times, s, and the shares of the branches."""
        position = jnp.asarray(_BRANCH_POSITIONS)
        between = self.time_short ** (1 - position) * self.time_long**position
        times = jnp.concatenate([self.time_short[None], between, self.time_long[None]])
        # Not exactly zero: the slope of its root would be infinite.
        share = jnp.clip(self.share, _MIN_SHARE, 1 - _MIN_SHARE)
        along = jnp.asarray((0.0, *_BRANCH_POSITIONS, 1.0))
        power_law = share ** (1 - along) * (1 - share) ** along
        power_law = power_law / jnp.sum(power_law)
        zero = jnp.zeros_like(self.share)
        ends = jnp.stack([self.share, zero, zero, 1 - self.share])
        return times, (1 - self.spectrum) * ends + self.spectrum * power_law

    def stresses(self, history: History, strains: Float[Array, "n k"], past: Past) -> Float[Array, "n k"]:
        stiffness = self.modulus * wall.rubber_volume(self)
        times, shares = self.list_branches()
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

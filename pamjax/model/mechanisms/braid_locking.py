"""The threads jam at an end of the stroke."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model import braid
from pamjax.model.mechanism import AbstractStore, Description
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter

#: Share of a thread's width over which contact sets in: threads are neither round nor equally wide.
CONTACT_ROUNDING = 0.01


class BraidLocking(AbstractStore):
    """Threads that lie closer than they are wide press on each other, at either end of the stroke:

        W = ½ K V° ⟨1 − S/w⟩²,   S = (B/N) sin 2θ,   sin θ = L/B

        S   spacing      m    of neighbouring threads, all n side by side: n times that of two
        w   width        m    of all threads side by side, n times that of one
        K   stiffness    Pa   of the jammed braid
        V°               m³   B³/(4πN²), so that K does not depend on the muscle's size
        ⟨ ⟩                   none below zero, with a corner rounded over a hundredth

    S is largest at 45° and the same at θ and 90° − θ. The force at a fixed thread,
    −K V° ⟨1 − S/w⟩ 2 cos 2θ / (w N cos θ), pulls where θ > 45° and pushes where θ < 45°.
    Only the width of all threads together can be found, not their number.

    Neutral: K = 0. What it leaves out: friction, which rises where threads jam; threads that flatten for
    good; the narrower ends of a tapered muscle, where threads at high angles meet first.
    Source: spacing derived here; jamming after Davis & Caldwell, Int. J. Robot. Res. 25, 359 (2006).
    """

    id: ClassVar[str] = "braid_locking"
    about: ClassVar[Description] = Description(
        title="the threads jam at an end of the stroke",
        equation="W = K/2 B^3/(4 pi N^2) <1 - S/w>^2,   S = (B/N) sin(2 theta)",
        signature="Force beyond a sharp end of the stroke only, steep, by the same newtons at every pressure:"
        " a pull in the stretched muscle, a push near full contraction. Diameter is right.",
        leaves_out="friction of the jammed threads, their flattening, the ends of the muscle",
        confusable=("bladder_elasticity", "force_offset", "length_offset"),
        experiment="A stroke without pressure, and whether the force has a corner: rubber has none.",
        source="Davis & Caldwell 2006; spacing and energy derived here",
    )

    stiffness: Scalar = parameter(
        "Pa", show="MPa", low=0.0, high=2e7, neutral=0.0, about="stiffness of the jammed braid",
        source="0.2 MPa gives some hundred newtons on a 22 mm muscle; wide, since nobody measured it",
        default=0.0,
    )  # fmt: skip
    width: Scalar = parameter(
        "m", show="mm", low=1e-4, high=20.0, scale="log", about="width of all threads side by side",
        source="some tens of threads of 0.05 mm to some hundreds of 2 mm and more", default=0.158,
    )  # fmt: skip

    def energy(self, state: State) -> Array:
        length, thread, turns = state.length, state.thread, state.turns
        squared = braid.radius_squared(length, thread, turns)
        there = squared > 0
        around = 2 * jnp.pi * turns * jnp.sqrt(jnp.where(there, squared, 1.0))
        spacing = jnp.where(there, 2 * length * around / (thread * turns), 0.0)
        closer = 1 - spacing / self.width
        closer = 0.5 * (closer + jnp.sqrt(closer**2 + CONTACT_ROUNDING**2))
        return self.stiffness * thread**3 / (8 * jnp.pi * turns**2) * closer**2

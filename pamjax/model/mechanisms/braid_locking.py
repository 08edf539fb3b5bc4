"""Jamming of the threads at either end of the stroke."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model import braid
from pamjax.model.form_error import FormError, list_powers
from pamjax.model.mechanism import AbstractStoredEnergy, Description
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter

#: Smallest overlap, over the width: less than the rounded corner has at any possible spacing.
_MIN_OVERLAP = 1e-12


class BraidLocking(AbstractStoredEnergy):
    """Threads press on each other where their spacing is less than their width, at either end of the stroke:

        W = K V° ⟨1 − S/w⟩^(m+1) / (m + 1),   S = (b/N) sin 2θ,   sin θ = L/b,   b = B0 + s (B − B0)

        S   spacing      m    of neighbouring threads, times the number n of threads
        w   width        m    of one thread, times the number n of threads
        K   stiffness    Pa   of the jammed braid
        m   exponent     1    power of the overlap in the force
        s   stretch      1    share of the thread's stretch B − B0 that changes the spacing
        V°               m³   b³/(4πN²), so that K does not depend on the size of the muscle
        ρ   rounding     1    share of the width over which contact begins: threads are not equally wide
        ⟨c⟩                   rounded positive part, [c + √(c² + ρ²)] / 2

    With s = 0 the stretch only straightens filaments between crossings, and the force is the same at every
    pressure. With s = 1 the crossings move apart with the stretch, and pressure opens the contact.

    S is largest at 45°, and equal at θ and 90° − θ. The force at a constant thread length is
    −K V° ⟨1 − S/w⟩^m 2 cos 2θ / (w N cos θ). It pulls where θ > 45° and pushes where θ < 45°.
    The exponent is 1 for threads that touch along a line, 3/2 for round patches, and about 3 for bundles of
    fibres that are compacted. The rounded overlap is positive, so that force and derivatives are finite.
    Only the total width of all threads is identifiable, not their number.

    Neutral: K = 0. Neglects: increased friction of jammed threads, permanent flattening of threads,
    the smaller radius near the fittings, where threads at large angles meet first.
    Source: spacing derived here; jamming after Davis & Caldwell, Int. J. Robot. Res. 25, 359 (2006); exponent
    after Hertz and van Wyk, J. Text. Inst. 37, T285 (1946).
    """

    id: ClassVar[str] = "braid_locking"
    about: ClassVar[Description] = Description(
        title="jamming of the threads at a stroke end",
        equation="W = K/(m + 1) b^3/(4 pi N^2) <1 - S/w>^(m+1),   S = (b/N) sin(2 theta)\n"
        "sin(theta) = L/b,   b = B0 + s (B - B0)",
        signature="An additional force acts only beyond a sharp limit at an end of the stroke. It is steep,"
        " and the same in newtons at every pressure. It pulls in the stretched muscle, and pushes near full"
        " contraction. The diameter is not affected.",
        neglects="friction of the jammed threads, flattening of threads, the shape of the ends",
        confusable=("bladder_elasticity", "force_offset", "length_offset"),
        experiment="Record a stroke without pressure. The force by jamming has a corner, that by rubber has"
        " none.",
        source="Davis & Caldwell 2006; van Wyk 1946 (exponent); spacing and energy derived here",
    )
    #: Stretch of the threads moves the limit with pressure.
    form_error: ClassVar[FormError] = FormError(
        (*list_powers("length", 4), *list_powers("pressure", 2), "pressure length", "pressure length^2")
    )

    stiffness: Scalar = parameter(
        "Pa", show="MPa", low=0.0, high=2e7, neutral=0.0, about="stiffness of the jammed braid",
        source="0.2 MPa gives some hundred newtons on a 22 mm muscle; wide range, no measurement exists",
        default=0.0,
    )  # fmt: skip
    width: Scalar = parameter(
        "m", show="mm", low=1e-4, high=20.0, scale="log", about="total width of all threads side by side",
        source="from some tens of threads of 0.05 mm to some hundreds of 2 mm or more", default=0.158,
    )  # fmt: skip

    exponent: Scalar = parameter(
        "1", low=0.5, high=4.0, is_refinement=True, about="exponent of the overlap in the force",
        source="1 for contact along a line, 3/2 for round patches, 3 for compacted fibres", default=1.0,
    )  # fmt: skip

    rounding: Scalar = parameter(
        "1", low=1e-3, high=0.3, scale="log", is_refinement=True,
        about="share of the width over which contact begins",
        source="0.01 for equal round threads; more if their widths or spacings differ", default=0.01,
    )  # fmt: skip

    stretch: Scalar = parameter(
        "1", low=0.0, high=1.0, is_refinement=True,
        about="share of the thread's stretch that changes the spacing",
        source="0 if the stretch only straightens filaments; 1 for a solid thread", default=0.0,
    )  # fmt: skip

    unloaded_thread: Scalar | None = None

    def prepare(self, thread_length: Scalar, turns: Scalar) -> BraidLocking:
        return eqx.tree_at(lambda m: m.unloaded_thread, self, thread_length, is_leaf=lambda x: x is None)

    def energy(self, state: State) -> Array:
        length, thread, turns = state.length, state.thread, state.turns
        if self.unloaded_thread is not None:
            thread = self.unloaded_thread + self.stretch * (thread - self.unloaded_thread)
        squared = braid.radius_squared(length, thread, turns)
        is_valid = squared > 0
        circumference = 2 * jnp.pi * turns * jnp.sqrt(jnp.where(is_valid, squared, 1.0))
        spacing = jnp.where(is_valid, 2 * length * circumference / (thread * turns), 0.0)
        overlap = 1 - spacing / self.width
        overlap = 0.5 * (overlap + jnp.sqrt(overlap**2 + self.rounding**2))
        # Far from contact, rounding may cancel the overlap: the power of zero has no derivative.
        overlap = jnp.maximum(overlap, _MIN_OVERLAP)
        power = self.exponent + 1
        return self.stiffness * thread**3 / (4 * jnp.pi * turns**2) * overlap**power / power

"""Softening of the rubber by stretch: at once (Mullins effect), or little by little over many cycles."""

from __future__ import annotations

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from pamjax.model import wall
from pamjax.model.form_error import FormError, list_powers
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractMemory, Description, Past
from pamjax.model.scan import relax_states, running_max
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter

#: Minimum energy of the wall, per modulus and rubber volume, of a stretch: that of a strain of 0.001.
MIN_WALL_ENERGY = 1e-6


class MullinsSoftening(AbstractMemory):
    """Two additional parts of the wall's energy, which stretching removes:

        stress  s = μ η + κ ζ  on  e = V (I1 − 3) / 2
        η = 1 − erf[(m − e) / (w m)],     ζ = e^(−a / x),     da = |d(I1 − 3)|

        μ   modulus   Pa   additional shear modulus during the first stretch
        e   energy    m³   energy of the wall per modulus; V is the volume of the rubber, π t (d + t) l
        m             m³   largest e so far
        η             1    one during the first stretch, decreasing to zero during unloading
        w   width     1    range over which η decreases, relative to the largest energy
        κ   cyclic    Pa   additional shear modulus that disappears over many cycles
        a             1    sum of all changes of I1 − 3 so far
        x   travel    1    a at which this modulus has decreased to 1/e

    At any e, η decreases with m, so that a closed path never gains energy. The energy κ ζ e is damaged: at a
    fixed e it only decreases, so that a path gains at most what was stored at its start. In equal cycles κ ζ
    falls exponentially with their number, which is the usual law of preconditioning.

    The first sample counts as first stretch, because the earlier history is unknown. The samples of a static
    map have no order, so that a static map has no softening. Neutral: μ = κ = 0. It does not require
    `bladder_elasticity`. Neglects: permanent set, recovery over hours. Noise of the length counts as travel.
    Source: after Ogden & Roxburgh, Proc. R. Soc. A 455, 2861 (1999), with r = 1 on a separate energy; damage
    by the arc length of the strain after Miehe, Eur. J. Mech. A 14, 697 (1995).
    """

    id: ClassVar[str] = "mullins_softening"
    about: ClassVar[Description] = Description(
        title="softening of the rubber after its first stretch",
        equation="W = (mu eta + kappa zeta) V (I1 - 3)/2,   eta = 1 - erf((m - e)/(w m)),"
        "   m = largest e so far\n"
        "zeta = e^(-a/x),   a = sum of |changes of I1 - 3|",
        signature="Force is lower during a stretch that the muscle has not had before. This is the first"
        " stroke, or the last part of the first stroke of each isobar that extends further. Later cycles"
        " repeat, or approach a limit over many cycles.",
        neglects="permanent set, recovery over hours",
        confusable=("viscoelastic_creep", "thread_slip", "braid_friction"),
        experiment="Record the first cycle after half a day of rest. Record isobars from high to low"
        " pressure: only the very first stroke may then differ.",
        source="after Ogden & Roxburgh 1999, Eq. for eta with r = 1; Mullins 1969; Miehe 1995 (arc length)",
    )
    form_error: ClassVar[FormError] = FormError(
        (*list_powers("pressure", 3), *list_powers("length", 3), "pressure length"),
        # The softening may act over a narrower or a wider range below the largest stretch.
        alternatives=({"width": 0.25}, {"width": 4.0}),
    )

    modulus: Scalar = parameter(
        "Pa", show="MPa", low=0.0, high=2e6, neutral=0.0,
        about="additional shear modulus during the first stretch",
        source="5 to 15 % of the rubber's shear modulus in gum rubber, 20 to 40 % in filled rubber",
        default=0.0,
    )  # fmt: skip
    width: Scalar = parameter(
        "1", low=0.01, high=1.0, scale="log", about="range of the softening, relative to the largest energy",
        source="0.1 to 0.5 in filled rubber", default=0.2,
    )  # fmt: skip
    inner_diameter: Scalar = wall.declare_inner_diameter()
    thickness: Scalar = wall.declare_thickness()
    length: Scalar = wall.declare_length()

    cyclic: Scalar = parameter(
        "Pa", show="MPa", low=0.0, high=2e6, neutral=0.0, is_refinement=True,
        about="additional shear modulus that disappears over many cycles",
        source="as the modulus; filled rubber softens most in its first ten cycles", default=0.0,
    )  # fmt: skip
    travel: Scalar = parameter(
        "1", low=1e-2, high=1e4, scale="log", is_refinement=True,
        about="sum of all changes of I1 − 3 at which the cyclic modulus has decreased to 1/e",
        source="one to ten cycles, in each of which I1 − 3 changes twice by 0.1 to 3", default=10.0,
    )  # fmt: skip

    def strains(self, state: State, pressure: Scalar) -> Float[Array, "k ..."]:
        energy = 0.5 * wall.rubber_volume(self) * wall.first_invariant(wall.stretch(self, state))
        return energy[None]

    def stresses(self, history: History, strains: Float[Array, "n k"], past: Past) -> Float[Array, "n k"]:
        largest = running_max(strains, history.restart)
        volume = wall.rubber_volume(self)
        recovered_share = jax.lax.erf((largest - strains) / (self.width * largest + MIN_WALL_ENERGY * volume))
        changes = jnp.abs(history.increments(strains[:, 0]))[:, None]
        travel = relax_states(changes, jnp.ones_like(changes), history.restart)
        cyclic_share = jnp.exp(-2 * travel / (volume * self.travel))
        return jnp.where(
            jnp.all(history.restart),
            0.0,
            self.modulus * (1 - recovered_share) + self.cyclic * cyclic_share,
        )

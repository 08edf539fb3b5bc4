"""The first stretch of the rubber is stiffer than the later ones."""

from __future__ import annotations

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from pamjax.model import wall
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractMemory, Description, Past
from pamjax.model.scan import running_max
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter

#: Least energy of the wall, per modulus and rubber, at which stretch counts: of a strain of a thousandth.
MIN_WALL_ENERGY = 1e-6


class MullinsSoftening(AbstractMemory):
    """An extra share of the wall's energy that only virgin stretch meets:

        stress  s = μ η  on  e = V (I1 − 3) / 2,   η = 1 − erf[(m − e) / (w m)]

        μ   modulus   Pa   shear modulus that the first stretch meets beyond the later ones
        e   energy    m³   of the wall, per modulus; V the rubber, π t (d + t) l
        m             m³   the largest e so far
        η             1    one while the stretch is virgin, falling to zero on the way back
        w   width     1    share of the largest energy over which it falls

    η falls with m at any e, so that a closed path never gains energy. The first sample counts as
    virgin: nothing is known of the time before. A static map has no order, so that nothing in it is
    virgin. Neutral: μ = 0. It needs no `bladder_elasticity`. What it leaves out: a lasting set, recovery
    over hours, softening that goes on over many cycles.
    Source: after Ogden & Roxburgh, Proc. R. Soc. A 455, 2861 (1999), with r = 1 on a share of its own.
    """

    id: ClassVar[str] = "mullins_softening"
    about: ClassVar[Description] = Description(
        title="the first stretch of the rubber is stiffer than the later ones",
        equation="W = mu eta V (I1 - 3)/2,   eta = 1 - erf((m - e)/(w m)),   m = largest e so far",
        signature="Force is lower on stretch that the muscle has never had before: the first stroke, or the"
        " last part of the first stroke of each isobar that goes further. Later cycles repeat.",
        leaves_out="a lasting set, recovery over hours, softening over many cycles",
        confusable=("viscoelastic_creep", "thread_slip", "braid_friction"),
        experiment="The first cycle after half a day of rest, and isobars from high to low pressure: only"
        " the very first stroke may then differ.",
        source="after Ogden & Roxburgh 1999, Eq. for eta with r = 1; Mullins 1969",
    )

    modulus: Scalar = parameter(
        "Pa", show="MPa", low=0.0, high=2e6, neutral=0.0, about="shear modulus only virgin stretch meets",
        source="5 to 15 % of the rubber's own in gum rubber, 20 to 40 % in filled rubber", default=0.0,
    )  # fmt: skip
    width: Scalar = parameter(
        "1", low=0.01, high=1.0, scale="log", about="share of the largest energy over which it fades",
        source="0.1 to 0.5 of the largest energy in filled rubber", default=0.2,
    )  # fmt: skip
    inner_diameter: Scalar = wall.declare_inner_diameter()
    thickness: Scalar = wall.declare_thickness()
    length: Scalar = wall.declare_length()

    def strains(self, state: State, pressure: Scalar) -> Float[Array, "k ..."]:
        energy = 0.5 * wall.rubber_volume(self) * wall.first_invariant(wall.stretch(self, state))
        return energy[None]

    def stresses(self, history: History, strains: Float[Array, "n k"], past: Past) -> Float[Array, "n k"]:
        largest = running_max(strains, history.restart)
        least = MIN_WALL_ENERGY * wall.rubber_volume(self)
        left = jax.lax.erf((largest - strains) / (self.width * largest + least))
        return jnp.where(jnp.all(history.restart), 0.0, self.modulus * (1 - left))

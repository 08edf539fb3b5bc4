"""Softening of the rubber after its first stretch (Mullins effect)."""

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
    """An additional part of the wall's energy that acts only during the first stretch:

        stress  s = μ η  on  e = V (I1 − 3) / 2,   η = 1 − erf[(m − e) / (w m)]

        μ   modulus   Pa   additional shear modulus during the first stretch
        e   energy    m³   energy of the wall per modulus; V is the volume of the rubber, π t (d + t) l
        m             m³   largest e so far
        η             1    one during the first stretch, decreasing to zero during unloading
        w   width     1    range over which η decreases, relative to the largest energy

    A refinement adds softening that continues in every cycle. It decreases with the path length β of e:

        stress  s = μ η + μ_c exp[−β / (κ V)]

        μ_c cyclic_modulus  Pa   additional shear modulus at the first sample
        β                   m³   sum of all changes |de| so far
        κ   cyclic_energy   1    β / V at which 1/e of this part remains

    At any e, η decreases with m, so that a closed path never gains energy. With the refinement it gains at
    most what the wall stored at the first sample. The first sample counts as first stretch, because the
    earlier history is unknown. The samples of a static map have no order, so that a static map has no first
    stretch. Neutral: μ = μ_c = 0. It does not require `bladder_elasticity`. Neglects: permanent set, recovery
    over hours. Noise of the length increases β.
    Source: after Ogden & Roxburgh, Proc. R. Soc. A 455, 2861 (1999), with r = 1 on a separate energy;
    refinement after Miehe, Eur. J. Mech. A 14, 697 (1995), continuous damage without a remaining part.
    """

    id: ClassVar[str] = "mullins_softening"
    about: ClassVar[Description] = Description(
        title="softening of the rubber after its first stretch",
        equation="W = mu eta e,   e = V (I1 - 3)/2,   eta = 1 - erf((m - e)/(w m)),   m = largest e so far\n"
        "refinement: W = mu_c exp(-b/(kappa V)) e,   b = sum of |de| so far",
        signature="Force is lower during a stretch that the muscle has not had before. This is the first"
        " stroke, or the last part of the first stroke of each isobar that extends further. Later cycles"
        " repeat.",
        neglects="permanent set, recovery over hours",
        confusable=("viscoelastic_creep", "thread_slip", "braid_friction"),
        experiment="Record the first cycle after half a day of rest. Record isobars from high to low"
        " pressure: only the very first stroke may then differ.",
        source="after Ogden & Roxburgh 1999, Eq. for eta with r = 1; Mullins 1969; Miehe 1995 (refinement)",
    )
    form_error: ClassVar[FormError] = FormError(
        (*list_powers("pressure", 3), *list_powers("length", 3), "pressure length"),
        # The softening may act over a narrower or a wider range below the largest stretch.
        shape_factors=({"width": 0.25}, {"width": 4.0}),
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

    cyclic_modulus: Scalar = parameter(
        "Pa", show="MPa", low=0.0, high=2e6, neutral=0.0, is_refinement=True,
        about="additional shear modulus that decreases in every cycle",
        source="as for the first stretch", default=0.0,
    )  # fmt: skip
    cyclic_energy: Scalar = parameter(
        "1", low=0.01, high=100.0, scale="log", is_refinement=True,
        about="accumulated strain energy, per modulus and volume, after which 1/e of it remains",
        source="from a fraction of a stroke to many cycles", default=1.0,
    )  # fmt: skip

    def strains(self, state: State, pressure: Scalar) -> Float[Array, "k ..."]:
        energy = 0.5 * wall.rubber_volume(self) * wall.first_invariant(wall.stretch(self, state))
        return energy[None]

    def stresses(self, history: History, strains: Float[Array, "n k"], past: Past) -> Float[Array, "n k"]:
        volume = wall.rubber_volume(self)
        largest = running_max(strains, history.restart)
        lost = jax.lax.erf((largest - strains) / (self.width * largest + MIN_WALL_ENERGY * volume))
        steps = jnp.abs(jax.vmap(history.increments, 1, 1)(strains))
        path = relax_states(steps, jnp.ones_like(steps), history.restart)
        cyclic = self.cyclic_modulus * jnp.exp(-path / (self.cyclic_energy * volume))
        return jnp.where(jnp.all(history.restart), 0.0, self.modulus * (1 - lost) + cyclic)

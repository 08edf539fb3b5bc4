"""Damping force that increases with speed."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from pamjax.model.form_error import FormError
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractMemory, Description, Past
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter

#: Speed at which the coefficient is defined, and speed below which a muscle is nearly at rest, m/s.
_REFERENCE_SPEED, _REST_SPEED = 1e-3, 2e-5


class ViscousDamping(AbstractMemory):
    """A damper between the fittings; its force is positive while the muscle lengthens:

        F = (c + b P) (1 + a sgn v) v |v/v1|^(m−1),    v = dL/dt,   v1 = 1 mm/s

        c  coefficient  N s/m     damping coefficient at v1 that does not depend on pressure
        b  pressed      N s/m/Pa  increase of the damping coefficient per pascal
        m  power        1         exponent of speed; 1 is a Newtonian damper
        a  asymmetry    1         damping for lengthening 1 + a, for shortening 1 − a

    At |a| <= 1 the damper never supplies energy. At a constant speed, asymmetry adds the same force in both
    directions. There it resembles a zero error of the force.

    Neutral: c = b = 0. Neglects: speeds that change within five samples, over which the rate is computed.
    Source: Newton's damper; in muscles, Reynolds, Repperger, Phillips & Bandry, Ann. Biomed. Eng. 31,
    310, 2003.
    """

    id: ClassVar[str] = "viscous_damping"
    uses_rate: ClassVar[bool] = True
    about: ClassVar[Description] = Description(
        title="damping force that increases with speed",
        equation="F = F0 + (c + b P) (1 + a sgn v) v |v/v1|^(m-1)",
        signature="Force is higher while the muscle lengthens and lower while it shortens, in proportion to"
        " speed. The difference is the same at every length. It is the same at every pressure, or increases"
        " in proportion to it. In a hold it is zero.",
        neglects="speeds that change within five samples",
        confusable=("braid_friction", "pressure_drop", "channel_lag", "viscoelastic_creep"),
        experiment="Repeat the stroke three times as fast: the loop is three times as wide.",
        source="Newton's damper; Reynolds et al. 2003",
    )
    form_error: ClassVar[FormError] = FormError(
        ("pressure", "length", "pressure length", "speed", "direction")
    )

    coefficient: Scalar = parameter(
        "N*s/m", low=0.0, high=1e6, neutral=0.0, about="damping coefficient at 1 mm/s, without pressure",
        source="0.1 to 5 kN s/m in muscles; the limit is two orders of magnitude higher", default=0.0,
    )  # fmt: skip
    pressed: Scalar = parameter(
        "N*s/m/Pa", low=0.0, high=10.0, neutral=0.0, about="increase of the damping coefficient per pascal",
        source="as for the coefficient, at 100 kPa", default=0.0,
    )  # fmt: skip

    power: Scalar = parameter(
        "1", low=0.2, high=2.0, about="exponent of speed in the damping force",
        source="1 for an oil film, less where the film becomes thinner", default=1.0,
    )  # fmt: skip
    asymmetry: Scalar = parameter(
        "1", low=-1.0, high=1.0, is_refinement=True,
        about="relative excess of the damping while the muscle lengthens",
        source="damping of muscles differs between inflation and deflation; at 1 one direction has none",
        default=0.0,
    )  # fmt: skip

    def strains(self, state: State, pressure: Scalar) -> Float[Array, "1 ..."]:
        return jnp.stack([state.length])

    def stresses(self, history: History, strains: Float[Array, "n 1"], past: Past) -> Float[Array, "n 1"]:
        damping = self.coefficient + self.pressed * jnp.maximum(past.pressure, 0.0)
        rate = history.rate(strains[:, 0])
        # Rounded at rest, where a power below one has an infinite slope.
        speed = (rate**2 + _REST_SPEED**2) / (_REFERENCE_SPEED**2 + _REST_SPEED**2)
        direction = rate / jnp.sqrt(rate**2 + _REST_SPEED**2)
        force = damping * (1 + self.asymmetry * direction) * rate * speed ** (0.5 * (self.power - 1))
        return force[:, None]

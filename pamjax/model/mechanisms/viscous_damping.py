"""A force that grows with speed."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractMemory, Description, Past
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter

#: Speed at which the coefficient is meant, and below which a muscle hardly moves, m/s.
REFERENCE_SPEED, REST_SPEED = 1e-3, 2e-5


class ViscousDamping(AbstractMemory):
    """A damper between the fittings, positive while the muscle lengthens:

        F = (c + b P) v |v/v1|^(m−1),    v = dL/dt,   v1 = 1 mm/s

        c  coefficient  N s/m     force per speed at v1, at any pressure
        b  pressed      N s/m/Pa  what a pascal adds to it, where the air presses what moves
        m  power        1         of speed; 1 is Newton's

    Neutral: c = b = 0. What it leaves out: damping that differs between the directions;
    speeds that change within five samples, over which the rate is taken.
    Source: Newton's damper; in muscles, Reynolds, Repperger, Phillips & Bandry, Ann. Biomed. Eng. 31,
    310, 2003.
    """

    id: ClassVar[str] = "viscous_damping"
    about: ClassVar[Description] = Description(
        title="a force that grows with speed",
        equation="F = F0 + (c + b P) v |v/v1|^(m-1)",
        signature="Force is higher while the muscle lengthens and lower while it shortens, in proportion to"
        " speed, alike at every length, and at every pressure or in proportion to it; nothing in a hold.",
        leaves_out="damping that depends on direction",
        confusable=("braid_friction", "pressure_drop", "channel_lag", "viscoelastic_creep"),
        experiment="The same stroke three times as fast: the loop is three times as wide.",
        source="Newton's damper; Reynolds et al. 2003",
    )

    coefficient: Scalar = parameter(
        "N*s/m", low=0.0, high=1e6, neutral=0.0, about="force at unit speed",
        source="0.1 to 5 kN s/m in muscles, and two orders more", default=0.0,
    )  # fmt: skip
    pressed: Scalar = parameter(
        "N*s/m/Pa", low=0.0, high=10.0, neutral=0.0, about="what a pascal adds to the force at unit speed",
        source="as the coefficient, at 100 kPa", default=0.0,
    )  # fmt: skip

    power: Scalar = parameter(
        "1", low=0.2, high=2.0, about="power of speed with which the force grows",
        source="1 for a film of oil, less where the film thins", default=1.0,
    )  # fmt: skip

    def strains(self, state: State, pressure: Scalar) -> Float[Array, "1 ..."]:
        return jnp.stack([state.length])

    def stresses(self, history: History, strains: Float[Array, "n 1"], past: Past) -> Float[Array, "n 1"]:
        damping = self.coefficient + self.pressed * jnp.maximum(past.pressure, 0.0)
        rate = history.rate(strains[:, 0])
        # Rounded at rest, where a power below one would be infinitely steep.
        speed = (rate**2 + REST_SPEED**2) / (REFERENCE_SPEED**2 + REST_SPEED**2)
        return (damping * rate * speed ** (0.5 * (self.power - 1)))[:, None]

"""The rubber tube resists stretching, along and around."""

from __future__ import annotations

from typing import ClassVar

from jaxtyping import Array

from pamjax.model import wall
from pamjax.model.mechanism import AbstractStore, Description
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter


class BladderElasticity(AbstractStore):
    """An incompressible rubber tube, neo-Hookean to Mooney-Rivlin:

        W = V μ/2 [(1 − m) (I1 − 3) + m (I2 − 3)]

        μ       modulus   Pa   shear modulus at small strain, a third of Young's
        m       mooney    1    share of the second invariant: C10 = μ (1 − m) / 2, C01 = μ m / 2
        V                 m³   rubber, π t (d + t) l
        I1, I2            1    invariants of the stretches of the wall (`wall.py`)

    Force and thread balance follow by differentiation: F = (V / L)(σz − σc tan²θ) for a thin wall, and
    the pressure σc t / R is spent on the rubber before any reaches the threads. Below it the bench lets
    the bladder stand off the braid.

    Neutral: μ = 0. What it leaves out: strain stiffening near the end of the chains, relaxation,
    softening, temperature; pressure of the air in a wall that is not incompressible.
    Source: Klute & Hannaford, J. Dyn. Syst. Meas. Control 122, 386 (2000), for Mooney-Rivlin; Kothera et
    al., J. Mech. Des. 131, 091010 (2009); the mid-surface form derived here.
    """

    id: ClassVar[str] = "bladder_elasticity"
    about: ClassVar[Description] = Description(
        title="the rubber tube resists stretching, along and around",
        equation="W = V mu/2 [(1 - m)(I1 - 3) + m (I2 - 3)];   F = (V/L)(s_z - s_c tan^2 theta)",
        signature="Force is lost by the same newtons at every pressure, most at a tenth of contraction;"
        " free contraction shortens most at low pressure; below a threshold that rises with contraction"
        " the force is gone and diameter is that of the free tube. No loop, no rate.",
        leaves_out="stiffening at very large stretch, relaxation, softening, temperature",
        confusable=("contact_pressure", "pressure_offset", "force_offset", "end_taper"),
        experiment="A stroke without pressure, bladder only; or strokes at two pressures: the rubber's share"
        " is the same in newtons, that of the ends grows with pressure.",
        source="Klute & Hannaford 2000; Kothera et al. 2009; mid-surface form derived here",
    )

    modulus: Scalar = parameter(
        "Pa", show="MPa", low=0.0, high=5e6, neutral=0.0, about="shear modulus, a third of Young's",
        source="silicone 0.05-0.3, latex 0.3-0.5, nitrile and chloroprene to 1.5 MPa", default=0.0,
    )  # fmt: skip
    mooney: Scalar = parameter(
        "1", low=0.0, high=1.0, about="share of the second invariant, C01 / (C10 + C01)",
        source="0 is neo-Hookean; about 0.1 to 0.5 in gum rubber", default=0.0,
    )  # fmt: skip
    inner_diameter: Scalar = wall.declare_inner_diameter()
    thickness: Scalar = wall.declare_thickness()
    length: Scalar = wall.declare_length()

    def energy(self, state: State) -> Array:
        stretch = wall.stretch(self, state)
        first, second = wall.first_invariant(stretch), wall.second_invariant(stretch)
        return 0.5 * self.modulus * wall.rubber_volume(self) * (first + self.mooney * (second - first))

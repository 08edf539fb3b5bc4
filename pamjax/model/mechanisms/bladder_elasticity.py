"""Elasticity of the rubber bladder, along and around."""

from __future__ import annotations

from typing import ClassVar

from jaxtyping import Array

from pamjax.model import wall
from pamjax.model.form_error import FormError, list_powers
from pamjax.model.mechanism import AbstractStoredEnergy, Description
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter


class BladderElasticity(AbstractStoredEnergy):
    """An incompressible rubber tube with a Mooney-Rivlin energy, which is neo-Hookean for m = k = 0:

        W = V μ/2 [(1 − m) (I1 − 3) + m (I2 − 3) + k (I1 − 3)²]

        μ       modulus   Pa   shear modulus at small strain, a third of Young's modulus
        m       mooney    1    share of the second invariant: C10 = μ (1 − m) / 2, C01 = μ m / 2
        k       stiffening 1   Yeoh's second coefficient over the first, C20 / C10 for m = 0
        V                 m³   volume of the rubber, π t (d + t) l
        I1, I2            1    invariants of the stretches of the wall (`wall.py`)

    Differentiation gives force and thread load. For a thin wall, F = (V / L)(σz − σc tan²θ). The rubber
    carries the pressure σc t / R, and only the excess loads the threads. Below this pressure the bladder has
    no contact with the braid.

    With k the rubber stiffens at large stretch. A rubber with Gent's limit J has k = 1 / (2 J) to first
    order.

    Neutral: μ = 0. Neglects: the initial softening of filled rubber and the limit of its stretch,
    relaxation, softening by the first stretch, temperature, compressibility of the wall.
    Source: Klute & Hannaford, J. Dyn. Syst. Meas. Control 122, 386 (2000), for Mooney-Rivlin; Kothera et
    al., J. Mech. Des. 131, 091010 (2009); Yeoh, Rubber Chem. Technol. 66, 754 (1993); the mid-surface form
    derived here.
    """

    id: ClassVar[str] = "bladder_elasticity"
    about: ClassVar[Description] = Description(
        title="elasticity of the rubber bladder",
        equation="W = V mu/2 [(1 - m)(I1 - 3) + m (I2 - 3) + k (I1 - 3)^2]\nF = (V/L)(s_z - s_c tan^2 theta)",
        signature="The force loss is the same in newtons at every pressure, and largest at 10 % contraction."
        " Free contraction decreases, most at low pressure. Below a threshold pressure, which increases with"
        " contraction, the force is zero and the diameter is that of the free tube. There is no hysteresis,"
        " and no dependence on speed.",
        neglects="the limit of stretch, relaxation, softening, temperature",
        confusable=("contact_pressure", "pressure_offset", "force_offset", "end_taper"),
        experiment="Record a stroke without pressure, in which only the bladder acts. Or record strokes at"
        " two pressures: the force loss by rubber is the same in newtons, that by tapered ends increases"
        " with pressure.",
        source="Klute & Hannaford 2000; Kothera et al. 2009; Yeoh 1993; mid-surface form derived here",
    )
    form_error: ClassVar[FormError] = FormError((*list_powers("length", 4), "pressure"))

    modulus: Scalar = parameter(
        "Pa", show="MPa", low=0.0, high=5e6, neutral=0.0, about="shear modulus, a third of Young's modulus",
        source="silicone 0.05-0.3, latex 0.3-0.5, nitrile and chloroprene up to 1.5 MPa", default=0.0,
    )  # fmt: skip
    mooney: Scalar = parameter(
        "1", low=0.0, high=1.0, about="share of the second invariant, C01 / (C10 + C01)",
        source="0 is neo-Hookean; about 0.1 to 0.5 in gum rubber", default=0.0,
    )  # fmt: skip
    inner_diameter: Scalar = wall.declare_inner_diameter()
    thickness: Scalar = wall.declare_thickness()
    length: Scalar = wall.declare_length()

    stiffening: Scalar = parameter(
        "1", low=0.0, high=0.5, is_refinement=True,
        about="Yeoh's stiffening, C20 / C10 of a neo-Hookean rubber",
        source="0.005 to 0.05 for gum rubber, from a limit of I1 - 3 between 100 and 10; more if filled",
        default=0.0,
    )  # fmt: skip

    def energy(self, state: State) -> Array:
        stretch = wall.stretch(self, state)
        first, second = wall.first_invariant(stretch), wall.second_invariant(stretch)
        invariants = first + self.mooney * (second - first) + self.stiffening * first**2
        return 0.5 * self.modulus * wall.rubber_volume(self) * invariants

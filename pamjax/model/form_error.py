"""Where the equation of a mechanism may be inexact.

Real effects follow textbook equations to some 10 to 30 %. The difference is smooth and proportional to the
effect. A mechanism declares the variables in which it may differ:

    effect = textbook effect · (1 + Σ c_j φ_j),     φ_j products of Legendre polynomials of the variables,

or, for an effect that is a course in time (`is_additive`), rms(effect) · Σ c_j cos(πkt/T) in addition.

    pressure, length   scaled to −1 … 1 over the rows in which the mechanism acts
    force              measured force, scaled to −1 … 1
    direction          −1 while the muscle shortens, 1 while it lengthens, 0 at a hold
    speed              decimal logarithm of the speed over its median
    time               scaled to 0 … 1; its power k is cos(πkt)

Source: discrepancy as a multiplicative Gaussian process, M. Kennedy & A. O'Hagan, J. R. Stat. Soc. B 63, 425
(2001); J. Brynjarsdóttir & A. O'Hagan, Inverse Problems 30, 114007 (2014).
"""

from __future__ import annotations

from dataclasses import dataclass

#: Variables of the terms.
FORM_VARIABLES = ("pressure", "length", "force", "direction", "speed", "time")


@dataclass(frozen=True)
class FormError:
    """The terms of a form error.

    Attributes:
        terms: products as "pressure length^2".
        is_additive: whether the terms are added to the effect instead of multiplied with it.
        shape_factors: factors on shape parameters. The effect with other shape parameters, without its
            part in proportion to the effect itself, is one more term each.
    """

    terms: tuple[str, ...] = ()
    is_additive: bool = False
    shape_factors: tuple[dict[str, float], ...] = ()

    def parse(self) -> list[list[tuple[str, int]]]:
        """Return the factors (variable, degree) of each term.

        >>> FormError(("pressure length^2",)).parse()
        [[('pressure', 1), ('length', 2)]]
        """
        return [parse_term(term) for term in self.terms]

    @property
    def is_course(self) -> bool:
        """Return whether a term depends on time: the form error then belongs to one recording.

        >>> FormError(("time^2",)).is_course
        True
        """
        return any(variable == "time" for term in self.parse() for variable, _ in term)


def parse_term(term: str) -> list[tuple[str, int]]:
    """Return the factors (variable, degree) of a term.

    >>> parse_term("pressure length^2")
    [('pressure', 1), ('length', 2)]
    """
    words = (word.partition("^") for word in term.split())
    return [(variable, int(degree or 1)) for variable, _, degree in words]


def list_powers(variable: str, degree: int) -> tuple[str, ...]:
    """Return the terms of one variable up to a degree.

    >>> list_powers("length", 3)
    ('length', 'length^2', 'length^3')
    """
    return tuple(variable if k == 1 else f"{variable}^{k}" for k in range(1, degree + 1))

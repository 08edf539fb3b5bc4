"""A form of an effect that a study has drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pamjax.benchmark.other_forms.muscle import Effect
from pamjax.benchmark.other_forms.scales import BenchScales


@dataclass(frozen=True, eq=False)
class DrawnForm:
    """The shape of an effect, drawn, without its size.

    Attributes:
        id: id of the mechanism, or family outside the library.
        form: name of the form; "usual" is that of the fit.
        amplitude: name of the amplitude; for a usual form that of its parameter.
        limit: largest absolute amplitude, SI.
        build: function from an amplitude, SI, to the effect.
        shape: drawn shape parameters, SI.
        is_signed: whether the amplitude may be negative.
    """

    id: str
    form: str
    amplitude: str
    limit: float
    build: Callable[[float], Effect]
    shape: dict[str, float] = field(default_factory=dict)
    is_signed: bool = False


#: Function that draws the shape of a form for a bench.
FormDrawer = Callable[[np.random.Generator, BenchScales], DrawnForm]

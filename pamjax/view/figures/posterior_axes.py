"""Parameters and axis labels of the figures of a posterior."""

from __future__ import annotations

import numpy as np

from pamjax.infer.posterior.result import Posterior
from pamjax.infer.problem.priors import is_length_error
from pamjax.units import compute_si_factor
from pamjax.view.theme import OKABE_ITO

POSTERIOR_COLOUR = OKABE_ITO["blue"]
#: Largest number of parameters in a figure. With more, the noise parameters are left out first.
_MAX_PANELS = 9


def select_parameters(post: Posterior) -> list[int]:
    """Return indices of the shown parameters: the muscle's, and the noise's if there is room for all."""
    parameters = [k for k, name in enumerate(post.names) if not is_length_error(name)]
    muscle_parameters = [k for k in parameters if post.names[k] in post.fit.estimates]
    return parameters if len(parameters) <= _MAX_PANELS else muscle_parameters[:_MAX_PANELS]


def format_axis_label(post: Posterior, k: int) -> str:
    """Return the name of a parameter in two lines, with its display unit."""
    _, unit = post.find_units(post.names[k])
    head, _, tail = post.names[k].rpartition(".")
    return f"{head}.\n{tail}" + ("" if unit == "1" else f" [{unit}]")


def convert_to_unit(post: Posterior, values: np.ndarray, k: int) -> np.ndarray:
    """Return the values of parameter k, from the last axis, in its display unit."""
    return values[..., k] / compute_si_factor(post.find_units(post.names[k])[1])

"""Scatter of a design: the covariance of its parameters, from the draws of materials and manufacture.

`pamjax inverse` propagates it to a command. It has the form of the covariance of a fit, so that both are read
in one way. The deviation is that from the designed value, because this is the value that a command assumes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pamjax.sizing import chance_constraints as chance

if TYPE_CHECKING:
    from pamjax.sizing.result import Design

#: Parameters with scatter, and their units.
PARAMETER_UNITS = {
    "muscle.thread_length": "m",
    "muscle.turns": "1",
    "thread.stiffness": "N",
    "bladder_elasticity.modulus": "Pa",
    "bladder_elasticity.inner_diameter": "m",
    "bladder_elasticity.thickness": "m",
}


def build_scatter_document(design: Design, numbers: dict[str, float]) -> dict[str, Any]:
    """Return the parameters with their standard deviations and their correlation, as in a fit.json.

    Args:
        design: a feasible design.
        numbers: parameters of the muscle by name, SI.
    """
    draws = chance.draw_reported_builds(design.problem, design.transfer, design.errors, design.seed)
    drawn, build = draws.build, design.problem.build
    deviations = np.stack(
        [
            drawn.thread_error,
            drawn.turns_error,
            numbers["thread.stiffness"] * (drawn.modulus / float(build.modulus) - 1),
            drawn.shear - float(build.shear),
            -2 * drawn.wall_error,
            drawn.wall_error,
        ]
    )
    sds = np.sqrt(np.mean(deviations**2, axis=1))
    scaled = deviations / np.where(sds > 0, sds, 1.0)[:, None]
    correlation = scaled @ scaled.T / draws.count
    np.fill_diagonal(correlation, 1.0)
    names = list(PARAMETER_UNITS)
    return {
        "uncertainty": "design",
        "parameters": {
            name: {"value": numbers[name], "sd": float(sd), "unit": PARAMETER_UNITS[name]}
            for name, sd in zip(names, sds, strict=True)
        },
        "correlation": {"names": names, "matrix": np.round(correlation, 6).tolist()},
    }

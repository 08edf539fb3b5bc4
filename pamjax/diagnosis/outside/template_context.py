"""What the templates of a recording depend on, at the estimate of the baseline."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from pamjax.diagnosis.library.library_problem import COMPLIANCE_PARAMETER, LibraryProblem
from pamjax.diagnosis.outside.templates import TemplateContext
from pamjax.diagnosis.refit.candidate_fit import CandidateFit
from pamjax.infer.noise.sensor_noise import compute_sensitivities
from pamjax.records.blocks import Blocks

#: Parameters that describe the stiffness of the threads; each baseline has one of them.
STIFFNESS_PARAMETERS = ("thread.modulus", "thread.stiffness", COMPLIANCE_PARAMETER)


def build_template_context(
    problem: LibraryProblem, blocks: Blocks, baseline: CandidateFit
) -> TemplateContext:
    """Return what the templates depend on, at the estimate of the baseline."""
    values = baseline.estimate.values
    prediction = problem.predict(values)
    by_pressure, by_length = (
        np.nan_to_num(np.asarray(s)[0, : problem.n])
        for s in compute_sensitivities(problem.dataset, jnp.asarray(values))
    )
    residual = np.nan_to_num(problem.measured[0] - prediction[0])
    stiffness = next(name for name in STIFFNESS_PARAMETERS if name in problem.names)
    by_stiffness = problem.jacobian(values, [problem.index(stiffness)])[1][0]
    return TemplateContext(problem, blocks, prediction, residual, by_pressure, by_length, by_stiffness)

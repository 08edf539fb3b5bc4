"""What the templates of a recording depend on, at some parameter values."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from pamjax.diagnosis.library.library_parameters import COMPLIANCE_PARAMETER
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.templates.templates import TemplateBuilder, TemplateContext, build_templates
from pamjax.infer.noise.sensor_noise import compute_sensitivities
from pamjax.records.blocks import Blocks

#: Parameters that describe the stiffness of the threads; each baseline has one of them.
_STIFFNESS_PARAMETERS = ("thread.modulus", "thread.stiffness", COMPLIANCE_PARAMETER)


def get_template_builder(problem: LibraryProblem, length: np.ndarray, blocks: Blocks) -> TemplateBuilder:
    """Return the function that builds the templates of a recording; arguments as in `build_template_context`.

    The templates describe forces, so it returns none where length is measured.
    """
    if problem.case.recording.measures_length:
        return lambda values: []
    return lambda values: build_templates(build_template_context(problem, length, blocks, values))


def build_template_context(
    problem: LibraryProblem, length: np.ndarray, blocks: Blocks, values: np.ndarray
) -> TemplateContext:
    """Return what the templates depend on, at some parameter values.

    Args:
        problem: the recording and the library.
        length: (n,) m, as it was read; the length of the problem is averaged where it is fixed.
        blocks: isobars, holds or cycles of the recording.
        values: (p,) parameter values, SI.
    """
    recording = problem.case.recording
    by_pressure, by_length = (
        np.nan_to_num(np.asarray(s)[:, : problem.n])
        for s in compute_sensitivities(problem.dataset, jnp.asarray(values))
    )
    stiffness = next(name for name in _STIFFNESS_PARAMETERS if name in problem.names)
    return TemplateContext(
        time=recording.time,
        pressure=recording.pressure,
        length=length,
        rest_length=problem.case.muscle_toml.rest_length.value,
        force=problem.measured[0],
        blocks=blocks,
        prediction=problem.predict(values),
        by_pressure=by_pressure,
        by_length=by_length,
        by_stiffness=problem.predict_with_jacobian(values, [problem.index(stiffness)])[1][0],
        settings=problem.settings,
    )

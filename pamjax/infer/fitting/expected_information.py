"""Fisher information of a recording before a fit, with the noise of the stated sensors."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.infer.fitting.least_squares import linearise_problem
from pamjax.infer.noise.sensor_noise import compute_effective_sd
from pamjax.infer.problem.dataset import CaseRows, Dataset, build_dataset
from pamjax.infer.problem.informative_samples import estimate_starting_sd
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.model.history import build_time_history
from pamjax.records.case import Case

#: Rows that are evaluated together if no row depends on another one. The memory is then that of these rows,
#: and recordings of every length share one program.
_PART_ROWS = 8192


@dataclasses.dataclass(frozen=True)
class ExpectedInformation:
    """Information at the stated values, in the coordinates u of a space.

    Attributes:
        of_data: (p, p) of the recording.
        of_priors: (p, p) of the priors.
        slope: (p,) d value / d u, SI.
    """

    of_data: np.ndarray
    of_priors: np.ndarray
    slope: np.ndarray


def compute_expected_information(
    case: Case, law: str, space: ParameterSpace, space_names: Mapping[str, str], mechanisms: Sequence[str]
) -> ExpectedInformation:
    """Return the information of independent samples with the noise of the stated sensors.

    Args:
        case: the recording and its muscle.toml.
        law, space, space_names, mechanisms: as for `build_dataset`.
    """
    start = jnp.zeros(space.size)
    values, sds, sensors = space.to_values(start), estimate_starting_sd(case), case.muscle_toml.sensors
    of_data, solution = np.zeros((space.size, space.size)), None
    for dataset in _split_dataset(case, law, space, space_names, mechanisms):
        dataset = _set_weights(dataset, compute_effective_sd(dataset, values, sensors, sds))
        solution = linearise_problem((dataset,), space, start)
        of_data += np.asarray(solution.information)
    assert solution is not None  # a case has rows
    return ExpectedInformation(of_data, np.asarray(solution.prior_information), np.asarray(solution.slope))


def _split_dataset(
    case: Case, law: str, space: ParameterSpace, space_names: Mapping[str, str], mechanisms: Sequence[str]
) -> Iterator[Dataset]:
    """Yield datasets of equal size with all samples; one dataset if a mechanism may relate rows."""
    if mechanisms:
        yield build_dataset(case, law, space, space_names, mechanisms)
        return
    rows, n = CaseRows.from_case(case), case.recording.n
    parts = (
        rows.pad(slice(start, min(start + _PART_ROWS, n)), _PART_ROWS) for start in range(0, n, _PART_ROWS)
    )
    # Without mechanisms, the order of the rows has no effect.
    history = build_time_history(None, np.ones(_PART_ROWS, dtype=bool))
    dataset = build_dataset(case, law, space, space_names, rows=next(parts), history=history)
    yield dataset
    for part in parts:
        yield dataclasses.replace(dataset, rows=part)


def _set_weights(dataset: Dataset, sd: np.ndarray) -> Dataset:
    """Return the dataset with weights 1 / sd of its samples; sd is (2, n), SI."""
    weights = np.where(dataset.rows.weights > 0, 1 / sd, 0.0)
    return eqx.tree_at(
        lambda d: (d.rows.force_weight, d.rows.diameter_weight), dataset, tuple(map(jnp.asarray, weights))
    )

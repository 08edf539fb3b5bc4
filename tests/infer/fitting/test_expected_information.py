"""Information of a recording before a fit: the same from all rows together and from parts of them."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.infer.fitting import expected_information
from pamjax.infer.fitting.expected_information import compute_expected_information
from pamjax.infer.fitting.joint_space import build_joint_space
from pamjax.infer.fitting.least_squares import linearise_problem
from pamjax.infer.noise.sensor_noise import compute_effective_sd
from pamjax.infer.problem.dataset import build_dataset
from pamjax.infer.problem.informative_samples import estimate_starting_sd
from pamjax.records.reading.muscle_toml import Sensors
from tests.agreement import ROUNDING, agree
from tests.infer.made import SENSORS, made


def compute(case, mechanisms=()):
    space, (names,) = build_joint_space([case], "elastic", (), mechanisms)
    return compute_expected_information(case, "elastic", space, names, mechanisms)


@pytest.mark.parametrize("sensors", [SENSORS, Sensors()], ids=["stated sensors", "no sensors"])
@pytest.mark.parametrize("part_rows", [16, 100])
def test_parts_have_the_information_of_all_rows(monkeypatch, part_rows, sensors):
    case = made()
    case = replace(case, muscle_toml=replace(case.muscle_toml, sensors=sensors))
    monkeypatch.setattr(expected_information, "_PART_ROWS", part_rows)
    assert case.recording.n > 2 * part_rows
    expected = compute(case)
    space, (names,) = build_joint_space([case], "elastic", ())
    dataset, start = build_dataset(case, "elastic", space, names), jnp.zeros(space.size)
    sd = compute_effective_sd(dataset, space.to_values(start), sensors, estimate_starting_sd(case))
    rows = replace(
        dataset.rows,
        force_weight=jnp.where(dataset.rows.force_weight > 0, 1 / sd[0], 0.0),
        diameter_weight=jnp.where(dataset.rows.diameter_weight > 0, 1 / sd[1], 0.0),
    )
    solution = linearise_problem((replace(dataset, rows=rows),), space, start)
    agree(expected.of_data, np.asarray(solution.information), 1e3 * ROUNDING)
    agree(expected.of_priors, np.asarray(solution.prior_information), ROUNDING)


def test_mechanism_uses_all_rows_together(monkeypatch):
    case = made()
    monkeypatch.setattr(expected_information, "_PART_ROWS", 16)
    shapes = []
    original = expected_information.linearise_problem

    def record(datasets, *arguments):
        shapes.append(datasets[0].rows.pressure.size)
        return original(datasets, *arguments)

    monkeypatch.setattr(expected_information, "linearise_problem", record)
    compute(case, ["force_offset"])
    assert [size >= case.recording.n for size in shapes] == [True]
    compute(case)
    assert set(shapes[1:]) == {16}

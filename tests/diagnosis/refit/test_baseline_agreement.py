"""`fit` and the baseline of a diagnosis agree, with and without a misfit."""

import numpy as np
import pytest

from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.refit.model_fit import fit_model
from pamjax.infer.fitting.fit import fit
from tests.diagnosis.bank import BankRecording, simulate_bank


@pytest.mark.parametrize(
    "definition",
    [
        BankRecording(),
        BankRecording(effect_count=1, only="braid_friction", smallest=8.0, largest=8.0),
    ],
    ids=["noise only", "friction"],
)
def test_fit_and_baseline_agree(definition):
    case = simulate_bank(definition).case
    problem = build_library_problem(case)
    baseline = fit_model(problem, np.ones(problem.n, dtype=bool), (), problem.neutral, max_noise_ratio=1.0)
    fitted = fit(case, starts=1, fold_count=2)
    assert (baseline.variance_inflation > 5) == (definition.effect_count > 0)
    compared = 0
    for name, e in fitted.estimates.items():
        k = problem.index(name)
        if e.sd is None:
            continue
        compared += 1
        assert abs(baseline.estimate.values[k] - e.value) < 0.1 * e.sd
        assert baseline.sd(k) == pytest.approx(e.sd, rel=0.05)
    assert compared

"""Power: the probability that a protocol identifies which of two models is true, after refits of both.

A and B fit the recording equally well. On a new protocol their predictions differ by δ. A refit to both
recordings absorbs a part of δ. Let δ and the Jacobian J of a model be whitened by the new noise. Let H be the
information on its parameters from the recording and the priors. Then the χ² of a difference r after the refit
is

    χ²(r) = rᵀ (I + J H⁻¹ Jᵀ)⁻¹ r = rᵀr − rᵀJ (H + JᵀJ)⁻¹ Jᵀr.

If A is true, the measured minus B's prediction is y = δ + J_A a + noise, with a drawn from its distribution
with information H_A. The difference χ²_B(y) − χ²_A(y − δ) is simulated for either truth. B is rejected if the
difference exceeds its (1 − `false_alarm_rate`) quantile under B. The power is the share of rejections if A
is true.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.infer.problem.unit_diagonal import invert_scaled, scale_to_unit_diagonal


@dataclass(frozen=True, eq=False)
class LinearisedModel:
    """Linear approximation of a model on a protocol.

    Attributes:
        jacobian: (k, m) whitened derivatives of the protocol's prediction by the model's parameters.
        information: (k, k) information on these parameters from the recording and the priors.
    """

    jacobian: np.ndarray
    information: np.ndarray

    def compute_refit_chi2(self, differences: np.ndarray) -> np.ndarray:
        """Return χ² of whitened differences, (…, m), after a refit."""
        total = self.information + self.jacobian @ self.jacobian.T
        inverse, unit = invert_scaled(total)
        projections = differences @ (self.jacobian / unit[:, None]).T
        return np.sum(differences**2, axis=-1) - np.sum((projections @ inverse) * projections, axis=-1)

    def sample_predictions(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return changes of the prediction by draws of the parameters from their uncertainty, (count, m)."""
        scaled_information, unit = scale_to_unit_diagonal(self.information)
        weights, axes = np.linalg.eigh(scaled_information)
        draws = rng.standard_normal((count, unit.size)) / np.sqrt(np.maximum(weights, 1e-12))
        return (draws @ axes.T / unit) @ self.jacobian


def compute_power_and_limit(
    delta: np.ndarray,
    a: LinearisedModel,
    b: LinearisedModel,
    draws: int = DEFAULT_SETTINGS.power_draws,
    seed: int = 0,
    false_alarm_rate: float = DEFAULT_SETTINGS.false_alarm_rate,
) -> tuple[float, float]:
    """Return the power of a protocol to identify A against B, and the limit of the test.

    Args:
        delta: (m,) whitened difference of the predictions of A and B.
        a, b: the linearised models.
        draws: simulated protocols for each truth.
        seed: seed of the draws.
        false_alarm_rate: probability that B is rejected if it is true.

    Returns:
        power at that false-alarm rate, and the increase of χ² at which B is rejected.
    """
    if not delta.size or not np.any(delta):
        return false_alarm_rate, math.inf
    # Noise outside the span of δ and the Jacobians adds the same χ² to both models.
    basis = np.linalg.qr(np.concatenate([delta[None], a.jacobian, b.jacobian]).T)[0]
    delta, a, b = (
        delta @ basis,
        LinearisedModel(a.jacobian @ basis, a.information),
        LinearisedModel(b.jacobian @ basis, b.information),
    )
    rng = np.random.default_rng(seed)

    def compute_chi2_difference(truth: np.ndarray, model: LinearisedModel) -> np.ndarray:
        readings = truth + model.sample_predictions(rng, draws) + rng.standard_normal((draws, delta.size))
        return b.compute_refit_chi2(readings) - a.compute_refit_chi2(readings - delta)

    chi2_limit = float(np.quantile(compute_chi2_difference(np.zeros_like(delta), b), 1 - false_alarm_rate))
    return float(np.mean(compute_chi2_difference(delta, a) > chi2_limit)), chi2_limit

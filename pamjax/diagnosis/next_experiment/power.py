"""Power: how likely a protocol settles which of two models is true, both refitted afterwards.

A and B fit the recording as well as each other. On a new protocol their predictions differ by δ, of which
a refit to both recordings takes up what the first lets it. With δ and the derivatives J of a model made
white by the new noise, and H what the recording and the priors know of its numbers, what is left of a
difference r is

    χ²(r) = rᵀ (I + J H⁻¹ Jᵀ)⁻¹ r = rᵀr − rᵀJ (H + JᵀJ)⁻¹ Jᵀr.

Where A is true, the protocol shows y = δ + J_A a + noise from B's prediction on, with a as uncertain as H_A
leaves it; and χ²_B(y) − χ²_A(y − δ) is drawn for both truths. B is given up where that difference is larger
than it is in one of twenty draws with B true; the power is how often that happens where A is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

#: Chance that the wrong one is chosen.
FALSE_ALARM_RATE = 0.05

#: Simulated protocols for a power: it is known to one in a hundred.
POWER_DRAWS = 4000


@dataclass(frozen=True, eq=False)
class LinearisedModel:
    """One of two models before a protocol.

    Attributes:
        jacobian: (k, m) white derivatives of what the protocol shows, by the model's numbers.
        information: (k, k) what recording and priors know of those numbers.
    """

    jacobian: np.ndarray
    information: np.ndarray

    def compute_refit_chi2(self, differences: np.ndarray) -> np.ndarray:
        """χ² of white differences, (…, m), after a refit."""
        total = self.information + self.jacobian @ self.jacobian.T
        unit = np.sqrt(np.maximum(np.diag(total), 1e-300))
        inverse = np.linalg.pinv(total / np.outer(unit, unit), rcond=1e-12, hermitian=True)
        pull = differences @ (self.jacobian / unit[:, None]).T
        return np.sum(differences**2, axis=-1) - np.sum((pull @ inverse) * pull, axis=-1)

    def sample_predictions(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """What its numbers, drawn as uncertain as they are, change in the protocol, (many, m)."""
        unit = np.sqrt(np.maximum(np.diag(self.information), 1e-300))
        weights, axes = np.linalg.eigh(self.information / np.outer(unit, unit))
        draws = rng.standard_normal((count, unit.size)) / np.sqrt(np.maximum(weights, 1e-12))
        return (draws @ axes.T / unit) @ self.jacobian


def compute_power(
    delta: np.ndarray, a: LinearisedModel, b: LinearisedModel, draws: int = POWER_DRAWS, seed: int = 0
) -> float:
    """Chance that A is preferred where it is true; see `compute_power_and_limit`."""
    return compute_power_and_limit(delta, a, b, draws, seed)[0]


def compute_power_and_limit(
    delta: np.ndarray, a: LinearisedModel, b: LinearisedModel, draws: int = POWER_DRAWS, seed: int = 0
) -> tuple[float, float]:
    """Chance that A is preferred where it is true, if B is given up only at a false alarm of
    `FALSE_ALARM_RATE`.

    Args:
        delta: (m,) white difference of A's and B's predictions.
        a, b: the models.
        draws: simulated protocols for each truth.
        seed: of the draws.

    Returns:
        power, and the χ² by which B must fit worse, beyond what it did before, to be given up.
    """
    if not delta.size or not np.any(delta):
        return FALSE_ALARM_RATE, math.inf
    # Noise beyond the span of δ and the derivatives is the same to both models.
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

    chi2_limit = float(np.quantile(compute_chi2_difference(np.zeros_like(delta), b), 1 - FALSE_ALARM_RATE))
    return float(np.mean(compute_chi2_difference(delta, a) > chi2_limit)), chi2_limit

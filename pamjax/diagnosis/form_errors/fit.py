"""Refit with form errors: correlated noise in proportion to each effect, of the most likely size.

A real effect follows its textbook equation only to some 10 to 30 %. Without an allowance for this difference,
further mechanisms are added that fit it. The form error of mechanism m is Φ_m c_m with c_m ~ N(0, ε_m² I).
At an estimate x, the whitened residual r has the likelihood, with the Jacobian J and the priors N(m, s²),

    −2 ln L(ε) = min |r − J δ − Σ Φ_m c_m|² + |(x + δ − m) / s|² + Σ |c_m / ε_m|²
                 + ln det(I + Σ ε_m² Φ_m Φ_mᵀ)

over δ and c. Each ε_m is the most likely of four shares, from zero to the setting `max_form_share`. Then Φ ε
is part of the noise (`discrepancy.py`), and the parameters are refitted.

Neglects: form errors that are not smooth in the declared variables of a mechanism.
Source: M. Kennedy & A. O'Hagan, J. R. Stat. Soc. B 63, 425 (2001).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pamjax.diagnosis.form_errors.columns import build_form_columns, compute_effect_of
from pamjax.diagnosis.form_errors.coordinates import Coordinates
from pamjax.diagnosis.form_errors.discrepancy import DiscrepancyNoise, add_discrepancy
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.candidate_fit import CandidateFit
from pamjax.diagnosis.refit.least_squares import (
    MapEstimate,
    compute_priors,
    evaluate_estimate,
    fit_parameters,
    transform_to_coordinates,
)
from pamjax.diagnosis.refit.remember import remember

#: Sizes of a form error that are compared, as shares of its largest size.
RELATIVE_SHARES = (0.0, 0.1, 1 / 3, 1.0)

#: Refits; the form errors are computed again before each, because they change with their effects.
ROUNDS = 2


@dataclass(frozen=True, eq=False)
class FormErrorFit(CandidateFit):
    """A fit whose noise contains the form errors of its mechanisms.

    Attributes:
        form_ratios: by mechanism id, rms of the estimated form error over the rms of the effect; mechanisms
            without form error are absent.
    """

    form_ratios: dict[str, float] = field(default_factory=dict)


@remember(lambda: None)
def add_form_errors(problem: LibraryProblem, fit: CandidateFit) -> CandidateFit:
    """Return the fit, refitted with the form errors of its mechanisms as noise.

    Args:
        problem: the recording and the library.
        fit: a fit of this recording without form errors; returned unchanged if its mechanisms have none.
    """
    coordinates, values, out = Coordinates.from_problem(problem), fit.estimate.values, fit
    for _ in range(ROUNDS):
        forms = {m.id: build_form_columns(problem, coordinates, values, m) for m in fit.mechanisms}
        white = {id: np.nan_to_num(fit.noise.whiten(f)) for id, f in forms.items() if len(f)}
        white = {id: columns for id, columns in white.items() if columns.any()}
        if not white:
            return fit
        estimate = evaluate_estimate(problem, fit.noise, fit.estimate.free, values)
        shares = estimate_form_shares(problem, estimate, list(white.values()))
        noise = add_discrepancy(
            fit.noise,
            np.concatenate([share * forms[id] for id, share in zip(white, shares, strict=True)]),
            [id for id in white for _ in forms[id]],
        )
        estimate = fit_parameters(problem, noise, fit.estimate.free, values)
        values = estimate.values
        out = FormErrorFit(
            **{**vars(fit), "noise": noise, "estimate": estimate},
            form_ratios=_compute_form_ratios(problem, fit, values, noise),
        )
    return out


def estimate_form_shares(
    problem: LibraryProblem, estimate: MapEstimate, forms: Sequence[np.ndarray]
) -> tuple[float, ...]:
    """Return the most likely share of each form error, found in turn.

    Args:
        problem: the recording and the library.
        estimate: an estimate with the noise of the recording alone.
        forms: by mechanism, (r, size) whitened columns of its form error at a share of one.
    """
    cost = _FormCost(problem, estimate, forms)
    options = [share * problem.settings.max_form_share for share in RELATIVE_SHARES]
    shares = (0.0,) * len(forms)
    # Form errors of several mechanisms interact little: two rounds suffice.
    for _ in range(2 if len(forms) > 1 else 1):
        for k in range(len(forms)):
            shares = min(((*shares[:k], share, *shares[k + 1 :]) for share in options), key=cost.evaluate)
    return shares


class _FormCost:
    """−2 ln L as a function of the shares, from products of all columns."""

    def __init__(self, problem: LibraryProblem, estimate: MapEstimate, forms: Sequence[np.ndarray]) -> None:
        columns = np.concatenate([estimate.jacobian.T, *forms])
        mean, _ = compute_priors(problem, estimate.free)
        deviation = transform_to_coordinates(problem, estimate.free, estimate.values) - mean
        self.sizes, self.parameter_precision = [len(form) for form in forms], 1 / estimate.prior_sd**2
        self.gram, self.projection = columns @ columns.T, columns @ estimate.residual
        self.projection[: estimate.prior_sd.size] -= self.parameter_precision * deviation

    def evaluate(self, shares: Sequence[float]) -> float:
        """Return −2 ln L up to a constant."""
        share_of_column = np.repeat(shares, self.sizes)
        count, used = self.parameter_precision.size, np.flatnonzero(share_of_column)
        sizes, form_rows = share_of_column[used], self.parameter_precision.size + used
        rows = np.concatenate([np.arange(count), form_rows])
        matrix = self.gram[np.ix_(rows, rows)] + np.diag(
            np.concatenate([self.parameter_precision, 1 / sizes**2])
        )
        # Scaled to a unit diagonal: newtons and pascals are many orders of magnitude apart.
        unit = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        along = self.projection[rows] / unit
        explained = along @ np.linalg.lstsq(matrix / np.outer(unit, unit), along, rcond=1e-12)[0]
        inflation = np.eye(used.size) + np.outer(sizes, sizes) * self.gram[np.ix_(form_rows, form_rows)]
        return float(np.linalg.slogdet(inflation)[1] - explained)


def _compute_form_ratios(
    problem: LibraryProblem, fit: CandidateFit, values: np.ndarray, noise: DiscrepancyNoise
) -> dict[str, float]:
    """Return the rms of each estimated form error over the rms of its effect, whitened."""
    residual, out = problem.measured - problem.predict(values), {}
    for candidate in fit.mechanisms:
        if candidate.id in noise.owners:
            form, effect = (
                _compute_rms(np.nan_to_num(fit.noise.whiten(part)))
                for part in (
                    noise.estimate_discrepancy(residual, candidate.id),
                    compute_effect_of(problem, values, candidate),
                )
            )
            out[candidate.id] = form / max(effect, 1e-12)
    return out


def _compute_rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0

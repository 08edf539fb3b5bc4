"""Form errors of a fitted model that predict any recording.

In the rows of any recording, force and diameter are

    y = f(θ) + Σ_k a_k (φ_k(x) e − s_k e) + Σ_j a_j (e_j − s_j e).

    f      prediction of the equations at the parameters θ
    e      effect of a mechanism, at the parameters from which the fit built its columns
    e_j    the same with other shape parameters
    φ_k    products of Legendre polynomials of the variables x, scaled and clipped to the rows of the fit
    a, s   coefficients, and parts in proportion to the effect; both from the fit

The variance of y is the diagonal of B Σ Bᵀ, with the derivatives B of y by θ and a, and their covariance Σ.

Leaves out: form errors that are a course in time, because it belongs to one recording; and the dependence of
e on θ. The variable `force` is the predicted force: a prediction must not depend on the measured one.
Source: as in `model/form_error.py`; derived there and in `parts.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from pamjax.infer.form_errors.columns import FormShape
from pamjax.infer.form_errors.coordinates import CoordinateScales
from pamjax.infer.form_errors.form_source import FormSource
from pamjax.model.assembly import assemble_bench
from pamjax.model.bench import Bench
from pamjax.model.parameters import find_meaning
from pamjax.model.registry import find_mechanism
from pamjax.parameter import list_field_meanings

#: Step of a central difference in the standard deviations of a parameter.
_DIFFERENCE_STEP_SD = 1e-3

#: Function that predicts force (N) and diameter (m) of a bench in some rows, (2, n).
PredictBench = Callable[[Bench], np.ndarray]


@dataclass(frozen=True, eq=False)
class MechanismForm:
    """Form error of one mechanism in a fitted model.

    Attributes:
        terms: the terms φ_k, as "pressure length^2".
        reshaped_values: for each effect e_j, its shape parameters by field, SI.
        parallel_shares: (r, 2) parts s in proportion to the effect, by channel.
        coefficients: (r,) coefficients a of the terms, then of the reshaped effects.
        limits: limits of the variables.
    """

    terms: tuple[str, ...]
    reshaped_values: tuple[Mapping[str, float], ...]
    parallel_shares: np.ndarray
    coefficients: np.ndarray
    limits: CoordinateScales


@dataclass(frozen=True, eq=False)
class FormRows:
    """Rows of a recording: pressure (Pa), length (m) and rate of change of the length (m/s), (n,) each."""

    pressure: np.ndarray
    length: np.ndarray
    rate: np.ndarray


@dataclass(frozen=True, eq=False)
class FormErrorModel:
    """A muscle with the form errors of its mechanisms.

    Attributes:
        law, mechanisms: thread law and mechanisms.
        numbers: parameters θ by name, SI.
        effect_numbers: parameters of the effects e, SI.
        forms: form error of each mechanism that has one.
        parameters: names of the estimated parameters.
        covariance: (p + r, p + r) of these parameters, SI, and of the coefficients in the order of `forms`.
    """

    law: str
    mechanisms: tuple[str, ...]
    numbers: Mapping[str, float]
    effect_numbers: Mapping[str, float]
    forms: Mapping[str, MechanismForm]
    parameters: tuple[str, ...]
    covariance: np.ndarray

    @property
    def muscle(self) -> Bench:
        """Return the muscle with its mechanisms, without form errors."""
        return self._build_bench(self.numbers)

    def build_columns(self, rows: FormRows, predict: PredictBench) -> np.ndarray:
        """Return the derivatives of the prediction by the coefficients, (r, 2, n), SI.

        Args:
            rows: the rows.
            predict: predicts a bench in these rows.
        """
        force = np.nan_to_num(predict(self.muscle)[0])
        return np.concatenate([self._build_columns_of(id, rows, force, predict) for id in self.forms])

    def predict_form(self, columns: np.ndarray) -> np.ndarray:
        """Return the form errors, (2, n), SI, from the columns (r, 2, n)."""
        coefficients = np.concatenate([form.coefficients for form in self.forms.values()])
        return np.einsum("r,rcn->cn", coefficients, columns)

    def compute_sd(self, columns: np.ndarray, predict: PredictBench) -> np.ndarray:
        """Return the standard deviation of the prediction by parameters and form errors, (2, n), SI.

        Args:
            columns: (r, 2, n) of `build_columns`.
            predict: predicts a bench in the same rows.
        """
        sds = np.sqrt(np.maximum(np.diag(self.covariance)[: len(self.parameters)], 0.0))
        slopes = [
            self._compute_slope(name, float(sd), predict)
            for name, sd in zip(self.parameters, sds, strict=True)
        ]
        derivatives = np.concatenate([np.reshape(slopes, (-1, *columns.shape[1:])), columns])
        variance = np.einsum("kcn,kl,lcn->cn", derivatives, self.covariance, derivatives, optimize=True)
        return np.sqrt(np.maximum(variance, 0.0))

    def _build_bench(self, numbers: Mapping[str, float]) -> Bench:
        # Numbers of one type, so that all benches share one compiled program.
        values = {name: jnp.asarray(float(value)) for name, value in numbers.items()}
        return assemble_bench(self.law, self.mechanisms, values)

    def _build_columns_of(
        self, id: str, rows: FormRows, force: np.ndarray, predict: PredictBench
    ) -> np.ndarray:
        form = self.forms[id]
        coordinates = form.limits.scale_rows(rows.pressure, rows.length, force, rows.rate)
        shape = FormShape(form.terms, form.parallel_shares, np.ones(len(form.coefficients)))
        reshaped_effects = [self._compute_effect(id, values, predict) for values in form.reshaped_values]
        return shape.build_columns(coordinates, self._compute_effect(id, {}, predict), reshaped_effects)

    def _compute_effect(
        self, id: str, shape_values: Mapping[str, float], predict: PredictBench
    ) -> np.ndarray:
        """Return what a mechanism changes in the prediction, (2, n), SI; zero where a state has no answer."""
        numbers = {**self.effect_numbers} | {f"{id}.{field}": v for field, v in shape_values.items()}
        neutral = {
            f"{id}.{field}": meaning.neutral
            for field, meaning in list_field_meanings(find_mechanism(id)).items()
            if meaning.neutral is not None
        }
        return np.nan_to_num(
            predict(self._build_bench(numbers)) - predict(self._build_bench(numbers | neutral))
        )

    def _compute_slope(self, name: str, sd: float, predict: PredictBench) -> np.ndarray:
        """Return the derivative of the prediction by a parameter, (2, n), by a central difference."""
        meaning, value = find_meaning(name), float(self.numbers[name])
        low, high = np.clip(
            [value - _DIFFERENCE_STEP_SD * sd, value + _DIFFERENCE_STEP_SD * sd], meaning.low, meaning.high
        )
        if not low < high:
            return np.zeros_like(predict(self.muscle))
        below, above = (predict(self._build_bench({**self.numbers, name: v})) for v in (low, high))
        return np.nan_to_num((above - below) / (high - low))


def build_form_error_model(
    law: str,
    mechanisms: Sequence[str],
    numbers: Mapping[str, float],
    effect_numbers: Mapping[str, float],
    parameters: Sequence[str],
    sources: Mapping[str, FormSource],
    owners: Sequence[str],
    coefficients: np.ndarray,
    covariance: np.ndarray,
) -> FormErrorModel | None:
    """Return the form errors of a fit for other recordings; None if there are none.

    Args:
        law, mechanisms, numbers, effect_numbers, parameters: as of `FormErrorModel`.
        sources: constants of the columns of each mechanism, in the order of their columns.
        owners: for each column of the fit, the id of its mechanism. Columns of other mechanisms are left out.
        coefficients: (r,) estimated coefficients of the columns.
        covariance: (p + r, p + r) of parameters, SI, and coefficients.
    """
    if not sources:
        return None
    forms = {
        id: MechanismForm(
            terms=source.shape.terms,
            reshaped_values=source.reshaped_values,
            parallel_shares=source.shape.parallel_shares,
            coefficients=coefficients[_find_columns(owners, id)] * source.share * source.shape.scales,
            limits=source.limits,
        )
        for id, source in sources.items()
    }
    count = len(parameters)
    kept = np.concatenate([np.arange(count), *(count + _find_columns(owners, id) for id in sources)])
    unit = np.concatenate(
        [np.ones(count), *(source.share * source.shape.scales for source in sources.values())]
    )
    return FormErrorModel(
        law,
        tuple(mechanisms),
        dict(numbers),
        dict(effect_numbers),
        forms,
        tuple(parameters),
        covariance[np.ix_(kept, kept)] * np.outer(unit, unit),
    )


def _find_columns(owners: Sequence[str], id: str) -> np.ndarray:
    return np.flatnonzero([owner == id for owner in owners])


def is_transferable(id: str, share: float) -> bool:
    """Return whether the form error of a mechanism, a share of its effect, predicts other recordings."""
    return share > 0 and not find_mechanism(id).form_error.is_course

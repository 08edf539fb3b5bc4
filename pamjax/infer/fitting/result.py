"""Result of a fit: estimates with standard deviations, noise, and the error on held-out blocks."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from pamjax.drawing import DrawableResult
from pamjax.errors import suggest_word
from pamjax.infer.fitting.determination import DETERMINED, classify_sd_ratio, compute_prior_scale
from pamjax.infer.fitting.least_squares import Loss, Solution
from pamjax.infer.form_errors.form_model import FormErrorModel
from pamjax.infer.form_errors.parts import FormErrorPart
from pamjax.infer.noise.sensor_noise import ChannelNoise
from pamjax.infer.problem.dataset import Dataset
from pamjax.infer.problem.parameter_space import BOUND_MARGIN, ParameterSpace
from pamjax.model.balance import Status
from pamjax.model.muscle import Muscle
from pamjax.notebook import NotebookText
from pamjax.parameter import Meaning
from pamjax.records.case import Case
from pamjax.units import compute_si_factor

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


class NamedEstimates(dict[str, "Estimate"]):
    """Estimates by name; an unknown name raises a KeyError with the nearest one."""

    def __missing__(self, name: str) -> Estimate:
        raise KeyError(f"no estimate {name!r}. {suggest_word(name, self)}")

    def _ipython_key_completions_(self) -> list[str]:
        """Return the names that the Tab key offers in a notebook."""
        return list(self)


@dataclass(frozen=True)
class Estimate:
    """Estimate of one parameter.

    Attributes:
        value, sd: SI; `sd` is None if the fit has none.
        prior, prior_sd: mean and sd of the prior, SI; `prior_sd` is infinite for a uniform prior.
        meaning: its unit, bounds and meaning.
        at_limit: whether it is at one of its bounds, or at the limit of its distance from the prior.
    """

    value: float
    sd: float | None
    prior: float
    prior_sd: float
    meaning: Meaning
    at_limit: bool

    @property
    def sd_ratio(self) -> float:
        """Return the sd over the sd of the prior, 0 to 1; 1 if the fit has no sd."""
        scale = compute_prior_scale(self.prior_sd, self.value, self.meaning)
        return 1.0 if self.sd is None else min(self.sd / scale, 1.0)

    @property
    def limit_name(self) -> str:
        """Return which limit is nearest: of the distance from the prior inside the bounds, else a bound."""
        middle = self.prior if self.is_inside_bounds else (self.meaning.low + self.meaning.high) / 2
        return "lower limit" if self.value < middle else "upper limit"

    @property
    def is_inside_bounds(self) -> bool:
        """Return whether the value is more than `BOUND_MARGIN` of their range inside its bounds."""
        low, high, value = self.meaning.low, self.meaning.high, self.value
        if self.meaning.scale == "log":
            low, high, value = math.log(low), math.log(high), math.log(value)
        return BOUND_MARGIN < (value - low) / (high - low) < 1 - BOUND_MARGIN

    @property
    def is_determined(self) -> bool:
        """Return whether the recording reduces the prior sd by at least half."""
        return classify_sd_ratio(self.sd_ratio) == DETERMINED


@dataclass(frozen=True)
class HeldOutScore:
    """Error of predictions of held-out blocks.

    Attributes:
        kind: kind of the blocks, such as "isobars".
        folds: names of the blocks of each fold.
        rmse: SI, by channel, over all held-out rows.
    """

    kind: str
    folds: tuple[tuple[str, ...], ...]
    rmse: dict[str, float]


@dataclass(frozen=True, eq=False)
class CaseFit:
    """Result of a fit for one case.

    Attributes:
        case: the recording and its muscle.toml.
        numbers: the muscle's parameters by name, SI, as `assemble` needs them.
        muscle: the calibrated muscle, without its mechanisms.
        prediction: (n,) by channel, SI; with the estimated form errors of a fit that has them.
        held_out_prediction: (n,) by channel, SI: each row predicted by a fit without its block; NaN if no
            block was held out.
        block: (n,) name of each row's block.
        rmse: SI, by channel.
        noise: by channel.
        held_out_score: error on held-out blocks; None if there are too few blocks.
        failed_rows: rows of the file where the muscle has no solution, by status.
        form_errors: by mechanism; empty for a fit without form errors.
        prediction_sd: (n,) by channel, SI, sd of the prediction due to parameters and form errors; empty for
            a fit without form errors.
        form_error_model: form errors that predict other recordings; None if there are none.
    """

    case: Case
    numbers: dict[str, float]
    muscle: Muscle
    prediction: dict[str, np.ndarray]
    held_out_prediction: dict[str, np.ndarray]
    block: list[str]
    rmse: dict[str, float]
    noise: dict[str, ChannelNoise]
    held_out_score: HeldOutScore | None
    failed_rows: dict[Status, np.ndarray]
    form_errors: dict[str, FormErrorPart] = field(default_factory=dict)
    prediction_sd: dict[str, np.ndarray] = field(default_factory=dict)
    form_error_model: FormErrorModel | None = None

    @property
    def calibrated_range(self) -> dict[str, tuple[float, float]]:
        """Return lowest and highest pressure (Pa) and length (m) of the fitted rows."""
        usable, recording = self.case.recording.usable, self.case.recording
        return {
            name: (float(values[usable].min()), float(values[usable].max()))
            for name, values in (("pressure", recording.pressure), ("length", recording.length))
        }

    def to_dataset(self) -> xr.Dataset:
        """Return every row as an xarray Dataset: measurement, prediction and residual, SI, as in fit.nc."""
        from pamjax.infer.fitting.io import build_xarray_dataset

        return build_xarray_dataset(self)


@dataclass(frozen=True, eq=False, repr=False)
class Fit(DrawableResult, NotebookText):
    """One or several muscles, calibrated on recordings; prints as a report.

    Attributes:
        law: thread law, a key of `THREAD_LAWS`.
        mechanisms: ids of the mechanisms in addition to the threads.
        estimates: by name; with several cases, a name has its case and a slash as prefix.
        correlation: (p, p) of the estimates, in their order.
        cases: one entry for each case.
        converged: whether the minimiser converged.
        steps: steps of the minimiser in the last solve.
        agreeing_starts, starts: number of starts with the same solution, and of all starts.
        loss: "square" or "soft".
        seed: seed of the other starts and of the folds.
        space, solution, datasets: the least-squares problem and its solution.
        limited_space: the space in which values at the limits of their priors are fixed, for refits.
    """

    law: str
    mechanisms: tuple[str, ...]
    estimates: dict[str, Estimate]
    correlation: np.ndarray
    cases: tuple[CaseFit, ...]
    converged: bool
    steps: int
    agreeing_starts: int
    starts: int
    loss: Loss
    seed: int
    space: ParameterSpace = field(repr=False)
    solution: Solution = field(repr=False)
    datasets: tuple[Dataset, ...] = field(repr=False)
    limited_space: ParameterSpace = field(repr=False)

    @property
    def has_form_errors(self) -> bool:
        """Return whether the fit allows for form errors."""
        return any(case_fit.form_errors for case_fit in self.cases)

    @property
    def form_shares(self) -> dict[str, dict[str, float]]:
        """Return the sizes of the form errors by case and mechanism, as shares of the effects."""
        return {
            case_fit.case.name: {id: part.share for id, part in case_fit.form_errors.items()}
            for case_fit in self.cases
            if case_fit.form_errors
        }

    @property
    def muscle(self) -> Muscle:
        """Return the calibrated muscle of a fit of one case, without its mechanisms."""
        (only,) = self.cases
        return only.muscle

    def to_frame(self) -> pd.DataFrame:
        """Return the estimates as a table: value, sd, prior, prior_sd and unit, in display units, by name."""
        import pandas as pd

        rows = {}
        for name, estimate in self.estimates.items():
            scale = compute_si_factor(estimate.meaning.show)
            sd = math.nan if estimate.sd is None else estimate.sd / scale
            rows[name] = {
                "value": estimate.value / scale,
                "sd": sd,
                "prior": estimate.prior / scale,
                "prior_sd": estimate.prior_sd / scale,
                "unit": estimate.meaning.show,
                "at_limit": estimate.at_limit,
            }
        return pd.DataFrame.from_dict(rows, orient="index")

    def __str__(self) -> str:
        from pamjax.infer.fitting.report import format_fit_summary

        return format_fit_summary(self)

"""Estimates and predictions of a solution: the parts of a `result.Fit`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pamjax.infer.fitting.form_errors import FormSizes, describe_form_errors
from pamjax.infer.fitting.least_squares import Solution
from pamjax.infer.fitting.result import CaseFit, Estimate, HeldOutScore, NamedEstimates
from pamjax.infer.form_errors.dataset_form import estimate_form
from pamjax.infer.problem.dataset import Dataset, predict_rows
from pamjax.infer.problem.informative_samples import find_informative_samples
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.infer.problem.rms import compute_rms
from pamjax.model.balance import Status
from pamjax.records.case import Case


def build_estimates(
    space: ParameterSpace, solution: Solution, sd: np.ndarray, at_limit: set[str], meaning: Mapping
) -> NamedEstimates:
    """Return the estimates by name; a parameter at its limit has no standard deviation."""
    values = np.asarray(space.to_values(solution.u))
    return NamedEstimates(
        {
            name: Estimate(
                value=float(values[k]),
                sd=float(sd[k]) if np.isfinite(sd[k]) and name not in at_limit else None,
                prior=float(space.mean[k]),
                prior_sd=float(space.sd[k]),
                meaning=meaning[name],
                at_limit=name in at_limit,
            )
            for k, name in enumerate(space.names)
        }
    )


def build_case_fit(
    space: ParameterSpace,
    solution: Solution,
    case: Case,
    dataset: Dataset,
    noise,
    case_blocks,
    held_out_masks,
    held_out_prediction,
    form_sizes: FormSizes | None,
) -> CaseFit:
    """Return the muscle of one case, its predictions, and its errors."""
    values = space.to_values(solution.u)
    n = case.recording.n
    predicted_channels, status = (array[..., :n] for array in predict_rows(dataset, values))
    has_failed = case.recording.usable & (status != Status.OK)
    channels = case.recording.model_channels
    form = estimate_form(dataset, values)[:, :n]
    prediction = dict(zip(channels, predicted_channels + form, strict=True))
    description = (
        None if form_sizes is None else describe_form_errors(case, dataset, space, solution, form_sizes)
    )
    names = tuple(
        tuple(case_blocks.names[k] for k in np.unique(case_blocks.label[mask]) if k >= 0)
        for mask in held_out_masks
    )
    return CaseFit(
        case=case,
        numbers={name: float(number) for name, number in dataset.collect_parameters(values).items()},
        muscle=dataset.build_muscle(values),
        prediction=prediction,
        held_out_prediction=held_out_prediction,
        block=[case_blocks.names[k] if k >= 0 else "" for k in case_blocks.label],
        rmse=compute_rmse(case, prediction),
        noise=noise,
        held_out_score=HeldOutScore(case_blocks.kind, names, compute_rmse(case, held_out_prediction))
        if held_out_masks
        else None,
        failed_rows={
            s: case.recording.row[has_failed & (status == s)]
            for s in Status
            if (has_failed & (status == s)).any()
        },
        form_errors={} if description is None else description.parts,
        prediction_sd={}
        if description is None
        else dict(zip(channels, description.prediction_sd, strict=True)),
        form_error_model=None if description is None else description.model,
    )


def compute_rmse(case: Case, prediction: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Return the root mean square of measured − predicted, SI, by channel, over the informative rows."""
    rmse = {}
    for channel in case.recording.channels:
        misfit = getattr(case.recording, channel) - prediction[channel]
        misfit = misfit[find_informative_samples(case, channel) & np.isfinite(misfit)]
        if misfit.size:
            rmse[channel] = compute_rms(misfit)
    return rmse

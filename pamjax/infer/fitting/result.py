"""What a fit says: numbers with standard deviations, noise, and the score on held-out blocks."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from pamjax.infer.fitting.least_squares import Loss, Solution
from pamjax.infer.noise.sensor_noise import ChannelNoise
from pamjax.infer.problem.dataset import Dataset
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.model.balance import Status
from pamjax.model.muscle import Muscle
from pamjax.parameter import Meaning
from pamjax.records.case import Case

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Estimate:
    """One fitted number.

    Attributes:
        value, sd: SI; `sd` is None where the fit could not give one.
        prior, prior_sd: what was believed before, SI; `prior_sd` infinite for nothing.
        meaning: its unit, limits and meaning.
        at_limit: whether it sits at one of its limits.
    """

    value: float
    sd: float | None
    prior: float
    prior_sd: float
    meaning: Meaning
    at_limit: bool

    @property
    def shrinkage(self) -> float:
        """Share of the prior's standard deviation that the recording took away, 0 to 1."""
        if self.sd is None:
            return 0.0
        return 1 - min(self.sd / self._effective_prior_sd, 1.0)

    @property
    def _effective_prior_sd(self) -> float:
        """The prior's sd, SI; where that is infinite, of a value anywhere between its limits."""
        about = self.meaning
        if math.isfinite(self.prior_sd):
            return self.prior_sd
        # On a logarithmic scale a step is a share of the value.
        reach = (
            self.value * math.log(about.high / about.low) if about.scale == "log" else about.high - about.low
        )
        return reach / math.sqrt(12)


@dataclass(frozen=True)
class HeldOutScore:
    """Score on whole blocks that the fit did not see.

    Attributes:
        kind: what a block is, as "isobars".
        folds: names of the blocks that were held out together, fold by fold.
        rmse: SI, by channel, over all held-out rows.
    """

    kind: str
    folds: tuple[tuple[str, ...], ...]
    rmse: dict[str, float]


@dataclass(frozen=True, eq=False)
class CaseFit:
    """What a fit says of one case.

    Attributes:
        case: the recording and what was known.
        numbers: the muscle's numbers by name, SI: what `catalogue.assemble` takes.
        muscle: the calibrated muscle, without its mechanisms.
        prediction: (n,) by channel, SI.
        held_out_prediction: (n,) by channel, SI: each row predicted by a fit that never saw its block; NaN
            where
            no block could be held out.
        block: (n,) name of each row's block.
        rmse: SI, by channel.
        noise: by channel.
        held_out: score on held-out blocks, or None where there are too few.
        failed_rows: rows of the file where the muscle has no solution, by what failed.
    """

    case: Case
    numbers: dict[str, float]
    muscle: Muscle
    prediction: dict[str, np.ndarray]
    held_out_prediction: dict[str, np.ndarray]
    block: list[str]
    rmse: dict[str, float]
    noise: dict[str, ChannelNoise]
    held_out: HeldOutScore | None
    failed_rows: dict[Status, np.ndarray]

    @property
    def calibrated_range(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest pressure (Pa) and length (m) of the rows that were used."""
        usable, recording = self.case.recording.usable, self.case.recording
        return {
            name: (float(values[usable].min()), float(values[usable].max()))
            for name, values in (("pressure", recording.pressure), ("length", recording.length))
        }

    def to_dataset(self) -> xr.Dataset:
        """Every row: measured, predicted and left over, SI, with units (xarray); what fit.nc holds."""
        from pamjax.infer.fitting.io import build_xarray_dataset

        return build_xarray_dataset(self)


@dataclass(frozen=True, eq=False)
class Fit:
    """A muscle, or several, calibrated on recordings; prints as a lab note.

    Attributes:
        law: thread law, a key of `catalogue.LAWS`.
        mechanisms: ids of what acts beside the threads.
        estimates: by name; names of several cases carry the case's name before a slash.
        correlation: (p, p) of the estimates, in their order.
        cases: one entry for each case.
        converged: whether the minimiser says so.
        steps: of the minimiser, in the last solve.
        agreeing_starts, starts: how many of the starts ended at the same place.
        loss: "square" or "soft".
        seed: of the other starts and of the deal into folds.
        space, solution, datasets: the problem itself, to sample or to extend.
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

    @property
    def muscle(self) -> Muscle:
        """The calibrated muscle of a fit of one case, without its mechanisms."""
        (only,) = self.cases
        return only.muscle

    def __str__(self) -> str:
        from pamjax.infer.fitting.report import format_fit_note

        return format_fit_note(self)

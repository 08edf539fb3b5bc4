"""How well a recording determines a parameter: three cases, by its sd over that of its prior.

| case                          | sd over prior sd                                        |
|-------------------------------|---------------------------------------------------------|
| determined by the data        | at most `MAX_SD_RATIO_DETERMINED`                       |
| partly determined by the data | up to `_MAX_SD_RATIO_INFORMED`                          |
| not determined by the data    | larger: the posterior equals the prior; or no sd at all |

`check`, `fit` and `sample` use these cases and words.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from pamjax.parameter import Meaning

DETERMINED = "determined by the data"
PARTLY_DETERMINED = "partly determined by the data"
NOT_DETERMINED = "not determined by the data"

#: A parameter or combination is determined if the data reduce its sd to this fraction of the prior sd.
MAX_SD_RATIO_DETERMINED = 0.5
#: With a larger fraction, the posterior equals the prior.
_MAX_SD_RATIO_INFORMED = 0.95
#: With a larger shift of the estimate, in sd of the prior, the posterior does not equal the prior.
_MAX_SHIFT_OF_EQUAL = 0.2
#: With fewer rows for each parameter, a fit can follow the noise (a common rule of regression).
MIN_ROWS_PER_PARAMETER = 10

#: Prior sd of a range without a stated sd, over the range.
_SD_OF_UNIFORM = 1 / math.sqrt(12)


def compute_prior_scale(prior_sd: float, value: float, meaning: Meaning) -> float:
    """Return the sd of a prior, SI; for a uniform prior, that of its range.

    Args:
        prior_sd: sd of the prior, SI; infinite for a uniform prior.
        value: the parameter, SI; a logarithmic range has relative steps.
        meaning: its limits and scale.
    """
    if math.isfinite(prior_sd):
        return prior_sd
    if meaning.scale == "log":
        return value * math.log(meaning.high / meaning.low) * _SD_OF_UNIFORM
    return (meaning.high - meaning.low) * _SD_OF_UNIFORM


def describe_row_shortage(sample_count: int, prior_sds: Iterable[float]) -> str | None:
    """Return a warning if the samples are fewer than the parameters that only they determine.

    Args:
        sample_count: number of informative samples.
        prior_sds: sds of the priors; a parameter with an infinite one has no prior.
    """
    count = sum(math.isinf(sd) for sd in prior_sds)
    if count <= sample_count:
        return None
    return (
        f"The recording must determine {count} parameters without a stated value, and has only"
        f" {sample_count} samples that depend on them: measure more rows, or use fewer mechanisms."
    )


def describe_few_rows(row_count: int, parameter_count: int) -> str | None:
    """Return a warning if there are fewer than `MIN_ROWS_PER_PARAMETER` rows for each parameter.

    >>> describe_few_rows(38, 10)[:62]
    'The model has 10 estimated parameters, and the recording only '
    """
    if row_count >= MIN_ROWS_PER_PARAMETER * parameter_count:
        return None
    return (
        f"The model has {parameter_count} estimated parameters, and the recording only {row_count} rows:"
        f" fewer than {MIN_ROWS_PER_PARAMETER} for each parameter. Record more cycles to confirm it."
    )


def classify_sd_ratio(sd_ratio: float) -> str:
    """Return the case of a parameter.

    Args:
        sd_ratio: its sd over the sd of its prior; NaN if it has no sd.
    """
    if sd_ratio <= MAX_SD_RATIO_DETERMINED:
        return DETERMINED
    return PARTLY_DETERMINED if sd_ratio <= _MAX_SD_RATIO_INFORMED else NOT_DETERMINED


def describe_sd_ratio(sd_ratio: float, shift: float = 0.0) -> str:
    """Return the case of a parameter, with the reason if the data do not determine it.

    Args:
        sd_ratio: its sd over the sd of its prior; NaN if it has no sd.
        shift: distance of the estimate from the prior, in sd of the prior.

    >>> describe_sd_ratio(0.99), describe_sd_ratio(0.99, 0.7)
    ('not determined by the data (posterior equals prior)', 'not determined: sd hardly changed by the data')
    """
    kind = classify_sd_ratio(sd_ratio)
    if kind != NOT_DETERMINED:
        return kind
    if abs(shift) > _MAX_SHIFT_OF_EQUAL:
        return "not determined: sd hardly changed by the data"
    return f"{kind} (posterior equals prior)"

"""How well a recording determines a parameter: three cases, by its sd over that of its prior.

| case                       | sd over prior sd                                          |
|----------------------------|-----------------------------------------------------------|
| determined by the data     | at most `MAX_SD_RATIO_DETERMINED`                         |
| mostly from the prior      | up to `MAX_SD_RATIO_INFORMED`                             |
| not determined by the data | larger: the posterior equals the prior; or no sd at all   |

`check`, `fit` and `sample` use these cases and words.
"""

from __future__ import annotations

DETERMINED = "determined by the data"
MOSTLY_PRIOR = "mostly from the prior"
NOT_DETERMINED = "not determined by the data"

#: A parameter or combination is determined if the data reduce its sd to this fraction of the prior sd.
MAX_SD_RATIO_DETERMINED = 0.5
#: With a larger fraction, the posterior equals the prior.
MAX_SD_RATIO_INFORMED = 0.95


def classify_sd_ratio(sd_ratio: float) -> str:
    """Return the case of a parameter.

    Args:
        sd_ratio: its sd over the sd of its prior; NaN if it has no sd.
    """
    if sd_ratio <= MAX_SD_RATIO_DETERMINED:
        return DETERMINED
    return MOSTLY_PRIOR if sd_ratio <= MAX_SD_RATIO_INFORMED else NOT_DETERMINED


def describe_sd_ratio(sd_ratio: float) -> str:
    """Return the case of a parameter, with the reason if the data do not determine it.

    >>> describe_sd_ratio(0.99)
    'not determined by the data (posterior equals prior)'
    """
    kind = classify_sd_ratio(sd_ratio)
    return f"{kind} (posterior equals prior)" if kind == NOT_DETERMINED else kind

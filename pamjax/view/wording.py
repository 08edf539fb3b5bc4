"""Text that several pages share: signs, capital letters, the source of a noise level."""

from __future__ import annotations

from pamjax.infer.fitting.report import format_channel_value
from pamjax.records.case import Case

#: A noise within this of what the lab states is what the lab states.
NOISE_TOLERANCE = 0.01


def format_signed(value: float, digits: int = 1) -> str:
    """Return a number with its sign; zero has none.

    >>> format_signed(-1.26), format_signed(0.34), format_signed(-0.04)
    ('−1.3', '+0.3', '0.0')
    """
    text = f"{value:+.{digits}f}"
    return (text if float(text) else text[1:]).replace("-", "\N{MINUS SIGN}")


def capitalise_sentence(line: str) -> str:
    """Return a line with a capital first letter; a parameter's name, such as muscle.turns, is kept.

    >>> capitalise_sentence("no two are alike"), capitalise_sentence("muscle.turns moves")
    ('No two are alike', 'muscle.turns moves')
    """
    first_word = line.split(" ", 1)[0]
    return line if "_" in first_word or "." in first_word[:-1] else f"{line[:1].upper()}{line[1:]}"


def is_stated_noise(sd: float, stated: float) -> bool:
    """Return whether the noise of a sample equals the stated noise within `NOISE_TOLERANCE`."""
    return abs(sd / stated - 1) < NOISE_TOLERANCE


def format_noise(case: Case, channel: str, sd: float) -> str:
    """Return the noise of a channel with a stated sensor: the stated part and the propagated part.

    Args:
        case: the case.
        channel: "force" or "diameter".
        sd: noise of a sample, SI, with the noise of pressure and length propagated through the model.
    """
    stated = getattr(case.entry.sensors, channel)
    head = f"Noise of {channel} is {format_channel_value(sd, channel)} a sample"
    if stated is None or is_stated_noise(sd, stated):
        return f"{head}, as the lab states it"
    return (
        f"{head}: {format_channel_value(stated, channel)} as the lab states it, the rest added by that"
        f" of pressure and length"
    )

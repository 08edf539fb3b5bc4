"""Words that several pages share: signs, beginnings of sentences, where a noise comes from."""

from __future__ import annotations

from pamjax.infer.fitting.report import format_channel_value
from pamjax.records.case import Case

#: A noise within this of what the lab states is what the lab states.
NOISE_TOLERANCE = 0.01


def format_signed(value: float, digits: int = 1) -> str:
    """A number with its sign, and nothing without one.

    >>> format_signed(-1.26), format_signed(0.34), format_signed(-0.04)
    ('−1.3', '+0.3', '0.0')
    """
    text = f"{value:+.{digits}f}"
    return (text if float(text) else text[1:]).replace("-", "\N{MINUS SIGN}")


def capitalise_sentence(line: str) -> str:
    """A line that begins as a sentence does; a name of a program, as muscle.turns, stays as it is.

    >>> capitalise_sentence("no two are alike"), capitalise_sentence("muscle.turns moves")
    ('No two are alike', 'muscle.turns moves')
    """
    first_word = line.split(" ", 1)[0]
    return line if "_" in first_word or "." in first_word[:-1] else f"{line[:1].upper()}{line[1:]}"


def is_stated_noise(sd: float, stated: float) -> bool:
    """Whether the noise of a sample is what the lab states, and nothing to speak of is added."""
    return abs(sd / stated - 1) < NOISE_TOLERANCE


def format_noise(case: Case, channel: str, sd: float) -> str:
    """Noise of a channel where a sensor is stated: what the lab states of it, and what makes up the rest.

    Args:
        sd: of a sample, SI, with that of pressure and length carried through the model.
    """
    stated = getattr(case.entry.sensors, channel)
    head = f"Noise of {channel} is {format_channel_value(sd, channel)} a sample"
    if stated is None or is_stated_noise(sd, stated):
        return f"{head}, as the lab states it"
    return (
        f"{head}: {format_channel_value(stated, channel)} as the lab states it, the rest added by that"
        f" of pressure and length"
    )

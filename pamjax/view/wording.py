"""Words that several pages share: signs, beginnings of sentences, where a noise comes from."""

from __future__ import annotations

from pamjax.infer.fitting.report import told
from pamjax.records.case import Case

#: A noise within this of what the lab states is what the lab states.
SAME = 0.01


def signed(value: float, digits: int = 1) -> str:
    """A number with its sign, and nothing without one.

    >>> signed(-1.26), signed(0.34), signed(-0.04)
    ('−1.3', '+0.3', '0.0')
    """
    text = f"{value:+.{digits}f}"
    return (text if float(text) else text[1:]).replace("-", "\N{MINUS SIGN}")


def upper(line: str) -> str:
    """A line that begins as a sentence does; a name of a program, as muscle.turns, stays as it is.

    >>> upper("no two are alike"), upper("muscle.turns moves")
    ('No two are alike', 'muscle.turns moves')
    """
    first = line.split(" ", 1)[0]
    return line if "_" in first or "." in first[:-1] else f"{line[:1].upper()}{line[1:]}"


def same_noise(sd: float, stated: float) -> bool:
    """Whether the noise of a sample is what the lab states, and nothing to speak of is added."""
    return abs(sd / stated - 1) < SAME


def noise_says(case: Case, channel: str, sd: float) -> str:
    """Noise of a channel where a sensor is stated: what the lab states of it, and what makes up the rest.

    Args:
        sd: of a sample, SI, with that of pressure and length carried through the model.
    """
    stated = getattr(case.entry.sensors, channel)
    head = f"Noise of {channel} is {told(sd, channel)} a sample"
    if stated is None or same_noise(sd, stated):
        return f"{head}, as the lab states it"
    return (
        f"{head}: {told(stated, channel)} as the lab states it, the rest added by that of pressure and length"
    )

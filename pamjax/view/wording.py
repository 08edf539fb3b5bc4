"""Text that several pages share: signs, capital letters, sources of a noise level."""

from __future__ import annotations

import re
import textwrap

from pamjax.channels import format_channel_value
from pamjax.records.case import Case

#: Relative difference up to which a noise level counts as the one stated in muscle.toml.
_NOISE_TOLERANCE = 0.01

#: Sentence for the caption of lines that follow the rows in time.
BRANCHES_SENTENCE = (
    "A line has two branches where the model depends on the direction of motion, for example by friction."
)


def format_signed(value: float, digits: int = 1) -> str:
    """Return a value with its sign; zero has no sign.

    >>> format_signed(-1.26), format_signed(0.34), format_signed(-0.04)
    ('−1.3', '+0.3', '0.0')
    """
    text = f"{value:+.{digits}f}"
    return (text if float(text) else text[1:]).replace("-", "\N{MINUS SIGN}")


def capitalise_sentence(line: str) -> str:
    """Return a line with a capital first letter; a parameter name such as muscle.turns is not changed.

    >>> capitalise_sentence("two values differ"), capitalise_sentence("muscle.turns increases")
    ('Two values differ', 'muscle.turns increases')
    """
    first_word = line.split(" ", 1)[0]
    return line if "_" in first_word or "." in first_word[:-1] else f"{line[:1].upper()}{line[1:]}"


def keep_units_with_numbers(text: str) -> str:
    """Return a text in which a line does not break between a number and its unit, or within ± and →.

    >>> keep_units_with_numbers("at 250 kPa, 3.7 ± 0.6 mm").count("\\u00a0")
    4
    """
    text = re.sub(r"(?<=\d) (?=(?:N|kPa|MPa|GPa|Pa|mm|m|s|ms|deg|sd)\b|%)", "\u00a0", text)
    return re.sub(r" ([±→]) ", "\u00a0\\1\u00a0", text)


def wrap_title(text: str, letters: int) -> str:
    """Return a text in lines of at most so many letters, without a break at a hyphen or before a unit.

    >>> wrap_title("With friction: held-out RMS error of force 2.5 N", 20)
    'With friction:\\nheld-out RMS error\\nof force 2.5 N'
    """
    lines = textwrap.fill(keep_units_with_numbers(text), letters, break_on_hyphens=False)
    return lines.replace("\u00a0", " ")


def format_history(case: Case) -> str:
    """Return the assumed history of the muscle, and what happens to its memory at gaps."""
    history = "at rest" if case.before == "relaxed" else "in the state after one pass of this recording"
    memory = "continues across" if case.gaps == "carry" else "restarts at"
    return f"Before its first row the muscle is {history}; its memory {memory} gaps of the recording"


def is_stated_noise(sd: float, stated_sd: float) -> bool:
    """Return whether the noise of a row equals the stated noise within `_NOISE_TOLERANCE`."""
    return abs(sd / stated_sd - 1) < _NOISE_TOLERANCE


def format_noise(case: Case, channel: str, sd: float) -> str:
    """Return the noise of a channel with a stated sensor noise: the stated part and the propagated part.

    Args:
        case: the case.
        channel: "force" or "diameter".
        sd: noise of one row, SI, with the noise of pressure and length propagated through the model.
    """
    stated_sd = getattr(case.muscle_toml.sensors, channel)
    head = f"Noise of {channel} is {format_channel_value(sd, channel)} per row"
    if stated_sd is None or is_stated_noise(sd, stated_sd):
        return f"{head}, as stated in muscle.toml"
    return (
        f"{head}. Stated in muscle.toml: {format_channel_value(stated_sd, channel)};"
        f" the difference is due to the noise of pressure and length"
    )

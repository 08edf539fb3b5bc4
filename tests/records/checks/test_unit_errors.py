"""A wrong unit in a header is refused, with the probable unit."""

from pathlib import Path

import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.records.case import build_case
from tests.records.conftest import MUSCLE, strokes


@pytest.mark.parametrize("header", ["bar", "psi"])
def test_psi_under_a_bar_header_is_refused_without_rows_near_rest(header):
    """Without rows near rest, a small force alone is a note; an impossible pressure makes it a unit error."""
    columns = strokes(levels=(275.8e3, 413.7e3, 551.6e3))
    rows = columns["length"] < 0.96 * 0.2
    table = {
        "pressure": columns["pressure"] / 6894.757,
        "length": columns["length"] * 1e3,
        "force": columns["force"],
    }
    text = f"pressure [{header}],length [mm],force [N]\n" + "".join(
        ",".join(f"{table[name][k]:.8g}" for name in table) + "\n" for k in np.flatnonzero(rows)
    )
    message = ""
    try:
        build_case(MUSCLE.encode(), text.encode(), Path("case"), "carry", "relaxed")
    except BadInput as error:
        message = str(error)
    assert ("pressure in psi under a header of bar" in message) == (header == "bar")
    assert bool(message) == (header == "bar")


@pytest.mark.parametrize("pull", [0.0, 20.0])
def test_only_slack_rows_are_refused(pull):
    noise = 2.0 * np.sin(np.arange(40.0))
    text = "pressure [kPa],length [mm],force [N]\n" + "".join(
        f"{20 + 0.1 * k:.1f},150,{value + pull:.3f}\n" for k, value in enumerate(noise)
    )
    toml = (MUSCLE + '[sensors]\nforce = "2 N"\n').encode()
    if pull:
        assert build_case(toml, text.encode(), Path("case"), "carry", "relaxed").recording.n == 40
        return
    with pytest.raises(BadInput, match="`force` of at least one row must exceed its noise"):
        build_case(toml, text.encode(), Path("case"), "carry", "relaxed")

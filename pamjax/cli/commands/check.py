"""`pamjax check`: check a recording, and which parameters it determines."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.options import Json
from pamjax.cli.screen import print_json, print_text


def check(case: Path, /, *, law: str | None = None, json: Json = False) -> None:
    """Check a case before a fit: its data, and which parameters it determines.

    The report lists rows, units, ranges, outliers and blocks. It also lists which parameters the recording
    determines, which it determines only in combination, and which come mostly from the prior.

    Args:
        case: case folder with recording.csv and muscle.toml.
        law: thread law; by default that of the case's baseline model.
        json: print one JSON document.
    """
    from pamjax.records.case import read_case

    parsed_case = read_case(case)
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.infer.fitting.case_summary import CaseSummary
    from pamjax.infer.fitting.identifiability import check_identifiability

    keep_compiled()
    summary = CaseSummary(parsed_case, *check_identifiability(parsed_case, law))
    print_json(summary.as_dict()) if json else print_text(str(summary))

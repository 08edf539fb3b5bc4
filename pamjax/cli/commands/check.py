"""`pamjax check`: is a recording fit to be fitted, and what could it determine."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.options import Json
from pamjax.cli.screen import print_json, print_text


def check(case: Path, /, *, law: str | None = None, json: Json = False) -> None:
    """Say whether a case is fit to be fitted, without fitting it.

    Rows, units, ranges, outliers, blocks; which numbers the recording can determine, which only
    together, and which not.

    Args:
        case: case folder.
        law: thread law; the case's baseline if left out.
        json: print for programs.
    """
    from pamjax.records.case import read_case

    parsed_case = read_case(case)
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.infer.fitting.case_summary import CaseSummary
    from pamjax.infer.fitting.identifiability import check_identifiability

    keep_compiled()
    summary = CaseSummary(parsed_case, *check_identifiability(parsed_case, law))
    print_json(summary.as_dict()) if json else print_text(str(summary))

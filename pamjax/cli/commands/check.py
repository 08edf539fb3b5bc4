"""`pamjax check`: check a recording, and which parameters it determines."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.options import Json, MechanismList
from pamjax.cli.screen import print_json, print_text


def check(
    cases: list[Path],
    /,
    *,
    law: str | None = None,
    with_: MechanismList = None,
    json: Json = False,
) -> None:
    """Check cases before a fit: their data, and which parameters they determine.

    The report lists rows, units, ranges, outliers and blocks. It also lists which parameters the recording
    determines, which it determines only in combination, and which it determines only partly.

    Args:
        cases: case folders, each with recording.csv and muscle.toml.
        law: thread law; by default that of the case's baseline model.
        with_: mechanisms to include in the model, as for `pamjax fit`, such as bladder_elasticity.
        json: print one JSON document: an object for one case, a list of objects for several.
    """
    from pamjax.records.case import read_case

    parsed_cases = [read_case(folder) for folder in cases]
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.infer.fitting.case_summary import CaseSummary
    from pamjax.infer.fitting.identifiability import check_identifiability

    keep_compiled()
    mechanisms = with_ or []
    summaries = [
        CaseSummary(case, *check_identifiability(case, law, mechanisms), mechanisms) for case in parsed_cases
    ]
    if json:
        documents = [summary.as_dict() for summary in summaries]
        print_json(documents[0] if len(documents) == 1 else documents)
    else:
        print_text("\n\n".join(map(str, summaries)))

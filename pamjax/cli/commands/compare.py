"""`pamjax compare`: compare posteriors by their predictions of held-out blocks."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.options import Json
from pamjax.cli.screen import print_json, print_text


def compare(posteriors: list[Path], /, *, json: Json = False) -> None:
    """Compare posteriors of one recording by their predictions of held-out blocks.

    Args:
        posteriors: output folders of `pamjax sample`, or their posterior.nc files.
        json: print one JSON document.
    """
    from pamjax.infer.posterior.compare import compare

    comparison = compare(posteriors)
    print_json(comparison.as_dict()) if json else print_text(str(comparison))

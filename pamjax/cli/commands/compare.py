"""`pamjax compare`: which posterior predicts blocks that it did not see."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.options import Json
from pamjax.cli.screen import print_json, print_text


def compare(posteriors: list[Path], /, *, json: Json = False) -> None:
    """Compare posteriors of the same recording by how they predict whole blocks they did not see.

    Args:
        posteriors: folders that `pamjax sample` wrote to, or their posterior.nc.
        json: print for programs.
    """
    from pamjax.infer.posterior.compare import compare_posteriors

    comparison = compare_posteriors(posteriors)
    print_json(comparison.as_dict()) if json else print_text(str(comparison))

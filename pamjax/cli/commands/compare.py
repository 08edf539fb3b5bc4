"""`pamjax compare`: which posterior predicts blocks that it did not see."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.options import Json
from pamjax.cli.screen import say, say_json


def compare(posteriors: list[Path], /, *, json: Json = False) -> None:
    """Compare posteriors of the same recording by how they predict whole blocks they did not see.

    Args:
        posteriors: folders that `pamjax sample` wrote to, or their posterior.nc.
        json: print for programs.
    """
    from pamjax.infer.posterior.compare import compare_posteriors

    found = compare_posteriors(posteriors)
    say_json(found.as_dict()) if json else say(str(found))

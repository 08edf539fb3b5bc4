"""Posteriors of one recording compared by how they predict whole blocks that they did not see.

The score of a posterior is Σ over blocks of ln p(block | the other blocks), by importance (`psis.py`); the
difference of two has the standard error of its blocks, sqrt(blocks) × sd of the differences. Blocks, not
samples: rows of one loop know each other.

What it leaves out: a block on which a posterior leans (k̂ > 0.7) would need a run without it; it is named.
A posterior whose samples count less than one each (`density.py`) is left out of a block by their full weight.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.errors import refuse
from pamjax.infer.posterior.io import SCHEMA
from pamjax.infer.posterior.loo import TRUSTED, left_out

#: A difference below this many of its standard errors says nothing.
CLEAR = 2.0


@dataclass(frozen=True, eq=False)
class Score:
    """One posterior's score.

    Attributes:
        name: the file's folder.
        model: law and mechanisms.
        blocks: names.
        each: (blocks,) log predictive density.
        shape: (blocks,) k̂.
    """

    name: str
    model: str
    blocks: tuple[str, ...]
    each: np.ndarray
    shape: np.ndarray

    @property
    def total(self) -> float:
        """ln p of all blocks, each by the others."""
        return float(self.each.sum())


@dataclass(frozen=True, eq=False)
class Comparison:
    """Posteriors, best first; prints as a note."""

    scores: tuple[Score, ...]

    def behind(self, score: Score) -> tuple[float, float]:
        """By how much a posterior is behind the best, and the standard error of that."""
        difference = self.scores[0].each - score.each
        error = float(np.sqrt(len(difference)) * difference.std(ddof=1)) if len(difference) > 1 else np.inf
        return float(difference.sum()), error

    def __str__(self) -> str:
        width = max(len(s.name) for s in self.scores)
        lines = [f"ln p of {len(self.scores[0].blocks)} blocks, each by a posterior that did not see it"]
        for s in self.scores:
            less, error = self.behind(s)
            rest = "best" if s is self.scores[0] else f"behind by {less:.1f} ± {error:.1f}"
            lines.append(f"  {s.name:<{width}}  {s.total:>10.1f}  {rest:<22} {s.model}")
        for s in self.scores:
            bad = [b for b, k in zip(s.blocks, s.shape, strict=True) if not k < TRUSTED]
            if bad:
                guess = f"its score there is a guess (k̂ up to {s.shape.max():.1f})"
                lines.append(f"  {s.name} leans on {_few(bad)}: {guess}")
        return "\n".join([*lines, self._finding()])

    def _finding(self) -> str:
        if len(self.scores) == 1:
            return "  nothing to compare it with"
        less, error = self.behind(self.scores[1])
        if less > CLEAR * error:
            return f"  {self.scores[0].name} predicts better than {self.scores[1].name}"
        return f"  {self.scores[0].name} and {self.scores[1].name} cannot be told apart"

    def as_dict(self) -> dict[str, Any]:
        """For programs."""
        return {
            s.name: {
                "model": s.model,
                "score": s.total,
                "behind": self.behind(s)[0],
                "error": self.behind(s)[1] if np.isfinite(self.behind(s)[1]) else None,
                "blocks": dict(zip(s.blocks, s.each.tolist(), strict=True)),
                "shape": dict(zip(s.blocks, np.nan_to_num(s.shape, posinf=1e9).tolist(), strict=True)),
            }
            for s in self.scores
        }


def compare_posteriors(files: Sequence[Path]) -> Comparison:
    """Compare posteriors of the same recordings.

    Args:
        files: each a posterior.nc, or a folder that holds one.

    Raises:
        BadInput: if a file is none, or they saw different measurements.
    """
    if not files:
        raise refuse("a comparison needs a posterior", "none")
    read = [_read(path) for path in files]
    for (score, seen), path in zip(read, files, strict=True):
        if not _same(read[0][1], seen) or score.blocks != read[0][0].blocks:
            remedy = "Sample both from the same recording.csv."
            raise refuse("posteriors are compared on the same measurements", "others", str(path), remedy)
    return Comparison(tuple(sorted((score for score, _ in read), key=lambda s: -s.total)))


def _read(path: Path) -> tuple[Score, dict[str, np.ndarray]]:
    import xarray as xr

    file = path / "posterior.nc" if path.is_dir() else path
    if not file.is_file():
        raise refuse(f"there is no file {file}", remedy="`pamjax sample` writes one.")
    try:
        tree = xr.open_datatree(file, engine="h5netcdf")
    except (OSError, ValueError) as error:
        raise refuse(
            "a posterior is a netCDF that `pamjax sample` wrote", "another file", str(file)
        ) from error
    with tree:
        if tree.attrs.get("schema") != SCHEMA:
            raise refuse(
                f"a posterior is a file of schema {SCHEMA}", str(tree.attrs.get("schema")), str(file)
            )
        model = ", ".join((f"{tree.attrs['law']} threads", *json.loads(tree.attrs["mechanisms"])))
        names, each, shape = [], [], []
        blocks = tree["log_likelihood"].to_dataset()
        for key, likelihood in blocks.data_vars.items():
            sums = likelihood.values.reshape(-1, likelihood.shape[-1])
            block = str(key).removesuffix("s")
            names += [f"{str(key).removesuffix('blocks')}{b}" for b in blocks[block].values]
            found = [left_out(column) for column in sums.T]
            each += [score for score, _ in found]
            shape += [k for _, k in found]
        seen = {
            str(key): v.values
            for key, v in tree["observed_data"].to_dataset().data_vars.items()
            if v.dtype.kind == "f"
        }
    name = file.parent.name or file.stem
    return Score(name, model, tuple(names), np.array(each), np.array(shape)), seen


def _same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    return one.keys() == other.keys() and all(
        v.shape == other[k].shape and np.array_equal(v, other[k], equal_nan=True) for k, v in one.items()
    )


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")

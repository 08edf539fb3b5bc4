"""Comparison of posteriors of one recording by their predictions of held-out blocks.

The score of a posterior is Σ over blocks of ln p(block | the other blocks), by importance sampling
(`loo.py`). The standard error of the difference of two scores is sqrt(blocks) × sd of the differences. The
unit is a block, because rows of one loop are correlated. The coefficients of form errors are drawn like
parameters, so that posteriors with and without form errors can be compared.

Limits: the score of an influential block (k̂ > 0.7) is not reliable without another run; the
report lists such blocks. Samples with reduced weights (`log_density.py`) count fully here. The shapes and
sizes of form errors are those of a fit to all blocks.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.errors import BadInput
from pamjax.infer.posterior.io import POSTERIOR_SCHEMA
from pamjax.infer.posterior.loo import MAX_PARETO_K, compute_loo_score
from pamjax.notebook import NotebookText

#: Smallest significant difference, in its standard errors.
_MIN_CLEAR_DIFFERENCE = 2.0


@dataclass(frozen=True, eq=False)
class PosteriorScore:
    """Score of one posterior.

    Attributes:
        name: folder of the file.
        model: law and mechanisms.
        blocks: names.
        block_scores: (blocks,) log predictive density.
        pareto_k: (blocks,) k̂.
    """

    name: str
    model: str
    blocks: tuple[str, ...]
    block_scores: np.ndarray
    pareto_k: np.ndarray

    @property
    def total(self) -> float:
        """Return the sum over blocks of ln p(block | the other blocks)."""
        return float(self.block_scores.sum())


@dataclass(frozen=True, eq=False, repr=False)
class PosteriorComparison(NotebookText):
    """Posteriors, best first; prints as a report."""

    scores: tuple[PosteriorScore, ...]

    def compute_deficit(self, score: PosteriorScore) -> tuple[float, float]:
        """Return the difference of the best score and a posterior's, and its standard error."""
        difference = self.scores[0].block_scores - score.block_scores
        error = float(np.sqrt(len(difference)) * difference.std(ddof=1)) if len(difference) > 1 else np.inf
        return float(difference.sum()), error

    def __str__(self) -> str:
        width = max(len(s.name) for s in self.scores)
        lines = [f"ln p of {len(self.scores[0].blocks)} held-out blocks"]
        for s in self.scores:
            deficit, error = self.compute_deficit(s)
            conclusion = "best" if s is self.scores[0] else f"lower by {deficit:.1f} ± {error:.1f}"
            lines.append(f"  {s.name:<{width}}  {s.total:>10.1f}  {conclusion:<22} {s.model}")
        for s in self.scores:
            unreliable = [b for b, k in zip(s.blocks, s.pareto_k, strict=True) if not k < MAX_PARETO_K]
            if unreliable:
                lines.append(
                    f"  {s.name}: the score of {_format_few_names(unreliable)} is not reliable:"
                    f" Pareto k̂ is up to {s.pareto_k.max():.1f}, above {MAX_PARETO_K}"
                )
        return "\n".join([*lines, self._format_conclusion()])

    def _format_conclusion(self) -> str:
        if len(self.scores) == 1:
            return "  only one posterior: no comparison"
        deficit, error = self.compute_deficit(self.scores[1])
        if deficit > _MIN_CLEAR_DIFFERENCE * error:
            return f"  {self.scores[0].name} predicts better than {self.scores[1].name}"
        return f"  {self.scores[0].name} and {self.scores[1].name} predict equally well within the error"

    def as_dict(self) -> dict[str, Any]:
        """Return the scores as a JSON document."""
        return {
            s.name: {
                "model": s.model,
                "score": s.total,
                "deficit": self.compute_deficit(s)[0],
                "error": self.compute_deficit(s)[1] if np.isfinite(self.compute_deficit(s)[1]) else None,
                "blocks": dict(zip(s.blocks, s.block_scores.tolist(), strict=True)),
                "pareto_k": dict(zip(s.blocks, np.nan_to_num(s.pareto_k, posinf=1e9).tolist(), strict=True)),
            }
            for s in self.scores
        }


def compare(posteriors: Sequence[str | Path]) -> PosteriorComparison:
    """Return the comparison of posteriors of one recording by their predictions of held-out blocks.

    Args:
        posteriors: each a posterior.nc of `save_posterior`, or a folder that contains one.

    Returns:
        the `PosteriorComparison`, best first; `print` shows its summary.

    Raises:
        BadInput: if a file is not a posterior, or the measurements differ.

    Example:
        print(pamjax.compare(["out/elastic", "out/inelastic"]))
    """
    files = [Path(path) for path in posteriors]
    if not files:
        raise BadInput.from_rule(
            "a comparison needs a posterior", "none", remedy="Name the folders that `pamjax sample` wrote."
        )
    read_scores = [_read_score(path) for path in files]
    for (score, observed_data), path in zip(read_scores, files, strict=True):
        if not _are_data_equal(read_scores[0][1], observed_data) or score.blocks != read_scores[0][0].blocks:
            remedy = "Sample both from the same recording.csv."
            raise BadInput.from_rule(
                "posteriors must have the same measurements", "other measurements", str(path), remedy
            )
    return PosteriorComparison(tuple(sorted((score for score, _ in read_scores), key=lambda s: -s.total)))


def _read_score(path: Path) -> tuple[PosteriorScore, dict[str, np.ndarray]]:
    import xarray as xr

    file = path / "posterior.nc" if path.is_dir() else path
    if not file.is_file():
        raise BadInput.from_rule(f"there is no file {file}", remedy="`pamjax sample` writes one.")
    try:
        tree = xr.open_datatree(file, engine="h5netcdf")
    except (OSError, ValueError) as error:
        raise BadInput.from_rule(
            "a posterior is a netCDF that `pamjax sample` wrote",
            "another file",
            str(file),
            "Name posterior.nc.",
        ) from error
    with tree:
        if tree.attrs.get("schema") != POSTERIOR_SCHEMA:
            raise BadInput.from_rule(
                f"a posterior is a file of schema {POSTERIOR_SCHEMA}",
                str(tree.attrs.get("schema")),
                str(file),
                "Run `pamjax sample` again.",
            )
        model = ", ".join((f"{tree.attrs['law']} threads", *json.loads(tree.attrs["mechanisms"])))
        shares = json.loads(tree.attrs.get("form_errors", "{}"))
        model += " with form errors" if any(max(of.values()) > 0 for of in shares.values()) else ""
        names, block_scores, pareto_k = [], [], []
        blocks = tree["log_likelihood"].to_dataset()
        for key, likelihood in blocks.data_vars.items():
            sums = likelihood.values.reshape(-1, likelihood.shape[-1])
            block = str(key).removesuffix("s")
            names += [f"{str(key).removesuffix('blocks')}{b}" for b in blocks[block].values]
            loo_scores = [compute_loo_score(column) for column in sums.T]
            block_scores += [score for score, _ in loo_scores]
            pareto_k += [k for _, k in loo_scores]
        observed_data = {
            str(key): v.values
            for key, v in tree["observed_data"].to_dataset().data_vars.items()
            if v.dtype.kind == "f"
        }
    name = file.parent.name or file.stem
    return PosteriorScore(
        name, model, tuple(names), np.array(block_scores), np.array(pareto_k)
    ), observed_data


def _are_data_equal(first: dict[str, np.ndarray], second: dict[str, np.ndarray]) -> bool:
    return first.keys() == second.keys() and all(
        v.shape == second[k].shape and np.array_equal(v, second[k], equal_nan=True) for k, v in first.items()
    )


def _format_few_names(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")

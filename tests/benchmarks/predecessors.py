"""Predecessor of each sample, for the likelihood of AR(1) noise in another program."""

import numpy as np

from pamjax.infer.posterior.ar1_likelihood import Ar1Likelihood


def list_predecessors(likelihood: Ar1Likelihood, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return whether each row has a predecessor in its run, and the row of it, (n,) each."""
    order, position = np.asarray(likelihood.order), np.asarray(likelihood.position)
    later = np.flatnonzero(position > 0)
    has_predecessor, predecessor = np.zeros(n, dtype=bool), np.zeros(n, dtype=int)
    has_predecessor[order[later]] = True
    predecessor[order[later]] = order[later - 1]
    return has_predecessor, predecessor

"""Are the posteriors' intervals true? Simulation-based calibration over 300 recordings, elastic and toe.

    python -m tests.benchmarks.calibration [count] [elastic|toe|white ...]

"white" is the elastic bench read with a likelihood that takes correlated samples for independent: it must
be caught. Ranks of the truth among `DRAWS` draws fall into `BINS` bins; a number passes if the χ² of their
counts has p > `CAUGHT` over the number of numbers tested (Bonferroni).
"""

import sys

import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.stats import chi2

from pamjax.infer.checkpoint import Checkpoint
from pamjax.infer.density import tempered
from pamjax.infer.ensemble import Ensemble
from pamjax.infer.laplace import laplace
from pamjax.infer.sample import shaped, walk_on
from tests.calibrated import Bench, believing_white

DRAWS, BINS, CAUGHT = 99, 20, 0.01
LEVELS = (0.5, 0.8, 0.9, 0.95)
#: What each chain has to reach: 99 draws of it are then nearly independent.
ESS, RHAT, LONGEST = 400.0, 1.05, 10_000


def draws_of(bench: Bench, k: int, white: bool) -> tuple[np.ndarray, bool]:
    """(DRAWS, p) posterior draws of recording k, and whether its chain was good enough."""
    density, start = bench.recording(k)
    density = believing_white(density) if white else density
    ball = laplace(density, start)
    if not white:
        density = tempered(density, ball.centre, bench.fit)
    ball = shaped(density, ball, k)
    walk = Ensemble(density, ball)
    chunks, found = walk_on(walk, Checkpoint(None, {}), walk.begin(k), (ESS, RHAT, LONGEST), lambda *_: None)
    x = np.concatenate([chunk["x"] for chunk in chunks])
    x = x[len(x) // 5 :].reshape(-1, x.shape[2])
    chosen = x[np.linspace(0, len(x) - 1, DRAWS).astype(int)]
    values = np.stack([np.asarray(density.at.values(ball(jnp.asarray(row)))) for row in chosen])
    return values, found.good(ESS, RHAT, long=True)


def ranks(law: str, count: int, white: bool) -> tuple[tuple[str, ...], np.ndarray, int]:
    """Names, (count, p) ranks of the truth, and how many chains fell short."""
    bench, found, short = Bench(law, count), [], 0
    for k in range(count):
        values, good = draws_of(bench, k, white)
        short += not good
        found.append((values < bench.true[k]).sum(axis=0))
    return bench.density.at.names, np.array(found), short


def p_value(rank: np.ndarray) -> float:
    """Of the χ² of the ranks' counts in equal bins."""
    counts = np.histogram(rank, BINS, (0, DRAWS + 1))[0]
    wanted = rank.size / BINS
    return float(chi2.sf(((counts - wanted) ** 2 / wanted).sum(), BINS - 1))


def covered(rank: np.ndarray, level: float) -> float:
    """Share of recordings whose truth lies within the central interval of a level."""
    tail = (1 - level) / 2 * (DRAWS + 1)
    return float(np.mean((rank + 0.5 > tail) & (rank + 0.5 < DRAWS + 1 - tail)))


def report(console: Console, law: str, count: int, white: bool = False) -> None:
    names, found, short = ranks(law, count, white)
    title = f"{law}{', believing that samples are independent' if white else ''}: {count} recordings"
    table = Table(
        "number", "p", *(f"in {100 * level:.0f} %" for level in LEVELS), f"ranks in {BINS} bins", title=title
    )
    tested = [k for k, name in enumerate(names) if not (white and name.endswith("_correlation"))]
    worst = 1.0
    for k in tested:
        p = p_value(found[:, k])
        worst = min(worst, p)
        bars = np.histogram(found[:, k], BINS, (0, DRAWS + 1))[0]
        shares = (f"{100 * covered(found[:, k], level):.0f} %" for level in LEVELS)
        table.add_row(names[k], f"{p:.2g}", *shares, " ".join(map(str, bars)))
    console.print(table)
    caught = worst < CAUGHT / len(tested)
    console.print(
        f"{short} chains fell short; ranks are {'NOT uniform' if caught else 'uniform'}: least p {worst:.2g}"
    )


def main() -> None:
    words = sys.argv[1:]
    count = int(words.pop(0)) if words and words[0].isdigit() else 300
    console = Console(width=150)
    for word in words or ["elastic", "toe", "white"]:
        report(console, "elastic" if word == "white" else word, count, word == "white")


if __name__ == "__main__":
    main()

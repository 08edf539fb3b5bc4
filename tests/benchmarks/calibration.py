"""Simulation-based calibration of the posteriors over 300 recordings, with elastic and toe threads.

    python -m tests.benchmarks.calibration [count] [elastic|toe|white ...] [--json FILE]

"white" uses a wrong likelihood, which treats correlated samples as independent; the test must detect it.
Ranks of the true values among `DRAWS` draws are counted in `BINS` bins. A parameter passes if the χ² of its
counts has p > `CAUGHT` / number of tested parameters (Bonferroni).

Each completed recording is a line of out/calibration/WORD.jsonl; the next run continues from there.
"""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path
from queue import Empty, SimpleQueue

import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.stats import chi2

from pamjax.compile.jax_cache import keep_compiled
from pamjax.infer.posterior.checkpoint import Checkpoint
from pamjax.infer.posterior.convergence import discard_burn_in
from pamjax.infer.posterior.laplace import fit_laplace
from pamjax.infer.posterior.log_density import apply_autocorrelation_powers
from pamjax.infer.posterior.sample import PILOT_STEPS, refine_gaussian
from pamjax.infer.posterior.sampler import concatenate_chunks, run_sampler
from tests.benchmarks.keep import arguments, keep
from tests.benchmarks.together import JointEvaluator, JointSampler
from tests.calibrated import Bench, treat_noise_as_white

DRAWS, BINS, CAUGHT = 99, 20, 0.01
LEVELS = (0.5, 0.8, 0.9, 0.95)
#: Required effective sample size of each chain: 99 draws of it are then nearly independent.
ESS, RHAT, LONGEST = 400.0, 1.05, 10_000
#: Number of parallel recordings, and points of one request: half of the ensemble's 32 walkers.
CHAINS, POINTS = 16, 16


def draw_posterior(
    bench: Bench, k: int, white: bool, evaluator: JointEvaluator, chain_index: int
) -> tuple[np.ndarray, float, float]:
    """Return posterior draws of recording k, (DRAWS, p), and least ESS and largest split-R̂."""
    density, start = bench.recording(k)
    density = treat_noise_as_white(density) if white else density
    ball = fit_laplace(density, start)
    if not white:
        density = apply_autocorrelation_powers(density, ball.centre, bench.fit)
    with evaluator.register(chain_index, density):
        ball = refine_gaussian(
            JointSampler(density, ball, PILOT_STEPS, evaluator=evaluator, chain_index=chain_index), k
        )
        walk = JointSampler(density, ball, evaluator=evaluator, chain_index=chain_index)
        wanted = (ESS, RHAT, LONGEST)
        chunks, chain = run_sampler(walk, Checkpoint(None, {}), walk.draw_start(k), wanted, lambda *_: None)
    x = discard_burn_in(concatenate_chunks(chunks, "x"))
    x = x.reshape(-1, x.shape[2])[np.linspace(0, x.shape[0] * x.shape[1] - 1, DRAWS).astype(int)]
    return np.asarray(density.space.to_values(ball(jnp.asarray(x)))), chain.ess.min(), chain.rhat.max()


class Ledger:
    """A file with one line per recording: its number, ranks and chain diagnostics."""

    def __init__(self, path: Path) -> None:
        self.path, self.lock = path, threading.Lock()
        path.parent.mkdir(parents=True, exist_ok=True)
        self.lines: dict[int, dict] = {}
        for text in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
            # A killed run may have left an incomplete line.
            if text.endswith("}"):
                line = json.loads(text)
                self.lines[line["recording"]] = line

    def add(self, recording: int, ranks: np.ndarray, ess: float, rhat: float) -> None:
        line = {"recording": recording, "ranks": ranks.tolist(), "ess": float(ess), "rhat": float(rhat)}
        with self.lock:
            self.lines[recording] = line
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")


def read_all(word: str, count: int, console: Console) -> tuple[tuple[str, ...], list[dict]]:
    """Return the parameter names and the lines of all recordings; missing recordings are computed."""
    white = word == "white"
    ledger = Ledger(Path("out/calibration") / f"{word}.jsonl")
    bench = Bench("elastic" if white else word, count)
    wanting: SimpleQueue[int] = SimpleQueue()
    for k in sorted(set(range(count)) - set(ledger.lines)):
        wanting.put(k)
    first = bench.recording(0)[0]
    evaluator = JointEvaluator(treat_noise_as_white(first) if white else first, CHAINS, POINTS)
    broken: list[Exception] = []

    def work(chain_index: int) -> None:
        try:
            while not broken:
                k = wanting.get_nowait()
                values, ess, rhat = draw_posterior(bench, k, white, evaluator, chain_index)
                ledger.add(k, (values < bench.true[k]).sum(axis=0), ess, rhat)
                if len(ledger.lines) % 25 == 0:
                    busy = time.process_time()
                    console.print(f"{word}: {len(ledger.lines)} recordings, {busy:.0f} s of processor")
        except Empty:
            pass
        except Exception as error:
            broken.append(error)

    threads = [threading.Thread(target=work, args=(k,), daemon=True) for k in range(CHAINS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if broken:
        raise broken[0]
    return bench.density.space.names, [ledger.lines[k] for k in range(count)]


def p_value(rank: np.ndarray) -> float:
    """Return the p-value of the χ² of rank counts in equal bins."""
    counts = np.histogram(rank, BINS, (0, DRAWS + 1))[0]
    wanted = rank.size / BINS
    return float(chi2.sf(((counts - wanted) ** 2 / wanted).sum(), BINS - 1))


def covered(rank: np.ndarray, level: float) -> float:
    """Return the fraction of recordings whose true value is within the central interval of a level."""
    tail = (1 - level) / 2 * (DRAWS + 1)
    return float(np.mean((rank + 0.5 > tail) & (rank + 0.5 < DRAWS + 1 - tail)))


def report(console: Console, word: str, count: int) -> dict[str, float]:
    names, lines = read_all(word, count, console)
    ranks = np.array([line["ranks"] for line in lines])
    short = sum(line["ess"] < ESS or line["rhat"] > RHAT for line in lines)
    title = "elastic, believing that samples are independent" if word == "white" else word
    table = Table(
        "number", "p", *(f"in {100 * level:.0f} %" for level in LEVELS), f"ranks in {BINS} bins",
        title=f"{title}: {count} recordings",
    )  # fmt: skip
    tested = [k for k, name in enumerate(names) if not (word == "white" and name.endswith("_correlation"))]
    worst, at_90 = 1.0, []
    for k in tested:
        p = p_value(ranks[:, k])
        worst = min(worst, p)
        bars = np.histogram(ranks[:, k], BINS, (0, DRAWS + 1))[0]
        at_90.append(100 * covered(ranks[:, k], 0.9))
        shares = (f"{100 * covered(ranks[:, k], level):.0f} %" for level in LEVELS)
        table.add_row(names[k], f"{p:.2g}", *shares, " ".join(map(str, bars)))
    console.print(table)
    caught = worst < CAUGHT / len(tested)
    console.print(
        f"{short} chains fell short; ranks are {'NOT uniform' if caught else 'uniform'}: least p {worst:.2g}"
    )
    return {
        f"{word}, recordings": count,
        f"{word}, numbers tested": len(tested),
        f"{word}, chains that fell short": short,
        f"{word}, least p of uniform ranks": worst,
        f"{word}, least coverage of 90 % intervals [%]": min(at_90),
        f"{word}, largest coverage of 90 % intervals [%]": max(at_90),
    }


def main() -> None:
    words, file = arguments()
    count = int(words.pop(0)) if words and words[0].isdigit() else 300
    keep_compiled()
    console = Console(width=150)
    figures = {}
    for word in words or ["elastic", "toe", "white"]:
        figures |= report(console, word, count)
    keep(file, figures)


if __name__ == "__main__":
    main()

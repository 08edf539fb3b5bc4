"""Prove: conceal known physics, diagnose, open the envelope, score. Every rate comes with its interval."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

from pamjax.records.files import write_beside
from pamjax.study.conceal import conceal
from pamjax.study.diagnose import diagnose
from pamjax.study.diagnosis import Diagnosis

#: Kinds of envelopes: nothing in it, one effect, two, three, or one that is in no catalogue.
KINDS = {"nothing": 0, "single": 1, "pair": 2, "triple": 3, "outside": 1}

#: Probability from which a name counts.
NAMED = 0.5

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Trial:
    """One envelope and what was said of it.

    Attributes:
        kind: a key of `KINDS`.
        number: of the envelope; with the proof's seed it draws the same recording again.
        correlation: of neighbouring samples of noise.
        concealed, sizes: what was in it, and its effect in noise standard deviations.
        named: what was named, most probable first; ties: what else each could have been.
        probabilities: of the names.
        p_value: of the mismatch.
        unexplained: whether something was left.
        after: held-out rmse of force after naming, over its effective noise; NaN without held-out rows.
    """

    kind: str
    number: int
    correlation: float
    concealed: tuple[str, ...]
    sizes: tuple[float, ...]
    named: tuple[str, ...]
    ties: tuple[tuple[str, ...], ...]
    probabilities: tuple[float, ...]
    p_value: float
    unexplained: bool
    after: float

    @property
    def alarm(self) -> bool:
        """Whether anything was said to be wrong."""
        return self.p_value < 0.01 or bool(self.named) or self.unexplained

    @property
    def found(self) -> int:
        """How many of the concealed effects were named, alone or as one of a tie."""
        said = [{name, *ties} for name, ties in zip(self.named, self.ties, strict=True)]
        return sum(any(id in names for names in said) for id in self.concealed)

    @property
    def invented(self) -> int:
        """How many names stand for nothing that was concealed."""
        said = [{name, *ties} for name, ties in zip(self.named, self.ties, strict=True)]
        return sum(not names & set(self.concealed) for names in said)


def prove(
    counts: dict[str, int],
    file: Path,
    *,
    correlation: float = 0.0,
    seed: int = 0,
    progress: Progress = lambda doing, share: None,
) -> list[Trial]:
    """Diagnose so many envelopes of each kind; a run that was stopped goes on where it was.

    Args:
        counts: how many of each kind.
        file: JSON file that holds the trials; those of this seed and correlation are not repeated.
        correlation: of neighbouring samples of noise.
        seed: of everything that is drawn.
        progress: called with what is being done and the share done.
    """
    done = read_trials(file) if file.exists() else []
    have = {(t.kind, t.number, t.correlation) for t in done}
    wanted = [(kind, k) for kind, many in counts.items() for k in range(many)]
    wanted = [(kind, k) for kind, k in wanted if (kind, k, correlation) not in have]
    for i, (kind, number) in enumerate(wanted):
        progress(f"{kind} {number + 1}", i / len(wanted))
        done.append(_trial(kind, number, correlation, seed))
        with write_beside(file) as beside:
            beside.write_text(json.dumps([asdict(t) for t in done], indent=1) + "\n")
    return done


def read_trials(file: Path) -> list[Trial]:
    """Trials from their file."""
    return [
        Trial(**{k: _tuples(v) for k, v in one.items()})
        for one in json.loads(file.read_text(encoding="utf-8"))
    ]


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def _trial(kind: str, number: int, correlation: float, seed: int) -> Trial:
    rng = np.random.default_rng([seed, list(KINDS).index(kind), number, round(1e3 * correlation)])
    envelope = conceal(KINDS[kind], rng, outside=kind == "outside", correlation=correlation, number=number)
    found = diagnose(envelope.case, seed=number)
    names = [name for name in found.names if name.probability >= NAMED]
    return Trial(
        kind=kind,
        number=number,
        correlation=correlation,
        concealed=envelope.concealed,
        sizes=envelope.sizes,
        named=tuple(name.id for name in names),
        ties=tuple(name.ties for name in names),
        probabilities=tuple(name.probability for name in names),
        p_value=found.mismatch.p_value,
        unexplained=found.unexplained,
        after=_after(found),
    )


def _after(found: Diagnosis) -> float:
    colour, rows = found.model.white.colours[0], found.model.white.rows[0]
    if colour is None or "force" not in found.gain.rmse_after:
        return float("nan")
    return found.gain.rmse_after["force"] / float(np.sqrt(np.mean(colour.sd[rows] ** 2)))


def rate(hits: int, of: int) -> tuple[float, float, float]:
    """A rate with its exact 95 % interval (Clopper & Pearson)."""
    if of == 0:
        return float("nan"), 0.0, 1.0
    low = float(beta.ppf(0.025, hits, of - hits + 1)) if hits else 0.0
    high = float(beta.ppf(0.975, hits + 1, of - hits)) if hits < of else 1.0
    return hits / of, low, high


def table(trials: Sequence[Trial]) -> str:
    """What came out, kind by kind, as lines to print."""
    lines = [
        f"  {'concealed':<10}{'noise':>7}{'cases':>7}  alarm or recovery (95 % interval)   invented names"
    ]
    groups = dict.fromkeys((t.kind, t.correlation) for t in trials)
    for kind, correlation in groups:
        some = [t for t in trials if (t.kind, t.correlation) == (kind, correlation)]
        if kind in ("nothing", "outside"):
            hits, of = sum(t.alarm if kind == "nothing" else t.unexplained for t in some), len(some)
            word = "alarms" if kind == "nothing" else "unexplained"
        else:
            hits, of, word = sum(t.found for t in some), sum(len(t.concealed) for t in some), "named"
        share, low, high = rate(hits, of)
        invented = sum(t.invented for t in some)
        lines.append(
            f"  {kind:<10}{correlation:>7.2f}{len(some):>7}  {word} {hits} of {of}:"
            f" {share:.0%} ({low:.0%} to {high:.0%}){invented:>12}"
        )
    return "\n".join(lines)

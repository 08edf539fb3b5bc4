"""Is a number determined? In words, from its posterior and its profile likelihood.

| verdict                 | when                                                                            |
|-------------------------|---------------------------------------------------------------------------------|
| at a limit              | its draws pile up there: `AT_LIMIT` of them within `NEAR` of their sd            |
| determined              | its profile ends on both sides, and halves what was believed                     |
| one-sided               | its profile ends on one side only                                                |
| only in combination     | it would be determined if the others were known, and is not                      |
| not determined          | else                                                                             |

What was believed is what the posterior was drawn with, `--priors` among it. Not determined means that its
sd is more than `DETERMINED` of that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.infer.fitting.result import Fit
from pamjax.infer.posterior.profile import SURE, Problem, Profile, believing, profile
from pamjax.infer.problem.parameter_space import Space
from pamjax.infer.problem.priors import is_ruler
from pamjax.units import show

#: What a number is called that acts only together with others.
COMBINED = "only in combination"
#: Half a Gaussian that begins at a limit has 0.24 of its draws so near, an exponential 0.39, what may be
#: anywhere 0.14; and what spreads over its range by more than a share (0.29 if evenly) is nowhere.
AT_LIMIT, NEAR, SPREAD = 0.2, 0.5, 0.2
#: Determined means that the recording shrinks the sd to this share of what was believed.
DETERMINED = 0.5
#: Numbers that are correlated more than this may be known only together.
TOGETHER = 0.3
#: A combination is told as a product if no exponent is farther from one than this factor.
SIMPLE = 3.0


@dataclass(frozen=True, eq=False)
class Verdict:
    """What a recording says of one number.

    Attributes:
        kind: "at a limit", "determined", "one-sided", "only in combination" or "not determined".
        says: the rest of the sentence, or nothing.
        profile: its profile likelihood.
    """

    kind: str
    says: str
    profile: Profile

    def __str__(self) -> str:
        return f"{self.kind}: {self.says}" if self.says else self.kind


@dataclass(frozen=True, eq=False)
class Told:
    """One number as the posterior believed it.

    Attributes:
        low, high: limits, SI.
        log: whether it moves by its logarithm.
        unit: in which a person reads it.
        value: best fit, SI.
        believed: the prior's sd, SI; where any value is as likely, that of the whole range.
        alone: whether the recording would determine it if it knew all others.
    """

    low: float
    high: float
    log: bool
    unit: str
    value: float
    believed: float
    alone: bool

    def share(self, draws: np.ndarray) -> np.ndarray:
        """Where draws lie between the limits, on the number's own scale."""
        if self.log:
            return np.log(draws / self.low) / np.log(self.high / self.low)
        return (draws - self.low) / (self.high - self.low)


def _told(problem: Problem, name: str, unit: str) -> Told:
    at, k = problem.at, problem.at.names.index(name)
    low, high, sd, value = (float(a[k]) for a in (at.low, at.high, at.sd, problem.values))
    reach = value * math.log(high / low) if at.log[k] else high - low
    believed = sd if math.isfinite(sd) else reach / math.sqrt(12)
    known = max(float(problem.solution.information[k, k]), 1e-300)
    alone = abs(float(problem.solution.slope[k])) / math.sqrt(known) < DETERMINED * believed
    return Told(low, high, at.log[k], unit, value, believed, alone)


def verdicts(fit: Fit, at: Space, draws: np.ndarray) -> dict[str, Verdict]:
    """A verdict for each of the muscle's numbers.

    Args:
        fit: the fit from which the posterior began.
        at: the posterior's numbers; the fit's come first.
        draws: (n, p) values, SI.
    """
    problem = believing(fit, at)
    names = [n for n in fit.estimates if not is_ruler(n)]
    profiles = {n: profile(problem, n) for n in names}
    told = {n: _told(problem, n, fit.estimates[n].meaning.show) for n in names}
    kinds = {n: _kind(told[n], draws[:, at.names.index(n)], profiles[n]) for n in names}
    loose = [n for n in names if kinds[n][0] in ("not determined", "one-sided")]
    together = draws[:, [at.names.index(n) for n in loose]]
    said = {}
    for name, (kind, says) in kinds.items():
        if name in loose and told[name].alone and (partners := _partners(name, loose, together)):
            kind, says = COMBINED, combination(told, name, partners, loose, together)
        elif kind == "not determined":
            left = draws[:, at.names.index(name)].std() / told[name].believed
            says = f"{100 * min(left, 1.0):.0f} % of what was open stays open"
        said[name] = Verdict(kind, says, profiles[name])
    return said


def _kind(told: Told, draws: np.ndarray, along: Profile) -> tuple[str, str]:
    share = told.share(draws)
    near = NEAR * share.std()
    for end, there in ((told.low, share < near), (told.high, share > 1 - near)):
        if there.mean() > AT_LIMIT and share.std() < SPREAD:
            return "at a limit", show(end, told.unit)
    if along.low is not None and along.high is not None:
        if (along.high - along.low) / (2 * math.sqrt(SURE)) < DETERMINED * told.believed:
            return "determined", ""
    elif along.low is not None or along.high is not None:
        end = along.low if along.low is not None else along.high
        assert end is not None
        return "one-sided", f"{'above' if along.low is not None else 'below'} {show(end, told.unit, 3)}"
    return "not determined", ""


def _partners(name: str, loose: Sequence[str], draws: np.ndarray) -> list[int]:
    """Places among the loose numbers of those that move with this one, itself too; none if alone."""
    if len(loose) == 1:
        return []
    here = loose.index(name)
    related = np.abs(np.corrcoef(draws, rowvar=False)[here])
    found = [k for k in range(len(loose)) if related[k] > TOGETHER]
    return found if len(found) > 1 else []


def combination(
    told: Mapping[str, Told], name: str, partners: Sequence[int], loose: Sequence[str], draws: np.ndarray
) -> str:
    """Which combination with others the recording knows, or how they move unnoticed.

    Args:
        told: each number as it was believed.
        partners: places among `loose` of the numbers that combine.
        loose: names that are not determined by themselves, `name` among them.
        draws: (n, len(loose)) values, SI.
    """
    here = loose.index(name)
    chosen = [told[loose[k]] for k in partners]
    x = draws[:, partners]
    if (x > 0).all() and all(t.low > 0 for t in chosen):
        believed = np.array([t.believed / t.value for t in chosen])
        _, axes = np.linalg.eigh(np.cov(np.log(x) / believed, rowvar=False))
        power = axes[:, 0] / believed
        power = power / power[partners.index(here)]
        if np.all((np.abs(power) < SIMPLE) & (np.abs(power) > 1 / SIMPLE)):
            known = np.exp(np.log(x) @ power)
            share = f"{100 * known.std() / known.mean():.2g} %"
            return f"{_product([loose[k] for k in partners], power)}, known to {share}"
    believed = np.array([t.believed for t in chosen])
    _, axes = np.linalg.eigh(np.cov(x / believed, rowvar=False))
    moves = axes[:, -1] * np.sign(axes[partners.index(here), -1]) * believed
    words = [
        f"{loose[k]} {'+' if m > 0 else ''}{show(m, t.unit, 2)}"
        for k, m, t in zip(partners, moves, chosen, strict=True)
    ]
    return ", ".join(words[:-1]) + " and " + words[-1] + " go unnoticed together"


def _product(names: Sequence[str], power: np.ndarray) -> str:
    """As "a × b" or "a / b^0.7"."""
    text = ""
    for name, p in zip(names, power, strict=True):
        size = "" if abs(abs(p) - 1) < 0.1 else f"^{abs(p):.2g}"
        text += f"{(' × ' if p > 0 else ' / ') if text else ('' if p > 0 else '1 / ')}{name}{size}"
    return text

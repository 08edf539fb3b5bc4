"""Is a number determined? In words, from its posterior and its profile likelihood.

| verdict                 | when                                                                            |
|-------------------------|---------------------------------------------------------------------------------|
| at a limit              | `AT_LIMIT` of the draws lie in the outermost `OUTER` of its range                |
| determined              | its profile ends on both sides, and halves what was believed                     |
| one-sided               | its profile ends on one side only                                                |
| only in combination     | it would be determined if the others were known, and is not                      |
| not determined          | else                                                                             |

Without a profile (a muscle with mechanisms takes too long) the posterior's sd stands for it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.infer.believed import is_ruler
from pamjax.infer.profile import SURE, Profile, profile
from pamjax.infer.result import Estimate, Fit
from pamjax.infer.space import Space
from pamjax.units import show

AT_LIMIT, OUTER = 0.3, 0.05
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
        profile: its profile likelihood, or None where that would take too long.
    """

    kind: str
    says: str
    profile: Profile | None

    def __str__(self) -> str:
        return f"{self.kind}: {self.says}" if self.says else self.kind


def verdicts(fit: Fit, at: Space, draws: np.ndarray) -> dict[str, Verdict]:
    """A verdict for each of the muscle's numbers.

    Args:
        fit: the fit, of which the profiles are taken.
        at: the posterior's numbers; the fit's come first.
        draws: (n, p) values, SI.
    """
    names = [n for n in fit.estimates if not is_ruler(n)]
    profiles = {n: None if fit.mechanisms else profile(fit, n) for n in names}
    kinds = {n: _kind(fit, at, n, draws[:, at.names.index(n)], profiles[n]) for n in names}
    loose = [n for n in names if kinds[n][0] in ("not determined", "one-sided")]
    together = draws[:, [at.names.index(n) for n in loose]]
    said = {}
    for name, (kind, says) in kinds.items():
        if name in loose and _alone(fit, name) and (partners := _partners(name, loose, together)):
            kind, says = "only in combination", combination(fit, name, partners, loose, together)
        elif kind == "not determined":
            left = draws[:, at.names.index(name)].std() / _believed(fit.estimates[name])
            says = f"{100 * min(left, 1.0):.0f} % of what was open stays open"
        said[name] = Verdict(kind, says, profiles[name])
    return said


def _kind(fit: Fit, at: Space, name: str, draws: np.ndarray, along: Profile | None) -> tuple[str, str]:
    e = fit.estimates[name]
    low, high = (float(a[at.names.index(name)]) for a in (at.low, at.high))
    for end, near in (
        (low, _share(draws, low, high, e) < OUTER),
        (high, _share(draws, low, high, e) > 1 - OUTER),
    ):
        if near.mean() > AT_LIMIT:
            return "at a limit", show(end, e.meaning.show)
    before = _believed(e)
    if along is None:
        if draws.std() < DETERMINED * before:
            return "determined", ""
    elif along.low is not None and along.high is not None:
        if (along.high - along.low) / (2 * math.sqrt(SURE)) < DETERMINED * before:
            return "determined", ""
    elif along.low is not None or along.high is not None:
        end = along.low if along.low is not None else along.high
        assert end is not None
        return "one-sided", f"{'above' if along.low is not None else 'below'} {show(end, e.meaning.show, 3)}"
    return "not determined", ""


def _alone(fit: Fit, name: str) -> bool:
    """Whether the recording would determine a number if it knew all others."""
    k = fit.space.names.index(name)
    sd = abs(float(fit.solution.slope[k])) / math.sqrt(max(float(fit.solution.information[k, k]), 1e-300))
    return sd < DETERMINED * _believed(fit.estimates[name])


def _partners(name: str, loose: Sequence[str], draws: np.ndarray) -> list[int]:
    """Places among the loose numbers of those that move with this one, itself too; none if alone."""
    if len(loose) == 1:
        return []
    here = loose.index(name)
    related = np.abs(np.corrcoef(draws, rowvar=False)[here])
    found = [k for k in range(len(loose)) if related[k] > TOGETHER]
    return found if len(found) > 1 else []


def _share(draws: np.ndarray, low: float, high: float, e: Estimate) -> np.ndarray:
    """Where draws lie between the limits, on the number's own scale."""
    if e.meaning.scale == "log":
        return np.log(draws / low) / np.log(high / low)
    return (draws - low) / (high - low)


def _believed(e: Estimate) -> float:
    """The prior's sd, SI; where any value is as likely, that of the whole range."""
    if math.isfinite(e.prior_sd):
        return e.prior_sd
    about = e.meaning
    reach = e.value * math.log(about.high / about.low) if about.scale == "log" else about.high - about.low
    return reach / math.sqrt(12)


def combination(fit: Fit, name: str, partners: Sequence[int], loose: Sequence[str], draws: np.ndarray) -> str:
    """Which combination with others the recording knows, or how they move unnoticed.

    Args:
        partners: places among `loose` of the numbers that combine.
        loose: names that are not determined by themselves, `name` among them.
        draws: (n, len(loose)) values, SI.
    """
    here = loose.index(name)
    chosen = [fit.estimates[loose[k]] for k in partners]
    x = draws[:, partners]
    if (x > 0).all() and all(e.meaning.low > 0 for e in chosen):
        believed = np.array([_believed(e) / e.value for e in chosen])
        _, axes = np.linalg.eigh(np.cov(np.log(x) / believed, rowvar=False))
        power = axes[:, 0] / believed
        power = power / power[partners.index(here)]
        if np.all((np.abs(power) < SIMPLE) & (np.abs(power) > 1 / SIMPLE)):
            known = np.exp(np.log(x) @ power)
            share = f"{100 * known.std() / known.mean():.2g} %"
            return f"{_product([loose[k] for k in partners], power)}, known to {share}"
    believed = np.array([_believed(e) for e in chosen])
    _, axes = np.linalg.eigh(np.cov(x / believed, rowvar=False))
    moves = axes[:, -1] * np.sign(axes[partners.index(here), -1]) * believed
    words = [
        f"{loose[k]} {'+' if m > 0 else ''}{show(m, e.meaning.show, 2)}"
        for k, m, e in zip(partners, moves, chosen, strict=True)
    ]
    return ", ".join(words[:-1]) + " and " + words[-1] + " go unnoticed together"


def _product(names: Sequence[str], power: np.ndarray) -> str:
    """As "a × b" or "a / b^0.7"."""
    text = ""
    for name, p in zip(names, power, strict=True):
        size = "" if abs(abs(p) - 1) < 0.1 else f"^{abs(p):.2g}"
        text += f"{(' × ' if p > 0 else ' / ') if text else ('' if p > 0 else '1 / ')}{name}{size}"
    return text

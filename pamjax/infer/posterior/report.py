"""The lab note of a posterior."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from pamjax.infer.fitting.report import STRONG, quantity
from pamjax.infer.problem.priors import is_ruler
from pamjax.units import in_unit, show

if TYPE_CHECKING:
    from pamjax.infer.posterior.result import Posterior


def posterior_note(post: Posterior) -> str:
    """The whole note, plain text."""
    lines = [_title(post), "", *_numbers(post), "", *priors(post), "", *ridges(post), *repeats(post), ""]
    return "\n".join([*lines, *trust(post)])


def _title(post: Posterior) -> str:
    fit = post.fit
    cases = ", ".join(one.case.name for one in fit.cases)
    return (
        f"{cases}: {', '.join((f'{fit.law} threads', *fit.mechanisms))}; mean ± sd, and 90 % of the posterior"
    )


def _shown(post: Posterior) -> list[str]:
    return [name for name in post.names if not is_ruler(name)]


def _numbers(post: Posterior) -> Iterator[str]:
    width = max(map(len, _shown(post)))
    for name in _shown(post):
        m, (_, unit) = post.marginals[name], post.units(name)
        verdict = str(post.verdicts[name]) if name in post.verdicts else "noise"
        yield f"  {name:<{width}}  {quantity(m.mean, m.sd, unit):<24} {interval(post, name):<22} {verdict}"


def interval(post: Posterior, name: str) -> str:
    """The middle 90 % of a number, to as many digits as its sd asks for, in the unit of its value."""
    m, (_, unit) = post.marginals[name], post.units(name)
    scale, digits = in_unit(unit), _digits(m.sd / in_unit(unit))
    return f"{m.low / scale:.{digits}f} to {m.high / scale:.{digits}f}"


def _digits(sd: float) -> int:
    return max(0, 1 - math.floor(math.log10(sd))) if sd > 0 else 3


def priors(post: Posterior) -> Iterator[str]:
    """What was believed before."""
    at = post.density.at
    yield "  believed before:"
    for k, name in enumerate(at.names):
        if is_ruler(name):
            continue
        _, unit = post.units(name)
        low, high = show(float(at.low[k]), unit, 3), show(float(at.high[k]), unit, 3)
        if np.isfinite(at.sd[k]):
            belief = quantity(float(at.mean[k]), float(at.sd[k]), unit)
        else:
            belief = f"anywhere from {low} to {high}{' by its logarithm' if at.log[k] else ''}"
        told = " (as told)" if name in post.beliefs else ""
        yield f"    {name}: {belief}{told}"


def ridges(post: Posterior) -> Iterator[str]:
    """Which numbers move together."""
    names = post.names
    pairs = [
        (abs(post.correlation[i, j]), names[j], names[i], post.correlation[i, j])
        for i in range(len(names))
        for j in range(i)
        if abs(post.correlation[i, j]) > STRONG
    ]
    for _, first, second, value in sorted(pairs, reverse=True)[:5]:
        yield f"  {first} and {second} move together (correlation {value:+.2f})"


def repeats(post: Posterior) -> Iterator[str]:
    """Where noise has more than one memory."""
    for one, streams, powers in zip(post.fit.cases, post.density.streams, post.density.powers, strict=True):
        for stream, power in zip(streams, powers, strict=True):
            if power < 1:
                channel = ("force", "diameter")[stream.channel]
                yield (
                    f"  {one.case.name}: what is left of {channel} repeats itself over more than one memory; "
                    f"{1 / float(power):.1f} samples count as one"
                )


def trust(post: Posterior) -> Iterator[str]:
    """Are the draws good enough, and were there accidents?"""
    health = post.health
    n, chains, _ = post.draws.shape
    ess, rhat = post.wanted
    state = "good enough" if post.reached else "DID NOT GET THERE: what follows is what there is"
    yield (
        f"  {post.sampler}, {chains} {'walkers' if post.sampler == 'emcee' else 'chains'} × {n} draws, seed "
        f"{post.seed}: {state}"
    )
    yield (
        f"  effective samples {health.ess.min():.0f} (wanted {ess:.0f}), split-R̂ {health.rhat.max():.3f} "
        f"(wanted {rhat:g}), autocorrelation time {health.time.max():.1f} draws"
    )
    if (diverging := int(np.sum(post.stats.get("diverging", 0)))) > 0:
        yield f"  {diverging} draws diverged: the posterior has a corner that the sampler may have missed"

"""The report of a fit: does the muscle meet its recording, and what are its numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from pamjax.infer.fitting.report import correlations, origin, quantity, remarks, told, trust
from pamjax.infer.fitting.result import CaseFit, Estimate, Fit
from pamjax.infer.problem.priors import is_ruler
from pamjax.units import show
from pamjax.view.figures import fit as figures
from pamjax.view.figures.layout import layout
from pamjax.view.reports.page import Picture, picture, write_page
from pamjax.view.wording import noise_says, same_noise, upper

#: How many numbers the first screen names.
NAMED = 3
#: Isobars or lengths, at most, that the page offers to show alone.
CHOICES = 12


def save_report(fit: Fit, path: str | Path, command: str = "pamjax fit") -> Path:
    """Write the report of a fit.

    Args:
        fit: the fit.
        path: the HTML file; its folder must exist.
        command: what repeats it, in a shell.
    """
    shown = {name: e for name, e in fit.estimates.items() if not is_ruler(name)}
    return write_page(
        path,
        "fit.html.jinja",
        title=headline(fit),
        kicker=f"Fit of {words([one.case.name for one in fit.cases])} · {model_of(fit)}",
        answer=(met(fit), numbers_say(shown)),
        cases=[_case(fit, one, k) for k, one in enumerate(fit.cases)],
        groups=_groups(fit),
        rows=[
            [n, quantity(e.value, e.sd, e.meaning.show), origin(e), e.meaning.about] for n, e in shown.items()
        ],
        together=[upper(line.strip()) for line in correlations(fit)],
        prior=drawn(partial(figures.prior_figure, fit), "prior"),
        prior_caption=_prior_caption(fit, shown),
        misses=_misses(fit),
        unlearned=[name for name, e in shown.items() if e.learned < 0.5],
        assumed=list(_assumed(fit)),
        command=command,
    )


def model_of(fit: Fit) -> str:
    """The model in words."""
    return f"{fit.law} threads" + (f" with {words(list(fit.mechanisms))}" if fit.mechanisms else "")


def words(parts: list[str]) -> str:
    """One, two and three.

    >>> words(["force", "diameter", "time"])
    'force, diameter and time'
    """
    return parts[0] if len(parts) == 1 else ", ".join(parts[:-1]) + " and " + parts[-1] if parts else ""


def drawn(draw: Any, name: str) -> Picture | None:
    """A figure for a page, wide and narrow."""
    return picture(lambda narrow: draw(narrow=narrow), name)


def _groups(fit: Fit) -> list[str]:
    """Isobars or lengths that a reader can choose among; none where that would not help."""
    names = list(layout(fit.cases[0].case).names)
    return names if len(fit.cases) == 1 and 1 < len(names) <= CHOICES else []


def _worst(fit: Fit) -> tuple[CaseFit, str]:
    """The channel whose misfit is the largest multiple of its noise."""
    pairs = [(one, channel) for one in fit.cases for channel in one.rmse]
    return max(pairs, key=lambda pair: pair[0].noise[pair[1]].excess if pair[0].noise[pair[1]].given else 0.0)


def _misses(fit: Fit) -> bool:
    """Whether a channel is off by more than its sensor explains."""
    one, channel = _worst(fit)
    return one.noise[channel].given and one.noise[channel].excess > figures.MISS


def headline(fit: Fit) -> str:
    """The answer in a line."""
    one, channel = _worst(fit)
    noise = one.noise[channel]
    if not fit.converged:
        return "The fit did not converge"
    if _misses(fit):
        return f"The model misses {channel} by {noise.excess:.2g} times its noise"
    if noise.given:
        return "The calibrated muscle meets its recording to the noise"
    return f"Calibrated: {channel} is met to {told(one.rmse[channel], channel)}"


def met(fit: Fit) -> str:
    """How well every channel is met, where seen and where not, in one sentence."""
    one, _ = _worst(fit)
    first, *rest = one.rmse
    parts = [f"{first} is met to {_beside_noise(one, first)}"]
    text = words([*parts, *(f"{channel} to {_beside_noise(one, channel)}" for channel in rest)])
    if len(fit.cases) > 1:
        text = f"In {one.case.name}, the worst of {len(fit.cases)}, {text}"
    if one.held_out is None or not one.held_out.rmse:
        return f"{upper(text)}; nothing could be held out."
    unseen = words([told(rmse, channel) for channel, rmse in one.held_out.rmse.items()])
    return f"{upper(text)}; {one.held_out.kind} that the fit never saw are missed by {unseen}."


def _beside_noise(one: CaseFit, channel: str) -> str:
    """A channel's misfit and what its noise is."""
    kind = "noise" if one.noise[channel].given else "the residual's own noise"
    return f"{told(one.rmse[channel], channel)} ({kind} {told(one.noise[channel].sd, channel)})"


def numbers_say(shown: dict[str, Estimate]) -> str:
    """What the recording taught, in one sentence."""
    limits = [name for name, e in shown.items() if e.at_limit]
    found = [
        f"{n} {quantity(e.value, e.sd, e.meaning.show)}"
        for n, e in shown.items()
        if e.learned >= 0.5 and n not in limits
    ]
    rest = [n for n, e in shown.items() if e.learned < 0.5 and n not in limits]
    parts = [f"It determines {words(_some(found))}"] if found else ["It determines no number by itself"]
    if limits:
        parts.append(f"{words(_some(limits))} {'sits' if len(limits) == 1 else 'sit'} at a limit")
    if rest:
        parts.append(
            f"{words(_some(rest))} {'is' if len(rest) == 1 else 'are'} mostly what was believed before"
        )
    return "; ".join(parts) + "."


def _some(names: list[str]) -> list[str]:
    return names if len(names) <= NAMED else [*names[:NAMED], f"{len(names) - NAMED} more"]


def _case(fit: Fit, one: CaseFit, k: int) -> dict[str, Any]:
    several = len(fit.cases) > 1
    return {
        "name": one.case.name,
        "heading": f"{one.case.name}: {one.case.entry.name}" if several else "Where it misses",
        "prediction": drawn(partial(figures.prediction_figure, one), f"prediction-{k}"),
        "residual": drawn(partial(figures.residual_figure, one), f"residual-{k}"),
        "held_out": drawn(partial(figures.held_out_figure, one), f"held-out-{k}") if one.held_out else None,
        "scores": [_score(one, channel) for channel in one.rmse],
        "range": ", ".join(
            f"{name} {show(low, unit)} to {show(high, unit)}"
            for (name, (low, high)), unit in zip(one.calibrated.items(), ("kPa", "mm"), strict=True)
        ),
        "checksum": one.case.checksum,
    }


def _prior_caption(fit: Fit, shown: dict[str, Estimate]) -> str:
    """What the figure of the priors shows, and of what it shows nothing."""
    without = [name for name in shown if name not in figures.with_prior(fit)]
    text = "Each number on the scale of what was believed before."
    return f"{text} Nothing was believed of {words(without)} but limits." if without else text


def _sentence(line: str, of: str = "") -> str:
    """A line of the note as a sentence, with the case that it is of."""
    line = line.strip().rstrip(".")
    return f"{of}: {line}." if of else f"{upper(line)}."


def _score(one: CaseFit, channel: str) -> list[str]:
    noise = one.noise[channel]
    unseen = one.held_out.rmse.get(channel, math.nan) if one.held_out else math.nan
    return [
        channel,
        told(one.rmse[channel], channel),
        told(unseen, channel) if math.isfinite(unseen) else "–",
        f"{told(noise.sd, channel)}, {_whence(one, channel)}",
        f"{noise.samples} ({noise.samples / noise.inflation:.0f})",
    ]


def _whence(one: CaseFit, channel: str) -> str:
    """Where a channel's noise comes from; what pressure and length add is not in what the lab states."""
    stated = getattr(one.case.entry.sensors, channel)
    if not one.noise[channel].given or stated is None:
        return "stated" if one.noise[channel].given else "estimated"
    return "stated" if same_noise(one.noise[channel].sd, stated) else f"its sensor's {told(stated, channel)}"


def _assumed(fit: Fit) -> Iterator[str]:
    yield f"The model is a braid of {model_of(fit)}; the others of the library are left out."
    yield from map(_sentence, trust(fit))
    for one in fit.cases:
        name = one.case.name if len(fit.cases) > 1 else ""
        begun = "was at rest" if one.case.before == "relaxed" else "had been through the same recording once"
        if fit.mechanisms:
            gaps = "goes on" if one.case.gaps == "carry" else "begins anew"
            yield _sentence(f"before its first sample the muscle {begun}; memory {gaps} at a jump", name)
        yield from (_sentence(line, name) for line in remarks(one))
        stated = [channel for channel in one.rmse if one.noise[channel].given]
        yield from (_sentence(noise_says(one.case, c, one.noise[c].sd), name) for c in stated)
    yield (
        "Standard deviations widen with the misfit and with its correlation; a wrong model can still be"
        " surely wrong."
    )

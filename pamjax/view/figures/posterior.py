"""Figures of a posterior.

| figure             | question                                                                  |
|--------------------|---------------------------------------------------------------------------|
| `corner_figure`    | how sure are the numbers, and which move together?                        |
| `ridge_figure`     | which numbers are known only together?                                    |
| `belief_figure`    | what did the recording teach beyond what was believed?                    |
| `profile_figure`   | how badly would the recording fit if a number were another?               |
| `trace_figure`     | did the chains forget where they began?                                   |
| `band_figure`      | does what was measured lie where the posterior expects it?                |
"""

from __future__ import annotations

import math
import textwrap
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pamjax.channels import DISPLAY_UNIT
from pamjax.infer.fitting.result import CaseFit
from pamjax.infer.posterior.identifiability_report import COMBINED
from pamjax.infer.posterior.predictive import predictions, prior_draws, with_noise
from pamjax.infer.posterior.profile import SURE
from pamjax.infer.posterior.result import Posterior
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.infer.problem.priors import is_ruler
from pamjax.units import in_unit
from pamjax.view.figures.fit import panels_of
from pamjax.view.figures.layout import key, layout, lines, mark, thin
from pamjax.view.theme import DOUBLE, OKABE_ITO, QUIET, SINGLE, figure, save_png, theme

BLUE, RED = OKABE_ITO["blue"], OKABE_ITO["vermilion"]
#: A corner plot of more numbers than this is a wall: the noise's numbers go first.
PANELS = 9
#: Numbers in the corner plot of a phone: those that move together most.
NARROW_PANELS = 4
#: Draws shown as points or traced; walkers traced.
POINTS, WALKERS = 2000, 8
#: Draws behind a predictive band.
BAND = 100


def _shown(post: Posterior) -> list[int]:
    """Places of the numbers that a figure shows: the muscle's, and the noise's where there is room."""
    own = [k for k, name in enumerate(post.names) if not is_ruler(name)]
    muscle = [k for k in own if post.names[k] in post.fit.estimates]
    return own if len(own) <= PANELS else muscle[:PANELS]


def _label(post: Posterior, k: int) -> str:
    _, unit = post.units(post.names[k])
    head, _, tail = post.names[k].rpartition(".")
    return f"{head}.\n{tail}" + ("" if unit == "1" else f" [{unit}]")


def _in_unit(post: Posterior, values: np.ndarray, k: int) -> np.ndarray:
    return values[..., k] / in_unit(post.units(post.names[k])[1])


def _closest(post: Posterior, chosen: list[int]) -> list[int]:
    """The few of some numbers that move together most, in their order."""
    size = np.abs(post.correlation[np.ix_(chosen, chosen)])
    np.fill_diagonal(size, 0)
    most = np.argsort(-size.max(axis=1), kind="stable")[:NARROW_PANELS]
    return [chosen[k] for k in sorted(most)]


def corner_figure(post: Posterior, narrow: bool = False) -> Figure:
    """Every number's histogram, and every pair's cloud with its 39 and 86 % contours.

    On a phone those few numbers that move together most.
    """
    every, draws = _shown(post), post.draw(POINTS)
    chosen = _closest(post, every) if narrow else every
    count = len(chosen)
    with theme():
        size = SINGLE if narrow else max(1.1 * count + 1, 4.5)
        made = figure(size, size)
        grid = made.subplots(count, count, squeeze=False, sharex="col")
        for row, i in enumerate(chosen):
            for column, j in enumerate(chosen):
                panel = grid[row][column]
                if column > row:
                    panel.set_axis_off()
                    continue
                if row == column:
                    panel.hist(_in_unit(post, post.flat, i), 40, color=BLUE, alpha=0.7, gid="marginal")
                    panel.set_yticks([])
                    low, high = np.quantile(_in_unit(post, post.flat, i), (0.001, 0.999))
                    panel.set_xlim(low, high)
                else:
                    x, y = _in_unit(post, draws, j), _in_unit(post, draws, i)
                    panel.plot(x, y, ".", ms=1, alpha=0.25, color=BLUE, rasterized=True, gid="draws")
                    _ellipses(panel, x, y)
                    panel.set_ylim(*np.quantile(_in_unit(post, post.flat, i), (0.001, 0.999)))
                if column == 0 and row:
                    panel.set_ylabel(_label(post, i), fontsize=6)
                elif column:
                    panel.set_yticklabels([])
                if row == count - 1:
                    panel.set_xlabel(_label(post, j), fontsize=6)
                panel.tick_params(labelsize=5)
                panel.locator_params(nbins=3)
        says = _together(post, chosen)
        if len(chosen) < len(every):
            says += f"; {len(chosen)} of {len(every)} numbers"
        says = textwrap.fill(says, 46) if narrow else says
        made.suptitle(says, x=0.01, ha="left", fontsize=8 if narrow else None)
    return made


def _ellipses(panel: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Where a Gaussian of the same covariance holds 39 and 86 % of the draws: one and two sd."""
    root = np.linalg.cholesky(np.cov(x, y) + 1e-30 * np.eye(2))
    circle = np.linspace(0, 2 * np.pi, 60)
    for sd in (1, 2):
        ring = sd * root @ np.stack([np.cos(circle), np.sin(circle)])
        panel.plot(x.mean() + ring[0], y.mean() + ring[1], color="black", lw=0.6, gid="ellipse")


def _together(post: Posterior, chosen: list[int]) -> str:
    """The finding: which two of the numbers move together most."""
    size = np.abs(post.correlation[np.ix_(chosen, chosen)])
    np.fill_diagonal(size, 0)
    if len(chosen) < 2:
        return f"What the recording says of {post.names[chosen[0]]}"
    i, j = np.unravel_index(int(size.argmax()), size.shape)
    a, b = chosen[min(i, j)], chosen[max(i, j)]
    value = f"{post.correlation[a, b]:+.2f}".replace("-", "−")
    return f"{post.names[a]} and {post.names[b]} move together most (correlation {value})"


def ridges(post: Posterior) -> list[tuple[int, int]]:
    """Places of the pairs of numbers that are known only together, each with its closest partner."""
    size, kinds = np.abs(post.correlation), {post.names.index(n): v.kind for n, v in post.verdicts.items()}
    loose = [k for k, kind in kinds.items() if kind != "determined"]
    closest = {
        k: max((j for j in loose if j != k), key=lambda j, k=k: size[k, j])
        for k in loose
        if kinds[k] == COMBINED
    }
    return sorted({(min(pair), max(pair)) for pair in closest.items()})


def ridge_figure(post: Posterior, narrow: bool = False) -> Figure:
    """What was believed of two numbers, and the ridge that the recording leaves of it, a panel a pair."""
    pairs, before, after = ridges(post), prior_draws(post.density, POINTS, post.seed), post.draw(POINTS)
    columns = 1 if narrow else min(2, len(pairs))
    rows = math.ceil(len(pairs) / columns)
    with theme():
        made = figure(SINGLE if columns == 1 else DOUBLE, 0.7 + 2.4 * rows)
        panels = made.subplots(rows, columns, squeeze=False).ravel()
        for panel, (i, j) in zip(panels, pairs, strict=False):
            for draws, colour, name in ((before, QUIET, "prior"), (after, BLUE, "posterior")):
                x, y = _in_unit(post, draws, i), _in_unit(post, draws, j)
                panel.plot(x, y, ".", ms=1.5, alpha=0.5, color=colour, rasterized=True, gid=name)
                if name == "prior":
                    panel.set(xlim=np.quantile(x, (0.01, 0.99)), ylim=np.quantile(y, (0.01, 0.99)))
            panel.set_xlabel(_label(post, i).replace("\n", ""))
            panel.set_ylabel(_label(post, j).replace("\n", ""))
        for panel in panels[len(pairs) :]:
            panel.set_axis_off()
        i, j = pairs[0]
        finding = f"{post.names[i]} and {post.names[j]}\nare known only together"
        made.suptitle(finding, x=0.01, ha="left")
        marks = [mark("believed before", marker="o", ms=3), mark("after", marker="o", ms=3, color=BLUE)]
        made.legend(handles=marks, loc="outside lower center", ncols=2)
    return made


def belief_figure(post: Posterior, narrow: bool = False) -> Figure:
    """Prior against posterior, a panel a number."""
    chosen = _shown(post)
    before = prior_draws(post.density, 4000, post.seed)
    columns = min(1 if narrow else 3, len(chosen))
    with theme():
        rows = math.ceil(len(chosen) / columns)
        made = figure(SINGLE if narrow else DOUBLE, 0.8 + (1.2 if narrow else 1.5) * rows)
        panels = made.subplots(rows, columns, squeeze=False).ravel()
        for panel, k in zip(panels, chosen, strict=False):
            _beside(
                panel, _in_unit(post, before, k), _in_unit(post, post.flat, k), bool(post.density.at.log[k])
            )
            panel.set_xlabel(_label(post, k).replace("\n", ""), fontsize=7)
        for panel in panels[len(chosen) :]:
            panel.set_axis_off()
        settled = sum(v.kind == "determined" for v in post.verdicts.values())
        made.suptitle(
            f"The recording determines {settled} of {len(post.verdicts)} numbers", x=0.01, ha="left"
        )
        marks = [mark("believed before", marker="s", alpha=0.5), mark("after", marker="s", color=BLUE)]
        made.legend(handles=marks, loc="outside lower center", ncols=2)
    return made


def _beside(panel: Axes, before: np.ndarray, after: np.ndarray, log: bool) -> None:
    low, high = np.quantile(np.concatenate([before, after]), (0.002, 0.998))
    low, high = min(low, after.min()), max(high, after.max())
    wide = log and low > 0 and high > 30 * low
    edges = np.geomspace(low, high, 80) if wide else np.linspace(low, high, 80)
    for draws, colour, name in ((before, QUIET, "prior"), (after, BLUE, "posterior")):
        counts, _ = np.histogram(draws, edges)
        # Both as high as their peaks: a narrow posterior would flatten its prior.
        panel.stairs(counts / counts.max(), edges, fill=True, alpha=0.5, color=colour, gid=name)
    panel.set_yticks([])
    if wide:
        panel.set_xscale("log")


def profile_figure(post: Posterior, narrow: bool = False) -> Figure:
    """χ² above its least along every number, the others following."""
    found = post.verdicts
    columns = min(2 if narrow else 3, len(found))
    with theme():
        rows = math.ceil(len(found) / columns)
        made = figure(SINGLE if narrow else DOUBLE, 0.8 + 1.6 * rows)
        panels = made.subplots(rows, columns, squeeze=False, sharey=True).ravel()
        for panel, (name, verdict) in zip(panels, found.items(), strict=False):
            along = verdict.profile
            k = post.names.index(name)
            scale = in_unit(post.units(name)[1])
            panel.plot(along.values / scale, along.rise, "o-", color=BLUE, ms=3, gid="profile")
            panel.axhline(SURE, color=QUIET, ls="--", lw=0.8, gid="sure")
            label = _label(post, k)
            panel.set_xlabel(label if narrow else label.replace("\n", ""), fontsize=7)
            panel.set_title(verdict.kind, fontsize=7)
            panel.set_ylim(0, 10)
        for panel in panels[len(found) :]:
            panel.set_axis_off()
        panels[0].set_ylabel("χ² above its least")
        made.legend(handles=[mark("95 % interval", ls="--")], loc="outside lower center")
    return made


def trace_figure(post: Posterior, narrow: bool = False) -> Figure:
    """Some chains of every number against the draw's number; on a phone each is named above its panel."""
    chosen = _shown(post)
    n, chains, _ = post.draws.shape
    every = max(1, n // 500)
    with theme():
        made = figure(SINGLE if narrow else DOUBLE, 0.6 + (1.0 if narrow else 0.75) * len(chosen))
        panels = made.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
        for panel, k in zip(panels, chosen, strict=True):
            for chain in range(min(chains, WALKERS)):
                trace = _in_unit(post, post.draws[::every, chain], k)
                panel.plot(np.arange(n)[::every], trace, lw=0.5, alpha=0.7, gid="trace")
            text = f"R-hat {post.health.rhat[k]:.3f}, ESS {post.health.ess[k]:.0f}"
            label = _label(post, k)
            if narrow:
                name = label.replace("\n", "")
                panel.set_title(f"{name}: {text}", fontsize=6.5)
            else:
                panel.text(1.01, 0.5, text, transform=panel.transAxes, fontsize=6, va="center")
                panel.set_ylabel(label, fontsize=5.5)
            panel.tick_params(labelsize=6)
        panels[-1].set_xlabel("draw, after the first fifth")
        state = "The chains agree" if post.reached else "The chains are NOT yet good enough"
        found = (
            f"at least {post.health.ess.min():.0f} effective samples, R-hat ≤ {post.health.rhat.max():.3f}"
        )
        says = f"{state}: {found}"
        made.suptitle(textwrap.fill(says, 46) if narrow else says, x=0.01, ha="left")
    return made


def band_figure(post: Posterior, k: int = 0, narrow: bool = False) -> Figure:
    """Measured points on the bands in which 90 % of new samples are expected, a panel a channel."""
    one = post.fit.cases[k]
    form, values = layout(one.case), post.draw(BAND)
    smooth = predictions(post.density, values, k)
    with theme():
        streams = post.density.streams[k]
        made, panels = panels_of(len(streams), narrow)
        for panel, stream in zip(panels, streams, strict=True):
            channel = CHANNELS[stream.channel]
            rows = with_noise(one, stream, smooth[channel], values, post.seed) / in_unit(
                DISPLAY_UNIT[channel]
            )
            _band(panel, one, form, channel, rows)
            panel.set(xlabel=form.xlabel, ylabel=f"{channel} [{DISPLAY_UNIT[channel]}]")
        key(
            made,
            panels,
            form,
            mark("measured", marker="o", ms=3),
            mark("90 % expected", marker="s", alpha=0.3),
        )
    return made


def _band(panel: Axes, one: CaseFit, form, channel: str, rows: np.ndarray) -> None:
    measured = getattr(one.case.recording, channel) / in_unit(DISPLAY_UNIT[channel])
    there = np.isfinite(measured) & np.all(np.isfinite(rows), axis=0)
    low, high = np.full(there.size, np.nan), np.full(there.size, np.nan)
    low[there], high[there] = np.quantile(rows[:, there], (0.05, 0.95), axis=0)
    kept = thin(np.where(form.group >= 0, form.x, np.nan), np.where(there, measured, np.nan))
    for group, colour in enumerate(form.colours):
        at = kept[form.group[kept] == group]
        panel.plot(form.x[at], measured[at], "o", color=colour, ms=2.3, mew=0, alpha=0.7, gid="measured")
        for at in lines(one.case, form, group, there):
            order = at[np.argsort(form.x[at], kind="stable")]
            if form.connected and len(order) > 1:
                panel.fill_between(
                    form.x[order], low[order], high[order], color=colour, alpha=0.25, lw=0, gid="band"
                )
            else:
                panel.vlines(
                    form.x[order], low[order], high[order], color=colour, alpha=0.5, lw=3, gid="band"
                )
    inside = (measured >= low) & (measured <= high)
    share = 100 * inside[there].mean()
    panel.set_title(f"{channel.capitalize()}: {share:.0f} % of samples\nin the band that is to hold 90 %")


def save_posterior_figures(post: Posterior, folder: Path) -> list[Path]:
    """Draw every figure; each as PNG.

    Returns:
        the files.
    """
    made = {"corner": corner_figure, "belief": belief_figure, "trace": trace_figure}
    if post.verdicts:
        made["profile"] = profile_figure
    if ridges(post):
        made["ridge"] = ridge_figure
    for name in {"profile", "ridge"} - set(made):
        # One that an earlier posterior left in this folder speaks of that one.
        (folder / f"{name}.png").unlink(missing_ok=True)
    written = [save_png(draw(post), folder / name) for name, draw in made.items()]
    for k, one in enumerate(post.fit.cases):
        head = "" if len(post.fit.cases) == 1 else f"{one.case.name}-"
        written.append(save_png(band_figure(post, k), folder / f"{head}band"))
    return written

"""The report of a posterior: how sure the numbers are, and what the recording cannot tell."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from pamjax.infer.fitting.report import quantity
from pamjax.infer.posterior.report import interval, priors, repeats, ridges, trust
from pamjax.infer.posterior.result import Posterior
from pamjax.infer.problem.priors import is_ruler
from pamjax.view.figures import posterior as figures
from pamjax.view.reports.fit import NAMED, drawn, model_of, words
from pamjax.view.reports.page import write_page


def save_report(post: Posterior, path: str | Path, command: str = "pamjax sample") -> Path:
    """Write the report of a posterior.

    Args:
        post: the posterior.
        path: the HTML file; its folder must exist.
        command: what repeats it, in a shell.
    """
    shown = [name for name in post.names if not is_ruler(name)]
    fit = post.fit
    return write_page(
        path,
        "posterior.html.jinja",
        title=headline(post),
        kicker=f"Posterior of {words([one.case.name for one in fit.cases])} · {model_of(fit)}",
        answer=answer(post),
        belief=drawn(partial(figures.belief_figure, post), "belief"),
        rows=[_row(post, name) for name in shown],
        together=[line.strip() for line in ridges(post)],
        ridge=drawn(partial(figures.ridge_figure, post), "ridge") if figures.ridges(post) else None,
        corner=drawn(partial(figures.corner_figure, post), "corner"),
        profile=drawn(partial(figures.profile_figure, post), "profile") if post.verdicts else None,
        bands=[
            (one.case.name, drawn(partial(figures.band_figure, post, k), f"band-{k}"))
            for k, one in enumerate(fit.cases)
        ],
        trace=drawn(partial(figures.trace_figure, post), "trace"),
        believed=[line.strip() for line in list(priors(post))[1:]],
        assumed=[line.strip() for line in [*repeats(post), *trust(post)]],
        checksums=[(one.case.name, one.case.checksum) for one in fit.cases],
        command=command,
    )


def headline(post: Posterior) -> str:
    """The answer in a line."""
    if not post.reached:
        return "The chains are not good enough yet"
    settled = sum(v.kind == "determined" for v in post.verdicts.values())
    if settled == len(post.verdicts):
        return "The recording determines every number"
    return f"The recording determines {settled} of {len(post.verdicts)} numbers"


def answer(post: Posterior) -> tuple[str, str]:
    """What is known and how well; what is not."""
    kinds: dict[str, list[str]] = {}
    for name, verdict in post.verdicts.items():
        kinds.setdefault(verdict.kind, []).append(name)
    known = [f"{n} is {_value(post, n)}" for n in kinds.pop("determined", [])[:NAMED]]
    first = f"{words(known)}." if known else "No number is determined by itself."
    rest = [f"{kind}: {words(names[:NAMED])}" for kind, names in kinds.items()]
    worth, rhat = post.health.ess.min(), post.health.rhat.max()
    sure = f"the draws are worth {worth:.0f} independent ones, split-R̂ {rhat:.3f}"
    second = "; ".join([*rest, sure])
    return first, f"{second[:1].upper()}{second[1:]}."


def _value(post: Posterior, name: str) -> str:
    m, (_, unit) = post.marginals[name], post.units(name)
    tail = "" if unit == "1" else f" {unit}"
    return f"{quantity(m.mean, m.sd, unit)} (90 %: {interval(post, name)}{tail})"


def _row(post: Posterior, name: str) -> list[str]:
    m, (_, unit) = post.marginals[name], post.units(name)
    verdict = str(post.verdicts[name]) if name in post.verdicts else "noise"
    return [
        name,
        quantity(m.mean, m.sd, unit),
        interval(post, name),
        verdict,
    ]

"""Report of a posterior: parameters with their uncertainty, and which of them the data determine."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from pamjax.infer.fitting.determination import DETERMINED
from pamjax.infer.posterior.report import (
    format_form_error_sizes,
    format_interval,
    format_likelihood_powers,
    format_posterior_correlations,
    format_priors,
    format_sampler_state,
)
from pamjax.infer.posterior.result import Posterior
from pamjax.infer.problem.priors import is_length_error
from pamjax.text import join_words
from pamjax.units import format_estimate
from pamjax.view.figures import posterior as figures
from pamjax.view.figures.posterior_checks import plot_band, plot_profiles, plot_traces
from pamjax.view.reports.fit import MAX_NAMED, draw_picture, format_model
from pamjax.view.reports.page import write_page
from pamjax.view.wording import capitalise_sentence


def write_posterior_report(post: Posterior, path: str | Path, command: str = "pamjax sample") -> Path:
    """Write the report of a posterior.

    Args:
        post: the posterior.
        path: the HTML file; its folder must exist.
        command: shell command that repeats the sampling.
    """
    names = [name for name in post.names if not is_length_error(name)]
    fit = post.fit
    return write_page(
        path,
        "posterior.html.jinja",
        title=format_headline(post),
        kicker=f"Posterior of {join_words([case_fit.case.name for case_fit in fit.cases])} ·"
        f" {format_model(fit)}",
        answer=format_answer(post),
        marginals=draw_picture(partial(figures.plot_marginals, post), "marginals"),
        rows=[_build_row(post, name) for name in names],
        correlations=[capitalise_sentence(line.strip()) for line in format_posterior_correlations(post)],
        form_errors=[capitalise_sentence(line) for line in format_form_error_sizes(post)],
        ridges=draw_picture(partial(figures.plot_ridges, post), "ridges")
        if figures.find_ridges(post)
        else None,
        corner=draw_picture(partial(figures.plot_corner, post), "corner"),
        profiles=draw_picture(partial(plot_profiles, post), "profiles") if post.verdicts else None,
        bands=[
            (case_fit.case.name, draw_picture(partial(plot_band, post, k), f"band-{k}"))
            for k, case_fit in enumerate(fit.cases)
        ],
        traces=draw_picture(partial(plot_traces, post), "traces"),
        priors=[line.strip() for line in list(format_priors(post))[1:]],
        sampler=[
            capitalise_sentence(line.strip())
            for line in [*format_likelihood_powers(post), *format_sampler_state(post)]
        ],
        checksums=[(case_fit.case.name, case_fit.case.checksum) for case_fit in fit.cases],
        command=command,
    )


def format_headline(post: Posterior) -> str:
    """Return the result in one line."""
    if not post.converged:
        return "The chains have not converged"
    determined_count = sum(v.kind == DETERMINED for v in post.verdicts.values())
    if determined_count == len(post.verdicts):
        return "The recording determines all parameters"
    return f"The recording determines {determined_count} of {len(post.verdicts)} parameters"


def format_answer(post: Posterior) -> tuple[str, str]:
    """Return the parameters that the data determine, then the others and the convergence."""
    kinds: dict[str, list[str]] = {}
    for name, verdict in post.verdicts.items():
        kinds.setdefault(verdict.kind, []).append(name)
    determined = [f"{n} is {_format_value(post, n)}" for n in kinds.pop(DETERMINED, [])[:MAX_NAMED]]
    first_sentence = (
        f"{join_words(determined)}." if determined else "The recording determines no single parameter."
    )
    sentences = [
        f"{capitalise_sentence(kind)}: {join_words(names[:MAX_NAMED])}." for kind, names in kinds.items()
    ]
    effective_samples, rhat = post.convergence.ess.min(), post.convergence.rhat.max()
    sentences.append(
        f"The smallest effective sample size is {effective_samples:.0f}, the largest R-hat {rhat:.3f}."
    )
    return first_sentence, " ".join(sentences)


def _format_value(post: Posterior, name: str) -> str:
    marginal, (_, unit) = post.marginals[name], post.find_units(name)
    tail = "" if unit == "1" else f" {unit}"
    interval = f"90 % interval {format_interval(post, name)}{tail}"
    return f"{format_estimate(marginal.mean, marginal.sd, unit)} ({interval})"


def _build_row(post: Posterior, name: str) -> list[str]:
    marginal, (_, unit) = post.marginals[name], post.find_units(name)
    verdict = str(post.verdicts[name]) if name in post.verdicts else "noise"
    return [
        name,
        format_estimate(marginal.mean, marginal.sd, unit),
        format_interval(post, name),
        verdict,
    ]

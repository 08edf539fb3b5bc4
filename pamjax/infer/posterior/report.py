"""The text report of a posterior."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from pamjax.channels import format_channel_value
from pamjax.infer.fitting.report import MIN_REPORTED_CORRELATION, select_shown_effects
from pamjax.infer.problem.priors import is_length_error
from pamjax.units import format_estimate, format_quantity, has_digits, round_by_sd

if TYPE_CHECKING:
    from pamjax.infer.posterior.result import Posterior


def format_posterior_summary(post: Posterior) -> str:
    """Return the full report as plain text."""
    lines = [
        _format_title(post),
        "",
        *_format_parameters(post),
        "",
        *format_priors(post),
        "",
        *format_posterior_correlations(post),
        *(f"  {line}" for line in format_form_error_sizes(post)),
        *format_likelihood_powers(post),
        "",
    ]
    return "\n".join([*lines, *format_sampler_state(post)])


def _format_title(post: Posterior) -> str:
    fit = post.fit
    cases = ", ".join(case_fit.case.name for case_fit in fit.cases)
    model = ", ".join((f"{fit.law} threads", *fit.mechanisms))
    return f"{cases}: {model}; mean ± sd, and 90 % credible interval"


def _list_reported_names(post: Posterior) -> list[str]:
    return [name for name in post.names if not is_length_error(name)]


def _format_parameters(post: Posterior) -> Iterator[str]:
    width = max(map(len, _list_reported_names(post)))
    for name in _list_reported_names(post):
        m, (_, unit) = post.marginals[name], post.find_units(name)
        verdict = str(post.verdicts[name]) if name in post.verdicts else "noise"
        yield (
            f"  {name:<{width}}  {format_estimate(m.mean, m.sd, unit):<24}"
            f" {format_interval(post, name):<22} {verdict}"
        )


def format_interval(post: Posterior, name: str) -> str:
    """Return the 90 % credible interval of a parameter, with digits according to its sd."""
    m, (_, unit) = post.marginals[name], post.find_units(name)
    if not has_digits(m.sd):
        return " to ".join(format_quantity(end, unit, 5).partition(" ")[0] for end in (m.low, m.high))
    (low, high), power = round_by_sd([m.low, m.high], m.sd, unit)
    return f"({low} to {high}){power}" if power else f"{low} to {high}"


def format_priors(post: Posterior) -> Iterator[str]:
    """Return lines with the prior of every parameter, after a heading."""
    space = post.density.space
    yield "  priors:"
    for k, name in enumerate(space.names):
        if is_length_error(name):
            continue
        _, unit = post.find_units(name)
        low, high = (
            format_quantity(float(space.low[k]), unit, 3),
            format_quantity(float(space.high[k]), unit, 3),
        )
        if np.isfinite(space.sd[k]):
            prior = format_estimate(float(space.mean[k]), float(space.sd[k]), unit)
        else:
            prior = f"uniform from {low} to {high}{' in its logarithm' if space.log_scale[k] else ''}"
        origin = " (replaces that of muscle.toml)" if name in post.priors else ""
        yield f"    {name}: {prior}{origin}"


def format_posterior_correlations(post: Posterior) -> Iterator[str]:
    """Return lines with the strongest correlations."""
    names = post.names
    pairs = [
        (abs(post.correlation[i, j]), names[j], names[i], post.correlation[i, j])
        for i in range(len(names))
        for j in range(i)
        if abs(post.correlation[i, j]) > MIN_REPORTED_CORRELATION
    ]
    for _, first, second, value in sorted(pairs, reverse=True)[:5]:
        yield f"  {first} and {second} are correlated ({value:+.2f})"


def format_form_error_sizes(post: Posterior) -> Iterator[str]:
    """Return a line on the form error of each mechanism, with its 90 % interval, and on its equation."""
    for case_fit, sizes in zip(post.fit.cases, post.form_errors, strict=True):
        prefix = "" if len(post.fit.cases) == 1 else f"{case_fit.case.name}: "
        for id, size in sizes.items():
            effects = select_shown_effects(case_fit, size.effect_rms)
            if not effects:
                continue
            textbook_part = ", ".join(format_channel_value(rms, channel) for channel, rms in effects.items())
            form = "none"
            if size.share:
                low, high = np.quantile(size.ratio, (0.05, 0.95))
                form = f"{size.ratio.mean():.0%} (90 % interval {low:.0%} to {high:.0%})"
            yield f"{prefix}form error of {id}: {form}, textbook part {textbook_part}"


def format_likelihood_powers(post: Posterior) -> Iterator[str]:
    """Return a line for each channel whose residuals are not AR(1)."""
    for case_fit, likelihoods, powers in zip(
        post.fit.cases, post.density.likelihoods, post.density.powers, strict=True
    ):
        for likelihood, power in zip(likelihoods, powers, strict=True):
            if power < 1:
                channel = ("force", "diameter")[likelihood.channel]
                yield (
                    f"  {case_fit.case.name}: the {channel} residuals have more than one correlation time,"
                    f" which divides their effective sample size by {1 / float(power):.1f}"
                )


def format_sampler_state(post: Posterior) -> Iterator[str]:
    """Return lines on convergence and divergent draws."""
    convergence = post.convergence
    n, chains, _ = post.draws.shape
    ess, rhat = post.targets
    state = "converged" if post.converged else "NOT CONVERGED: increase max_draws"
    yield (
        f"  {post.sampler}, {chains} {'walkers' if post.sampler == 'emcee' else 'chains'} × {n} draws, seed "
        f"{post.seed}: {state}"
    )
    yield (
        f"  effective sample size {convergence.ess.min():.0f} (at least {ess:.0f}), split-R̂"
        f" {convergence.rhat.max():.3f} (at most {rhat:g}), autocorrelation time"
        f" {convergence.autocorrelation_time.max():.1f} draws"
    )
    if (diverging := int(np.sum(post.stats.get("diverging", 0)))) > 0:
        yield f"  {diverging} divergent draws: the sampler may have missed a part of the posterior"

"""`pamjax sample`: posterior uncertainty of the parameters of a muscle."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from pamjax.cli.options import DEFAULT_MODEL, Json, ModelOptions
from pamjax.cli.overwrite import check_replaceable
from pamjax.cli.screen import (
    REPORT_FILE,
    check_writable,
    format_command,
    print_json,
    print_text,
    print_written_files,
    show_progress,
)

#: Share of the progress bar for the sampling itself. The rest is for profiles, figures and the report.
_SAMPLING_SHARE = 0.8


def sample(
    cases: list[Path],
    /,
    *,
    out: Path = Path("out"),
    model: ModelOptions = DEFAULT_MODEL,
    form_error: Annotated[bool, Parameter(negative="")] = False,
    priors: Path | None = None,
    sampler: Literal["emcee", "nuts"] = "emcee",
    ess: float = 1000.0,
    rhat: float = 1.01,
    max_draws: int = 20_000,
    seed: int = 0,
    figures: bool = True,
    report: bool = True,
    json: Json = False,
) -> None:
    """Draw from the posterior of the parameters of a muscle and of its noise.

    Writes posterior.nc (for ArviZ), posterior.json, figures and report.html. Prints a summary that states for
    each parameter whether the recording determines it. The chain is saved in the output folder. The same
    command continues an interrupted run; it does not extend a finished one.

    Args:
        cases: case folders, each with recording.csv and muscle.toml.
        out: output folder.
        form_error: allow for differences between effects and the equations of the mechanisms.
        priors: TOML file with priors that replace those of muscle.toml. It has one table for each parameter,
            such as ["thread.modulus"], with value, sd, low and high, each with its unit.
        sampler: emcee (ensemble sampler) or nuts (needs the package blackjax).
        ess: required effective sample size of every parameter.
        rhat: largest accepted split-R̂ of every parameter.
        max_draws: largest number of draws of one walker or chain.
        seed: random seed for the sampler and the fit.
        figures: write the figures.
        report: write report.html for a web browser.
        json: print posterior.json instead of the summary.
    """
    check_writable(out)
    parsed_cases = model.read_cases(cases)
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.infer.posterior.io import build_posterior_document, save_posterior
    from pamjax.infer.posterior.priors_file import read_priors
    from pamjax.infer.posterior.sample import sample as draw_posterior
    from pamjax.records.files import write_results_together

    names = ["posterior.json", "posterior.nc", *([REPORT_FILE] if report else [])]
    if figures:
        from pamjax.view.figures.posterior import list_figure_names

        names += list_figure_names([case.name for case in parsed_cases])
    check_replaceable(out, names)
    stated_priors = read_priors(priors) if priors else {}
    keep_compiled()
    with show_progress(quiet=json) as progress:

        def report_sampling(step: str, fraction: float) -> None:
            progress(step, _SAMPLING_SHARE * fraction)

        post = draw_posterior(
            parsed_cases,
            *model.fit_arguments,
            form_error=form_error,
            priors=stated_priors,
            sampler=sampler,
            ess=ess,
            rhat=rhat,
            max_draws=max_draws,
            seed=seed,
            checkpoint=out / "chain",
            progress=report_sampling,
        )
        progress("computing profiles", _SAMPLING_SHARE)
        _ = post.verdicts
        progress("writing results", 0.9)
        with write_results_together(out) as folder:
            paths = save_posterior(post, folder)
            if figures:
                from pamjax.view.figures.posterior import save_posterior_figures

                paths += save_posterior_figures(post, folder)
            if report:
                from pamjax.view.reports.posterior import write_posterior_report

                paths.append(write_posterior_report(post, folder / REPORT_FILE, format_command()))
    if figures:
        from pamjax.view.figures.posterior import remove_stale_figures

        remove_stale_figures(out, paths)
    paths = [out / path.name for path in paths]
    print_json(build_posterior_document(post)) if json else print_text(str(post))
    print_written_files(paths)

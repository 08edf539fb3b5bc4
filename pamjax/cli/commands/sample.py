"""`pamjax sample`: how sure the calibrated numbers are."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pamjax.cli.options import DEFAULT_MODEL, Json, ModelOptions
from pamjax.cli.screen import (
    REPORT_FILE,
    check_writable,
    format_command,
    print_json,
    print_text,
    print_written_files,
    show_progress,
)


def sample(
    cases: list[Path],
    /,
    *,
    out: Path = Path("out"),
    model: ModelOptions = DEFAULT_MODEL,
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
    """Draw from the posterior of a muscle's numbers and of the noise's.

    Writes posterior.nc (for ArviZ), posterior.json, figures and report.html; prints a lab note with
    a verdict for each number. The chain is kept in the folder: a run that was stopped or killed goes on
    where it was when the same words are said again, and one that is finished is not walked further.

    Args:
        cases: case folders, each with recording.csv and muscle.toml.
        out: folder to write to.
        priors: TOML file of what to believe instead: a table for each number, as
            ["thread.modulus"] with value, sd, low and high, each with its unit.
        sampler: emcee, an ensemble of walkers, or nuts, which needs blackjax.
        ess: effective samples that every number is to have.
        rhat: split-R̂ that no number is to exceed.
        max_draws: draws of one walker or chain, at most.
        seed: of the sampler and of the fit.
        figures: whether to draw.
        report: whether to write report.html, which opens in any browser.
        json: print posterior.json instead of the note.
    """
    check_writable(out)
    parsed_cases = model.read_cases(cases)
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.infer.posterior.io import build_posterior_document, save_posterior
    from pamjax.infer.posterior.priors_file import read_priors
    from pamjax.infer.posterior.sample import sample as walk

    beliefs = read_priors(priors) if priors else {}
    keep_compiled()
    with show_progress(quiet=json) as progress:
        post = walk(
            parsed_cases,
            *model.fit_arguments,
            priors=beliefs,
            sampler=sampler,
            ess=ess,
            rhat=rhat,
            max_draws=max_draws,
            seed=seed,
            checkpoint=out / "chain",
            progress=progress,
        )
        progress("profiles", 1.0)
        _ = post.verdicts
    written = save_posterior(post, out)
    if figures:
        from pamjax.view.figures.posterior import save_posterior_figures

        written += save_posterior_figures(post, out)
    if report:
        from pamjax.view.reports.posterior import write_posterior_report

        written.append(write_posterior_report(post, out / REPORT_FILE, format_command()))
    print_json(build_posterior_document(post)) if json else print_text(str(post))
    print_written_files(written)

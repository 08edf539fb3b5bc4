"""`pamjax prove`: test `pamjax diagnose` on simulated recordings with concealed effects."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from pamjax.cli.options import Json
from pamjax.cli.screen import check_writable, print_json, print_text, print_written_files, show_progress

#: Recordings of `--quick` for each noise correlation, by number of concealed effects.
QUICK_COUNTS = {"nothing": 1, "single": 3, "pair": 1, "triple": 0, "outside": 1}
QUICK_CORRELATIONS = (0.0, 0.9)


def prove(
    *,
    out: Path = Path("out"),
    nothing: int = 1,
    single: int = 2,
    pair: int = 0,
    triple: int = 0,
    outside: int = 1,
    correlation: Annotated[list[float] | None, Parameter(negative="")] = None,
    stage: Literal["all", "score"] = "all",
    form_error: float = 0.0,
    rivals: bool = True,
    quick: bool = False,
    workers: int = 1,
    seed: int = 0,
    json: Json = False,
) -> None:
    """Test `pamjax diagnose` on simulated recordings with concealed effects.

    Every recording has a random muscle, bench, noise and random effects. The command appends each result to
    trials.jsonl; the same command continues an interrupted run. At the end it writes table.md, table.csv,
    table.json and figures of all results in the folder.

    Args:
        out: output folder.
        nothing: number of recordings without a concealed effect, for each correlation.
        single: number of recordings with one effect.
        pair: number of recordings with two effects.
        triple: number of recordings with three effects.
        outside: number of recordings with an effect outside the library.
        correlation: noise correlation of neighbouring samples, 0 to 0.95; repeat the option for several
            values; by default 0.
        stage: all (complete diagnosis) or score (only the p-value of the baseline model, for recordings
            without an effect).
        form_error: relative difference between concealed effects and the equations of their mechanisms, 0 to
            0.5; it varies smoothly over pressure and length.
        rivals: also evaluate common practice, BIC selection and a Gaussian process.
        quick: run a small study with fixed numbers of recordings and correlations on two cores.
        workers: number of processes; each needs some gigabytes of memory and compiles the model once.
        seed: random seed for all recordings.
        json: print the table as JSON.
    """
    from pamjax.errors import check_minimum, refuse

    counts = {"nothing": nothing, "single": single, "pair": pair, "triple": triple, "outside": outside}
    correlations = tuple(correlation) if correlation else (0.0,)
    if quick:
        counts, correlations, workers = QUICK_COUNTS, QUICK_CORRELATIONS, max(workers, 2)
    if stage == "score":
        counts = {"nothing": counts["nothing"]}
    for name, count in (counts | {"seed": seed}).items():
        check_minimum(name, count, 0)
    for rho in correlations:
        if not 0 <= rho <= 0.95:
            raise refuse("`correlation` must be between 0 and 0.95", f"{rho:g}")
    if not 0 <= form_error <= 0.5:
        raise refuse("`form_error` must be between 0 and 0.5", f"{form_error:g}")
    check_minimum("workers", workers, 1)
    check_writable(out)
    out.mkdir(parents=True, exist_ok=True)
    from pamjax.benchmark.prove import build_tasks, read_trials, run_proof
    from pamjax.benchmark.rates import build_rows, format_text
    from pamjax.benchmark.tally import tabulate_trials
    from pamjax.compile.jax_cache import keep_compiled

    keep_compiled()
    file = out / "trials.jsonl"
    tasks = build_tasks(
        counts,
        correlations,
        stage=stage,
        seed=seed,
        with_baselines=rivals and stage == "all",
        form_error=form_error,
    )
    with show_progress(quiet=json) as progress:
        trials = run_proof(tasks, file, workers=workers, progress=progress)
    rates = tabulate_trials(trials)
    print_json(build_rows(rates)) if json else print_text(
        "\n".join([format_text(rates), *_format_trials(trials)])
    )
    print_written_files([file, *_write_tables(out, read_trials(file))])


def _format_trials(trials: list) -> Iterator[str]:
    """Return concealed and named effects of the first twenty trials with effects."""
    for trial in [item for item in trials if item.kind != "nothing"][:20]:
        named_text = ", ".join(trial.named) or ("unexplained" if trial.unexplained else "nothing")
        yield f"  {trial.kind} {trial.number + 1}: {', '.join(trial.concealed)} -> {named_text}"


def _write_tables(out: Path, trials: list) -> list[Path]:
    """Write the tables and figures of all trials in a folder and return their paths."""
    from pamjax.benchmark.rates import build_documents
    from pamjax.benchmark.tally import tabulate_trials
    from pamjax.records.files import write_atomically
    from pamjax.view.figures.benchmark import plot_null, plot_proof
    from pamjax.view.theme import save_figure

    files = []
    for name, document in build_documents(tabulate_trials(trials)).items():
        with write_atomically(out / name) as temporary:
            temporary.write_text(document, encoding="utf-8")
        files.append(out / name)
    for name, drawing in (("nothing", plot_null(trials)), ("recovery", plot_proof(trials))):
        files += save_figure(drawing, out / name) if drawing else []
    return files

"""`pamjax prove`: test `pamjax diagnose` on simulated recordings with concealed effects."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from pamjax.cli.options import Json
from pamjax.cli.overwrite import check_replaceable
from pamjax.cli.screen import check_writable, print_json, print_text, print_written_files, show_progress
from pamjax.errors import BadInput, check_minimum

#: Recordings of `--quick` for each noise correlation, by number of concealed effects.
_QUICK_COUNTS = {"nothing": 1, "single": 3, "pair": 1, "triple": 0, "outside": 1}
_QUICK_CORRELATIONS = (0.0, 0.9)


def prove(
    *,
    out: Path = Path("out"),
    nothing: int = 1,
    single: int = 2,
    pair: int = 0,
    triple: int = 0,
    outside: int = 1,
    mixed: int = 0,
    correlation: Annotated[list[float] | None, Parameter(negative="")] = None,
    stage: Literal["all", "score"] = "all",
    bank: Literal["own", "other-forms"] = "own",
    form_error: float = 0.0,
    rivals: bool = True,
    quick: bool = False,
    workers: int = 1,
    seed: int = 0,
    write: Path | None = None,
    json: Json = False,
) -> None:
    """Test `pamjax diagnose` on simulated recordings with concealed effects.

    Every recording has a random muscle, rig, noise and random effects. The command appends each result to
    trials.jsonl; the same command continues an interrupted run. At the end it writes table.md, table.csv,
    table.json and figures of all results in the folder.

    Args:
        out: output folder.
        nothing: number of recordings without a concealed effect, for each correlation.
        single: number of recordings with one effect.
        pair: number of recordings with two effects.
        triple: number of recordings with three effects.
        outside: number of recordings with an effect outside the library.
        mixed: number of recordings with one such effect and one mechanism, in the bank other-forms.
        correlation: noise correlation of neighbouring samples, 0 to 0.95; repeat the option for several
            values; by default 0.
        stage: all (complete diagnosis) or score (only the p-value of the baseline model, for recordings
            without an effect).
        bank: own (concealed effects have the equations of the fit) or other-forms (no mechanism has its
            equation, sensors may be misstated; docs/validation-simulated.md describes it).
        form_error: relative difference between concealed effects and the equations of their mechanisms, 0 to
            0.5; it varies smoothly over pressure and length.
        rivals: also evaluate two standard methods: forward selection by BIC, and a Gaussian process.
        quick: run a small study with fixed numbers of recordings and correlations on two cores.
        workers: number of processes; each needs some gigabytes of memory and compiles the model once.
        seed: random seed for all recordings.
        write: with the bank other-forms, write its recordings as case folders with key.json to this new
            folder, and diagnose nothing.
        json: print the table as JSON.
    """
    counts = {"nothing": nothing, "single": single, "pair": pair, "triple": triple, "outside": outside}
    if bank == "other-forms":
        counts["mixed"] = mixed
    elif mixed or write:
        option = "--mixed" if mixed else "--write"
        raise BadInput.from_rule(
            f"`{option}` needs the bank of other forms", remedy="Add --bank other-forms."
        )
    correlations = tuple(correlation) if correlation else (0.0,)
    if quick:
        counts, correlations, workers = _QUICK_COUNTS, _QUICK_CORRELATIONS, max(workers, 2)
    if bank == "other-forms" and (stage == "score" or form_error):
        option = "--stage score" if stage == "score" else "--form-error"
        raise BadInput.from_rule(
            f"`{option}` is not possible with the bank of other forms", remedy="Remove the option."
        )
    if stage == "score":
        counts = {"nothing": counts["nothing"]}
    for name, count in (counts | {"seed": seed}).items():
        check_minimum(name, count, 0)
    for rho in correlations:
        if not 0 <= rho <= 0.95:
            raise BadInput.from_rule("`correlation` must be between 0 and 0.95", f"{rho:g}")
    if not 0 <= form_error <= 0.5:
        raise BadInput.from_rule("`form_error` must be between 0 and 0.5", f"{form_error:g}")
    check_minimum("workers", workers, 1)
    from pamjax.benchmark.prove import build_tasks

    tasks = build_tasks(
        counts, correlations, stage=stage, seed=seed,
        with_competitors=rivals and stage == "all" and bank == "own", form_error=form_error, bank=bank,
    )  # fmt: skip
    if write is not None:
        _write_recordings(write, tasks, seed, json)
    else:
        _run_study(tasks, out, bank, workers, json)


def _write_recordings(folder: Path, tasks: list, seed: int, json: bool) -> None:
    """Write the recordings of the tasks in random order as case folders with a key."""
    import numpy as np

    from pamjax.benchmark.bank_trial import draw_task_recording
    from pamjax.benchmark.other_forms.case_files import write_bank

    if folder.exists() and any(folder.iterdir()):
        rule = "`write` must be a new or an empty folder"
        raise BadInput.from_rule(rule, f"{folder}, which has files", remedy="Choose another folder.")
    check_writable(folder)
    order = np.random.default_rng(seed).permutation(len(tasks)).tolist()
    recordings = []
    with show_progress(quiet=json) as progress:
        for finished_count, k in enumerate(order, start=1):
            recordings.append(draw_task_recording(tasks[k]))
            progress(f"{finished_count} of {len(tasks)}", finished_count / len(tasks))
    more_entries = [{"number": tasks[k].trial_index, "seed": seed} for k in order]
    key = write_bank(folder, recordings, more_entries)
    if json:
        print_json({"folder": str(folder), "recordings": len(recordings), "key": str(key)})
    else:
        print_text(f"  {len(recordings)} recordings in {folder}")
    print_written_files([key])


def _run_study(tasks: list, out: Path, bank: str, workers: int, json: bool) -> None:
    """Diagnose the recordings of the tasks, and write the results and their tables."""
    check_writable(out)
    figure_names = [
        f"{name}.{kind}" for name in ("nothing", "recovery", "reliability") for kind in ("png", "pdf")
    ]
    check_replaceable(out, ["trials.jsonl", "table.md", "table.csv", "table.json", *figure_names])
    out.mkdir(parents=True, exist_ok=True)
    from pamjax.benchmark.bank_tally import tabulate_bank
    from pamjax.benchmark.bank_trial import run_bank_trial
    from pamjax.benchmark.prove import read_trials, run_proof
    from pamjax.benchmark.rates import build_rows, format_text
    from pamjax.benchmark.tally import tabulate_trials
    from pamjax.benchmark.trial import run_trial
    from pamjax.compile.jax_cache import keep_compiled

    keep_compiled()
    file = out / "trials.jsonl"
    tabulate, attempt = (tabulate_trials, run_trial) if bank == "own" else (tabulate_bank, run_bank_trial)
    with show_progress(quiet=json) as progress:
        trials = run_proof(tasks, file, workers=workers, progress=progress, attempt=attempt)
    rates = tabulate(trials)
    print_json(build_rows(rates)) if json else print_text(
        "\n".join([format_text(rates), *_format_trials(trials)])
    )
    same_bank = [trial for trial in read_trials(file) if trial.bank == bank]
    print_written_files([file, *_write_tables(out, same_bank, tabulate(same_bank), bank)])


def _format_trials(trials: list) -> Iterator[str]:
    """Return concealed and named effects of the first twenty trials with effects."""
    for trial in [item for item in trials if item.kind != "nothing"][:20]:
        named_text = ", ".join(trial.named) or ("unexplained" if trial.unexplained else "nothing")
        concealed_text = ", ".join([*trial.concealed, *([trial.outside] if trial.outside else [])])
        yield f"  {trial.kind} {trial.trial_index + 1}: {concealed_text} -> {named_text}"


def _write_tables(out: Path, trials: list, lines: list, bank: str) -> list[Path]:
    """Write the tables and figures of all trials in a folder and return their paths."""
    from pamjax.benchmark.rates import build_documents
    from pamjax.records.files import write_atomically
    from pamjax.view.figures.benchmark import plot_bank, plot_null, plot_proof
    from pamjax.view.theme import save_figure

    files = []
    for name, document in build_documents(lines).items():
        with write_atomically(out / name) as temporary:
            temporary.write_text(document, encoding="utf-8")
        files.append(out / name)
    own_drawings = {"nothing": plot_null, "recovery": plot_proof}
    drawings = own_drawings if bank == "own" else {"reliability": plot_bank}
    for name, plot in drawings.items():
        drawing = plot(trials)
        files += save_figure(drawing, out / name) if drawing else []
    return files

"""Run of the simulation study: inject effects, diagnose, compare. A stopped run continues."""

from __future__ import annotations

import json
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import contextmanager
from itertools import islice
from multiprocessing.process import BaseProcess
from pathlib import Path

import pamjax.benchmark.trial
from pamjax.benchmark.trial import Trial, TrialTask, parse_trial
from pamjax.errors import BadInput
from pamjax.progress import Progress, ignore_progress

#: One thread for each process: two processes with two threads each are slower than with one. The compiler's
#: flags remain unchanged, because cached programs are only valid for the same flags.
_SINGLE_THREAD_ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

TrialRunner = Callable[[TrialTask], Trial]


def run_proof(
    tasks: Sequence[TrialTask],
    file: Path,
    *,
    workers: int = 1,
    progress: Progress = ignore_progress,
    attempt: TrialRunner | None = None,
) -> list[Trial]:
    """Run the tasks whose trials are not in the file yet, and return all trials.

    Args:
        tasks: the tasks.
        file: file of trials, one on each line; every trial is appended as soon as it is done.
        workers: number of processes.
        progress: called with a description and the completed fraction.
        attempt: function from task to trial, by default `trial.run_trial`; with several workers it must be
            importable by name.

    Returns:
        the trials of these tasks, in their order.
    """
    trials_by_key = {trial.key: trial for trial in read_trials(file)} if file.exists() else {}
    missing_tasks = [task for task in tasks if task.key not in trials_by_key]
    for finished_count, trial in enumerate(
        _run_trials(missing_tasks, workers, attempt or pamjax.benchmark.trial.run_trial), start=1
    ):
        _append_trial(file, trial)
        trials_by_key[trial.key] = trial
        progress(f"{finished_count} of {len(missing_tasks)}", finished_count / len(missing_tasks))
    return [trials_by_key[task.key] for task in tasks]


def _run_trials(tasks: Sequence[TrialTask], workers: int, attempt: TrialRunner) -> Iterator[Trial]:
    if workers == 1 or len(tasks) < 2:
        yield from map(attempt, tasks)
        return
    spawn = multiprocessing.get_context("spawn")
    with (
        _set_environment(_SINGLE_THREAD_ENVIRONMENT),
        ProcessPoolExecutor(
            min(workers, len(tasks)), mp_context=spawn, initializer=_initialise_worker
        ) as pool,
    ):
        remaining_tasks = iter(tasks)
        running = {pool.submit(attempt, task) for task in islice(remaining_tasks, 2 * workers)}
        try:
            while running:
                finished_runs, running = wait(running, return_when=FIRST_COMPLETED)
                running |= {
                    pool.submit(attempt, task) for task in islice(remaining_tasks, len(finished_runs))
                }
                yield from (finished_run.result() for finished_run in finished_runs)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _initialise_worker() -> None:
    from pamjax.compile.jax_cache import keep_compiled

    threading.Thread(target=_exit_with_parent, args=(multiprocessing.parent_process(),), daemon=True).start()
    keep_compiled()


def _exit_with_parent(parent: BaseProcess | None) -> None:
    """Exit when the parent process ends: a killed parent does not stop its workers."""
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _set_environment(variables: dict[str, str]) -> Iterator[None]:
    """Set environment variables for the processes that are started inside the block."""
    old_values = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in old_values.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _append_trial(file: Path, trial: Trial) -> None:
    """Append a trial as one line in one write; an incomplete line is ignored when read."""
    with file.open("ab") as out:
        if out.tell() and not _ends_with_newline(file):
            out.write(b"\n")
        out.write(trial.format_line().encode() + b"\n")
        out.flush()
        os.fsync(out.fileno())


def _ends_with_newline(file: Path) -> bool:
    with file.open("rb") as stream:
        stream.seek(-1, os.SEEK_END)
        return stream.read(1) == b"\n"


def read_trials(file: Path) -> list[Trial]:
    """Read trials from their file; incomplete lines are ignored.

    Raises:
        BadInput: if a complete line is no trial.
    """
    trials = []
    lines = file.read_text(encoding="utf-8").split("\n")
    for number, line in enumerate(lines, start=1):
        if not line:
            continue
        try:
            trials.append(parse_trial(line))
        except json.JSONDecodeError:
            continue
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise BadInput.from_rule(
                "each line must be one trial that `pamjax prove` wrote", "something else",
                f"line {number} of {file.name}", "Use another folder.",
            ) from error  # fmt: skip
    return trials


def build_tasks(
    counts: dict[str, int], correlations: Iterable[float], *, stage: str = "all", seed: int = 0,
    with_competitors: bool = False, form_error: float = 0.0, bank: str = "own",
) -> list[TrialTask]:  # fmt: skip
    """Return `counts` tasks of each kind at each correlation, in alternating order.

    >>> [(t.kind, t.trial_index) for t in build_tasks({"nothing": 1, "pair": 2}, [0.5])]
    [('nothing', 0), ('pair', 0), ('pair', 1)]
    """
    return [
        TrialTask(stage, kind, correlation, trial_index, seed, with_competitors, form_error, bank)
        for trial_index in range(max(counts.values(), default=0))
        for correlation in correlations
        for kind, count in counts.items()
        if trial_index < count
    ]

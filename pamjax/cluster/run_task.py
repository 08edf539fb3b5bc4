"""One task in a worker process: run a stage, and write its folder with the outcome, within a time limit."""

from __future__ import annotations

import faulthandler
import os
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pamjax.cluster.case_steps import STEPS, read_unchanged_case
from pamjax.errors import BadInput
from pamjax.fleet.store import (
    DONE,
    ERROR_FILE,
    REFUSED,
    SET_ASIDE,
    TaskOutcome,
    open_stage_folder,
    read_outcome,
    remove_leftovers,
    store_set_aside,
    write_outcome,
)
from pamjax.fleet.task import FleetTask

#: Time after the limit at which a process that does not react is ended, s.
_REACTION_TIME = 30.0

#: Number of memory mappings of a process, at which compiled programs are dropped. Linux permits 65,530.
_MAX_MAPPINGS = 30_000

#: Time between two counts of the memory mappings, s.
_COUNT_STEP = 1.0

#: Time of the last count, from `time.monotonic`, s.
_counted_at = -_COUNT_STEP


def run_task(task: FleetTask, timeout: float | None = None) -> TaskOutcome:
    """Run a stage of a case, write its folder, and return the outcome.

    A bad input and an unexpected error are outcomes. Errors of the disk are raised, because they concern
    every case.

    Args:
        task: the task.
        timeout: time limit, s. A task that exceeds it is set aside, and its worker process ends.
    """
    former = read_outcome(task.target, task.key)
    if former.state == DONE:
        return former
    with limit_time(task, timeout):
        return _run_stage(task)


def _run_stage(task: FleetTask) -> TaskOutcome:
    begin = time.perf_counter()
    state, reason, details = DONE, "", ""
    remove_leftovers(task)
    with open_stage_folder(task) as folder:
        try:
            _write_results(task, folder)
        except BadInput as error:
            state, reason = REFUSED, str(error)
        except OSError:
            raise
        except Exception as error:
            state, reason = SET_ASIDE, f"unexpected error: {type(error).__name__}: {_shorten(str(error))}"
            details = traceback.format_exc()
        if state != DONE:
            _remove_files(folder)
        if details:
            (folder / ERROR_FILE).write_text(details, "utf-8")
        outcome = TaskOutcome(task.key, state, reason, time.perf_counter() - begin)
        write_outcome(folder, task, outcome)
    _drop_programs()
    return outcome


def _write_results(task: FleetTask, folder: Path) -> None:
    case = read_unchanged_case(task.folder, task.checksum)
    from pamjax.compile.jax_cache import keep_compiled

    keep_compiled()
    # The path of the model is no setting of the task: its name must not depend on the place of the store.
    STEPS[task.stage](case, folder, {**task.settings, "model": task.model})


def _shorten(text: str) -> str:
    """Return the first line of a text, at most 300 characters."""
    return (text.splitlines() or [""])[0][:300]


def _remove_files(folder: Path) -> None:
    """Remove the files of a stage that did not complete."""
    for path in folder.iterdir():
        path.unlink()


@contextmanager
def limit_time(task: FleetTask, timeout: float | None) -> Iterator[None]:
    """Set the task aside and end this process if the block takes longer than `timeout` seconds."""
    if timeout is None:
        yield
        return
    # The lock: a stage that ends at its limit must not be set aside after its results are there.
    finished, lock = threading.Event(), threading.Lock()

    def end_process() -> None:
        if finished.wait(timeout):
            return
        with lock:
            if not finished.is_set():
                store_set_aside(task, f"it took longer than the time limit of {timeout:g} s", timeout)
                os._exit(1)

    threading.Thread(target=end_process, daemon=True).start()
    # This ends the process also if a computation never lets another thread run.
    faulthandler.dump_traceback_later(timeout + _REACTION_TIME, exit=True, file=sys.__stderr__ or 2)
    try:
        yield
    finally:
        with lock:
            finished.set()
        faulthandler.cancel_dump_traceback_later()


def _drop_programs() -> None:
    """Drop compiled programs before the process exceeds the limit of its memory mappings."""
    global _counted_at
    # Counting takes two milliseconds, and a second of work adds few mappings.
    if time.monotonic() - _counted_at < _COUNT_STEP:
        return
    _counted_at = time.monotonic()
    mappings = Path("/proc/self/maps")
    if mappings.exists() and mappings.read_bytes().count(b"\n") > _MAX_MAPPINGS:
        import jax

        jax.clear_caches()

"""Run a fleet: find the open tasks of its store, run them on a cluster, and write the tables."""

from __future__ import annotations

import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from filelock import FileLock, Timeout

from pamjax.cluster.engine import TaskChain, TaskEngine, Work
from pamjax.cluster.run_task import run_task
from pamjax.errors import BadInput
from pamjax.fleet.plan import FleetPlan
from pamjax.fleet.store import DONE, LOCK_FILE, OPEN, SET_ASIDE, FleetStore, TaskOutcome, read_outcome
from pamjax.fleet.task import FleetTask

if TYPE_CHECKING:
    from distributed import Client


@dataclass
class RunProgress:
    """Numbers of a running fleet.

    Attributes:
        total: tasks that were open at the start; a refused case may leave some of them open.
        finished: tasks with an outcome.
        states: number of outcomes by state.
        begin: start, from `time.monotonic`, s.
    """

    total: int
    finished: int = 0
    states: Counter[str] = field(default_factory=Counter)
    begin: float = field(default_factory=time.monotonic)

    @property
    def seconds_left(self) -> float | None:
        """Return the estimated time to the end, s; None before the first outcome."""
        if not self.finished:
            return None
        return (time.monotonic() - self.begin) / self.finished * (self.total - self.finished)


@contextmanager
def lock_store(store: FleetStore) -> Iterator[None]:
    """Lock a store against other runs; the lock of a killed process is free.

    Raises:
        BadInput: if another run has the lock.
    """
    lock = FileLock(store.folder / LOCK_FILE)
    try:
        lock.acquire(timeout=0)
    except Timeout as error:
        rule = f"only one `pamjax fleet` may write to {store.folder}"
        raise BadInput.from_rule(
            rule, "another one that runs", remedy="Wait for it, or name another store."
        ) from error
    try:
        yield
    finally:
        lock.release()


def list_open_chains(store: FleetStore, plan: FleetPlan, retry: bool = False) -> list[TaskChain]:
    """Return the open tasks of each case.

    Args:
        store: the store.
        plan: the plan.
        retry: whether to repeat the tasks that were set aside.
    """
    chains = []
    for case in plan.cases:
        tasks = store.list_tasks(plan, case)
        for k, task in enumerate(tasks):
            state = read_outcome(task.target, task.key).state
            if state == OPEN or (retry and state == SET_ASIDE):
                if state == SET_ASIDE:
                    shutil.rmtree(task.target)
                chains.append(TaskChain(tuple(tasks[k:])))
            if state != DONE:
                break
    return chains


def run_chains(
    client: Client,
    chains: list[TaskChain],
    report: Callable[[RunProgress], None] = lambda progress: None,
    *,
    timeout: float | None = None,
    death_hint: str = "",
    work: Work = run_task,
) -> RunProgress:
    """Run open tasks on a cluster and return their numbers.

    Args:
        client: client of the cluster.
        chains: the open tasks.
        report: called after each task, and about once a second.
        timeout: time limit of a task, s; None for no limit.
        death_hint: cause of a worker's death, for the reason of a task that is set aside.
        work: function that runs a task in a worker.
    """
    progress = RunProgress(sum(len(chain.tasks) for chain in chains))

    def record(task: FleetTask, outcome: TaskOutcome) -> None:
        progress.finished += 1
        progress.states[outcome.state] += 1
        report(progress)

    engine = TaskEngine(client, work, timeout, death_hint)
    engine.run(chains, record, lambda: report(progress))
    return progress

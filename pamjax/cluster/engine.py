"""Run tasks on Dask distributed: few cases in flight, and worker deaths counted.

The client keeps the queue and submits as many cases as there are worker threads. The scheduler therefore
holds few of them, and a worker that dies loses the task it ran and no other. A worker runs all tasks of a
case without asking the client in between, which halves the overhead of a short task.
"""

from __future__ import annotations

import math
import queue
import secrets
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pamjax.fleet.store import (
    DONE,
    OPEN,
    TaskOutcome,
    read_outcome,
    remove_leftovers,
    store_set_aside,
)
from pamjax.fleet.task import FleetTask

if TYPE_CHECKING:
    from distributed import Client, Future

#: Function that runs a task in a worker; called with the task and the time limit, s.
Work = Callable[[FleetTask, float | None], TaskOutcome]

#: A task whose worker dies, or that is cancelled, so many times is set aside.
_MAX_DEATHS = 2

#: Time between two calls of `on_wait` and two counts of the workers, s.
_WAIT_STEP = 1.0


@dataclass(frozen=True)
class TaskChain:
    """Open tasks of one case, in order, for one worker; a task starts after the one before is done."""

    tasks: tuple[FleetTask, ...]


@dataclass
class _Flight:
    """A submitted chain, and the deaths of the workers that ran its first task."""

    chain: TaskChain
    deaths: int = 0

    @property
    def task(self) -> FleetTask:
        return self.chain.tasks[0]


def run_in_order(work: Work, chain: TaskChain, timeout: float | None) -> list[TaskOutcome]:
    """Run the tasks of a chain in a worker until one is not done, and return their outcomes.

    Args:
        work: function that runs a task.
        chain: the tasks.
        timeout: time limit of each task, s; None for no limit.
    """
    outcomes: list[TaskOutcome] = []
    for task in chain.tasks:
        outcomes.append(work(task, timeout))
        if outcomes[-1].state != DONE:
            break
    return outcomes


class TaskEngine:
    """Runs chains of tasks on a Dask client.

    Args:
        client: client of a Dask cluster.
        work: function that runs a task in a worker; must be importable there.
        timeout: time limit of a task, s; None for no limit.
        death_hint: cause of a worker's death, for the reason of a task that is set aside.
    """

    def __init__(
        self, client: Client, work: Work, timeout: float | None = None, death_hint: str = ""
    ) -> None:
        self.client, self.work, self.timeout, self.death_hint = client, work, timeout, death_hint
        self.flights: dict[str, tuple[Future, _Flight]] = {}
        self.finished: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.counted_at, self.workers, self.submitted = -_WAIT_STEP, 1, 0
        # A scheduler may still hold results of an earlier run under equal keys.
        self.run_name = secrets.token_hex(4)
        self.deaths_per_error = 1 + _read_allowed_failures(client)

    def run(
        self,
        chains: Sequence[TaskChain],
        on_outcome: Callable[[FleetTask, TaskOutcome], None],
        on_wait: Callable[[], None] = lambda: None,
    ) -> None:
        """Run all chains.

        Args:
            chains: the chains, in the order of their start.
            on_outcome: called for each task, when the tasks of its case have ended.
            on_wait: called about once a second.

        Raises:
            OSError: from a task, for example if the disk is full. Other tasks in flight are cancelled.
        """
        waiting = deque(_Flight(chain) for chain in chains if chain.tasks)
        try:
            while waiting or self.flights:
                while waiting and len(self.flights) < self._count_workers():
                    self._submit(waiting.popleft())
                flight, outcomes = self._wait_for_outcomes(on_wait)
                for task, outcome in zip(flight.chain.tasks, outcomes, strict=False):
                    on_outcome(task, outcome)
                if all(outcome.state == DONE for outcome in outcomes):
                    rest = flight.chain.tasks[len(outcomes) :]
                    if rest:
                        waiting.append(_Flight(TaskChain(rest), flight.deaths))
        finally:
            self.client.cancel([future for future, _ in self.flights.values()], force=True)
            self.flights.clear()

    def _submit(self, flight: _Flight) -> None:
        # Two cases with equal files have equal names of their tasks: the number keeps them apart.
        self.submitted += 1
        key = f"pamjax-{flight.task.stage}-{flight.task.key}-{self.run_name}-{self.submitted}"
        words = self.work, flight.chain, self.timeout
        future = self.client.submit(run_in_order, *words, key=key, pure=False)
        self.flights[key] = future, flight
        future.add_done_callback(lambda future: self.finished.put(future.key))

    def _wait_for_outcomes(self, on_wait: Callable[[], None]) -> tuple[_Flight, list[TaskOutcome]]:
        """Return the next finished chain and its outcomes in order; those of a dead worker may be few."""
        while True:
            try:
                key = self.finished.get(timeout=_WAIT_STEP)
            except queue.Empty:
                on_wait()
                continue
            if key in self.flights:
                break
        future, flight = self.flights.pop(key)
        return flight, self._collect(future, flight)

    def _collect(self, future: Future, flight: _Flight) -> list[TaskOutcome]:
        from distributed import KilledWorker

        if future.cancelled():
            deaths, cause = 1, "the scheduler cancelled it"
            # Without its scheduler, a client has no workers to count, and the run ends.
            self.counted_at = -math.inf
        else:
            error: Any = future.exception()
            if error is None:
                return future.result()
            if not isinstance(error, KilledWorker):
                raise error
            deaths, cause = self.deaths_per_error, "its worker process ended"
        outcomes = _read_stored_outcomes(flight.chain)
        if outcomes:
            # These deaths concern the task after those with an outcome.
            flight.deaths = 0
            if outcomes[-1].state != DONE or len(outcomes) == len(flight.chain.tasks):
                return outcomes
        task = flight.chain.tasks[len(outcomes)]
        if not future.cancelled():
            remove_leftovers(task)
        flight.deaths += deaths
        if flight.deaths < _MAX_DEATHS:
            return outcomes
        hint = "" if future.cancelled() else self.death_hint
        return [*outcomes, store_set_aside(task, f"{cause} {flight.deaths} times{hint}")]

    def _count_workers(self) -> int:
        """Return the number of worker threads, at least one: a cluster may start its workers later."""
        if time.monotonic() - self.counted_at >= _WAIT_STEP:
            threads: Any = self.client.nthreads()
            self.workers = max(sum(threads.values()), 1)
            self.counted_at = time.monotonic()
        return self.workers


def _read_stored_outcomes(chain: TaskChain) -> list[TaskOutcome]:
    """Return the outcomes that a dead worker stored before its end, in order.

    A task at its time limit stores its outcome before it ends its worker.
    """
    outcomes = [read_outcome(task.target, task.key) for task in chain.tasks]
    states = [outcome.state for outcome in outcomes]
    return outcomes[: states.index(OPEN)] if OPEN in states else outcomes


def _read_allowed_failures(client: Client) -> int:
    """Return the number of worker deaths of a task after which the scheduler still repeats it."""

    def read_setting(dask_scheduler) -> int:
        return int(dask_scheduler.allowed_failures)

    allowed: Any = client.run_on_scheduler(read_setting)
    return int(allowed)

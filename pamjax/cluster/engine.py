"""Run tasks on Dask distributed: few in flight, worker deaths counted, each outcome reported at once.

The client keeps the queue and submits as many tasks as there are worker threads. The scheduler therefore
holds few tasks, and a worker that dies loses the task it ran and no other.
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
    """Open tasks of one case, in order; a task starts after the one before is done."""

    tasks: tuple[FleetTask, ...]


@dataclass
class _Flight:
    """A submitted task, the rest of its chain, and the deaths of its workers."""

    chain: TaskChain
    deaths: int = 0

    @property
    def task(self) -> FleetTask:
        return self.chain.tasks[0]


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
            on_outcome: called after each task.
            on_wait: called about once a second.

        Raises:
            OSError: from a task, for example if the disk is full. Other tasks in flight are cancelled.
        """
        waiting = deque(_Flight(chain) for chain in chains if chain.tasks)
        try:
            while waiting or self.flights:
                while waiting and len(self.flights) < self._count_workers():
                    self._submit(waiting.popleft())
                flight, outcome = self._wait_for_outcome(on_wait)
                if outcome is None:
                    waiting.append(flight)
                    continue
                on_outcome(flight.task, outcome)
                rest = flight.chain.tasks[1:]
                if rest and outcome.state == DONE:
                    waiting.appendleft(_Flight(TaskChain(rest)))
        finally:
            self.client.cancel([future for future, _ in self.flights.values()], force=True)
            self.flights.clear()

    def _submit(self, flight: _Flight) -> None:
        # Two cases with equal files have equal names of their tasks: the number keeps them apart.
        self.submitted += 1
        key = f"pamjax-{flight.task.stage}-{flight.task.key}-{self.run_name}-{self.submitted}"
        future = self.client.submit(self.work, flight.task, self.timeout, key=key, pure=False)
        self.flights[key] = future, flight
        future.add_done_callback(lambda future: self.finished.put(future.key))

    def _wait_for_outcome(self, on_wait: Callable[[], None]) -> tuple[_Flight, TaskOutcome | None]:
        """Return the next finished task with its outcome, or None if it must run again."""
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

    def _collect(self, future: Future, flight: _Flight) -> TaskOutcome | None:
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
            remove_leftovers(flight.task)
        # A task at its time limit stores its outcome before it ends its worker.
        outcome = read_outcome(flight.task.target, flight.task.key)
        if outcome.state != OPEN:
            return outcome
        flight.deaths += deaths
        if flight.deaths < _MAX_DEATHS:
            return None
        hint = "" if future.cancelled() else self.death_hint
        reason = f"{cause} {flight.deaths} times{hint}"
        return store_set_aside(flight.task, reason)

    def _count_workers(self) -> int:
        """Return the number of worker threads, at least one: a cluster may start its workers later."""
        if time.monotonic() - self.counted_at >= _WAIT_STEP:
            threads: Any = self.client.nthreads()
            self.workers = max(sum(threads.values()), 1)
            self.counted_at = time.monotonic()
        return self.workers


def _read_allowed_failures(client: Client) -> int:
    """Return the number of worker deaths of a task after which the scheduler still repeats it."""

    def read_setting(dask_scheduler) -> int:
        return int(dask_scheduler.allowed_failures)

    allowed: Any = client.run_on_scheduler(read_setting)
    return int(allowed)

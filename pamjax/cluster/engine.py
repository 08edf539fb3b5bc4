"""Run tasks on Dask distributed: few in flight, and worker deaths counted.

The client keeps the queue. Each worker thread gets as many cases as it finishes in about a second. The
scheduler therefore holds few tasks, and short tasks do not wait for client and scheduler. A worker that
dies loses the task it ran and no other: each task stores its own outcome.
"""

from __future__ import annotations

import math
import queue
import secrets
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
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

#: Time after which a worker returns the outcomes of its finished tasks, s.
_REPORT_STEP = 1.0

#: Largest number of cases that a worker gets at once.
_MAX_BATCH = 64


@dataclass(frozen=True)
class TaskChain:
    """Open tasks of one case, in order; a task starts after the one before is done."""

    tasks: tuple[FleetTask, ...]

    def list_rest(self, outcomes: Sequence[TaskOutcome]) -> TaskChain:
        """Return the tasks that can start after these outcomes; a task that is not done ends its chain."""
        ended = any(outcome.state != DONE for outcome in outcomes)
        return TaskChain(() if ended else self.tasks[len(outcomes) :])


def run_in_turn(work: Work, chains: Sequence[TaskChain], timeout: float | None) -> list[list[TaskOutcome]]:
    """Run chains in a worker, and return after the task during which `_REPORT_STEP` ends.

    Args:
        work: function that runs a task.
        chains: the chains, in the order of their start.
        timeout: time limit of each task, s; None for no limit.

    Returns:
        the outcomes of each chain, in the order of its tasks. Tasks that did not start have none.
    """
    end = time.monotonic() + _REPORT_STEP
    outcomes: list[list[TaskOutcome]] = [[] for _ in chains]
    for chain, done in zip(chains, outcomes, strict=True):
        for task in chain.tasks:
            done.append(work(task, timeout))
            if time.monotonic() > end:
                return outcomes
            if done[-1].state != DONE:
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
        self.flights: dict[str, tuple[Future, list[TaskChain]]] = {}
        self.finished: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.counted_at, self.workers, self.submitted = -_WAIT_STEP, 1, 0
        self.batch_size = 1
        #: Deaths of the workers that ran a task, by the folder of the task.
        self.deaths: Counter[Path] = Counter()
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
        waiting = deque(chain for chain in chains if chain.tasks)
        try:
            while waiting or self.flights:
                while waiting and len(self.flights) < self._count_workers():
                    self._submit(self._take_batch(waiting))
                batch, outcomes = self._wait_for_outcomes(on_wait)
                for chain, done in zip(batch, outcomes, strict=True):
                    for task, outcome in zip(chain.tasks, done, strict=False):
                        on_outcome(task, outcome)
                rest = [chain.list_rest(done) for chain, done in zip(batch, outcomes, strict=True)]
                waiting.extendleft(reversed([chain for chain in rest if chain.tasks]))
        finally:
            self.client.cancel([future for future, _ in self.flights.values()], force=True)
            self.flights.clear()

    def _take_batch(self, waiting: deque[TaskChain]) -> list[TaskChain]:
        """Remove the next cases from the queue; a case that killed a worker runs alone."""
        # The last cases are shared by all workers.
        size = min(self.batch_size, math.ceil(len(waiting) / self.workers))
        batch = [waiting.popleft()]
        while len(batch) < size and not any(self._count_deaths(chain) for chain in (batch[0], waiting[0])):
            batch.append(waiting.popleft())
        return batch

    def _count_deaths(self, chain: TaskChain) -> int:
        return self.deaths[chain.tasks[0].target]

    def _submit(self, batch: list[TaskChain]) -> None:
        # Two cases with equal files have equal names of their tasks: the number keeps them apart.
        self.submitted += 1
        task = batch[0].tasks[0]
        key = f"pamjax-{task.stage}-{task.key}-{self.run_name}-{self.submitted}"
        future = self.client.submit(run_in_turn, self.work, batch, self.timeout, key=key, pure=False)
        self.flights[key] = future, batch
        future.add_done_callback(lambda future: self.finished.put(future.key))

    def _wait_for_outcomes(
        self, on_wait: Callable[[], None]
    ) -> tuple[list[TaskChain], list[list[TaskOutcome]]]:
        """Return the next cases that a worker returned or lost, with the outcomes of each case."""
        while True:
            try:
                key = self.finished.get(timeout=_WAIT_STEP)
            except queue.Empty:
                on_wait()
                continue
            if key in self.flights:
                break
        future, batch = self.flights.pop(key)
        return batch, self._collect(future, batch)

    def _collect(self, future: Future, batch: list[TaskChain]) -> list[list[TaskOutcome]]:
        from distributed import KilledWorker

        if future.cancelled():
            # Without its scheduler, a client has no workers to count, and the run ends.
            self.counted_at = -math.inf
            return self._collect_stored(batch, 1, "the scheduler cancelled it {} times")
        error: Any = future.exception()
        if isinstance(error, KilledWorker):
            for task in (task for chain in batch for task in chain.tasks):
                remove_leftovers(task)
            reason = "its worker process ended {} times" + self.death_hint
            return self._collect_stored(batch, self.deaths_per_error, reason)
        if error is not None:
            raise error
        outcomes = future.result()
        self._adapt_batch_size(outcomes)
        return outcomes

    def _adapt_batch_size(self, outcomes: list[list[TaskOutcome]]) -> None:
        """Set the number of cases that a worker finishes in about `_REPORT_STEP`."""
        seconds = sum(outcome.seconds for done in outcomes for outcome in done)
        cases = sum(bool(done) for done in outcomes)
        fitting = math.inf if seconds == 0 else cases * _REPORT_STEP / seconds
        # One fast batch does not predict the next one: the number grows by a factor of two at most.
        self.batch_size = max(1, int(min(fitting, 2 * self.batch_size, _MAX_BATCH)))

    def _collect_stored(self, batch: list[TaskChain], deaths: int, reason: str) -> list[list[TaskOutcome]]:
        """Return the outcomes that a lost worker stored, and set its last task aside after enough deaths.

        Args:
            batch: the cases of the worker.
            deaths: number of deaths that the loss stands for.
            reason: reason of a task that is set aside, with a place for its number of deaths.
        """
        outcomes = [_read_stored_outcomes(chain) for chain in batch]
        for chain, done in zip(batch, outcomes, strict=True):
            rest = chain.list_rest(done).tasks
            if rest:
                # The worker ran the tasks in turn: the first one without an outcome was in flight.
                task = rest[0]
                self.deaths[task.target] += deaths
                if self.deaths[task.target] >= _MAX_DEATHS:
                    count = str(self.deaths[task.target])
                    done.append(store_set_aside(task, reason.replace("{}", count)))
                break
        return outcomes

    def _count_workers(self) -> int:
        """Return the number of worker threads, at least one: a cluster may start its workers later."""
        if time.monotonic() - self.counted_at >= _WAIT_STEP:
            threads: Any = self.client.nthreads()
            self.workers = max(sum(threads.values()), 1)
            self.counted_at = time.monotonic()
        return self.workers


def _read_stored_outcomes(chain: TaskChain) -> list[TaskOutcome]:
    """Return the stored outcomes of the first tasks of a chain."""
    outcomes: list[TaskOutcome] = []
    for task in chain.tasks:
        outcome = read_outcome(task.target, task.key)
        if outcome.state == OPEN:
            break
        outcomes.append(outcome)
    return outcomes


def _read_allowed_failures(client: Client) -> int:
    """Return the number of worker deaths of a task after which the scheduler still repeats it."""

    def read_setting(dask_scheduler) -> int:
        return int(dask_scheduler.allowed_failures)

    allowed: Any = client.run_on_scheduler(read_setting)
    return int(allowed)

"""Tasks that the scheduler cancels, and a time limit that ends while a stage writes."""

import math
from types import SimpleNamespace

import pytest

pytest.importorskip("distributed", reason="needs the extra pamjax[fleet]")

from pamjax.cluster.engine import TaskChain, TaskEngine
from pamjax.fleet.store import (
    TaskOutcome,
    open_stage_folder,
    read_outcome,
    remove_leftovers,
    store_set_aside,
    write_outcome,
)
from pamjax.fleet.task import FleetTask


@pytest.fixture
def task(tmp_path):
    return FleetTask("12", "a", tmp_path, tmp_path / "out" / "a" / "fit", "fit", "0", {})


class CancellingClient:
    """A client whose scheduler cancels each task at once; it has no scheduler after `loss` tasks."""

    def __init__(self, loss=math.inf):
        self.submitted, self.loss = 0, loss

    def run_on_scheduler(self, function):
        return 0

    def nthreads(self):
        if self.submitted >= self.loss:
            raise OSError("no scheduler")
        return {"worker": 1}

    def submit(self, function, work, batch, timeout, *, key, pure):
        self.submitted += 1
        assert self.submitted < 10
        future = SimpleNamespace(key=key, cancelled=lambda: True)
        future.add_done_callback = lambda function: function(future)
        return future

    def cancel(self, futures, force):
        pass


def test_task_that_is_cancelled_twice_is_set_aside(task):
    outcomes, client = [], CancellingClient()
    TaskEngine(client, print, death_hint=" (killed)").run(
        [TaskChain((task,))], lambda task, outcome: outcomes.append(outcome)
    )
    assert client.submitted == 2
    assert [(outcome.state, outcome.reason) for outcome in outcomes] == [
        ("set aside", "the scheduler cancelled it 2 times")
    ]


def test_run_without_its_scheduler_ends_and_sets_nothing_aside(task):
    with pytest.raises(OSError, match="no scheduler"):
        TaskEngine(CancellingClient(loss=1), print).run([TaskChain((task,))], lambda *_: None)
    assert not task.target.exists()


def test_time_limit_leaves_the_files_that_a_stage_writes(task):
    """The folder of a running stage stays until its process ends."""
    with open_stage_folder(task) as folder:
        store_set_aside(task, "too slow")
        (folder / "fit.json").write_text("{}")
        write_outcome(folder, task, TaskOutcome(task.key, "done"))
    assert read_outcome(task.target, task.key).state == "done"
    assert [path.name for path in task.target.parent.iterdir()] == ["fit"]


def test_leftovers_of_a_killed_process_are_removed(task):
    task.target.mkdir(parents=True)
    (task.target.parent / ".fit-left").mkdir()
    (task.target.parent / ".check-other").mkdir()
    remove_leftovers(task)
    assert sorted(path.name for path in task.target.parent.iterdir()) == [".check-other", "fit"]

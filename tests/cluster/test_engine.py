"""The engine on a real cluster: a case that kills its worker, a time limit, and a full disk."""

import errno
import threading
import time

import pytest

pytest.importorskip("distributed", reason="needs the extra pamjax[fleet]")

import pamjax.cluster.engine
from pamjax.cluster.connect import start_cluster
from pamjax.cluster.engine import TaskChain, TaskEngine, run_in_turn
from pamjax.fleet.store import TaskOutcome, read_outcome
from pamjax.fleet.task import FleetTask
from tests.cluster import works

pytestmark = pytest.mark.slow

NAMES = ("a", "b", "poison", "c", "d")


@pytest.fixture(scope="module")
def client():
    with start_cluster(2, "1 GB") as client:
        yield client


@pytest.fixture
def chains(tmp_path):
    """Return one chain of two tasks for each case; the inputs of two cases are equal."""

    def build(name, stage):
        (tmp_path / name).mkdir(exist_ok=True)
        key = f"{name if name != 'b' else 'a'}-{stage}"
        return FleetTask(key, name, tmp_path / name, tmp_path / "out" / name / stage, stage, "0", {})

    return [TaskChain((build(name, "check"), build(name, "fit"))) for name in NAMES]


def run(client, chains, work, batch_size=1, **entries):
    outcomes = {}

    def record(task, outcome):
        assert (task.case, task.stage) not in outcomes
        outcomes[task.case, task.stage] = outcome

    engine = TaskEngine(client, work, **entries)
    engine.batch_size = batch_size
    engine.run(chains, record)
    return outcomes


def list_states(outcomes, name):
    return [outcome.state for (case, _), outcome in outcomes.items() if case == name]


def test_every_task_runs_once_in_the_order_of_its_case(client, chains):
    outcomes = run(client, chains, works.finish)
    assert sorted(outcomes) == sorted((name, stage) for name in NAMES for stage in ("check", "fit"))
    assert {outcome.state for outcome in outcomes.values()} == {"done"}
    for name in NAMES:
        stages = [stage for case, stage in outcomes if case == name]
        assert stages == ["check", "fit"]
    processes = {chain.tasks[0].target.joinpath("process.txt").read_text() for chain in chains}
    assert 1 <= len(processes) <= 2


def test_refused_stage_ends_its_case(client, chains):
    outcomes = run(client, chains, works.refuse_first)
    assert list_states(outcomes, "poison") == ["refused"]
    assert list_states(outcomes, "d") == ["done", "done"]


def test_case_that_kills_its_worker_twice_is_set_aside(client, chains):
    outcomes = run(client, chains, works.kill_worker, death_hint=" (killed)")
    assert list_states(outcomes, "poison") == ["set aside"]
    assert outcomes["poison", "check"].reason == "its worker process ended 2 times (killed)"
    assert chains[2].tasks[0].folder.joinpath("deaths.txt").read_text() == "xx"
    assert all(list_states(outcomes, name) == ["done", "done"] for name in NAMES if name != "poison")
    task = chains[2].tasks[0]
    assert read_outcome(task.target, task.key).state == "set aside"


def test_death_in_a_batch_concerns_one_case(client, chains):
    """Three cases are in the first batch: one is done, one kills its worker, and one has not started."""
    chains = [chains[0], chains[2], chains[1], *chains[3:]]
    outcomes = run(client, chains, works.kill_worker, batch_size=3)
    assert list_states(outcomes, "poison") == ["set aside"]
    assert chains[1].tasks[0].folder.joinpath("deaths.txt").read_text() == "xx"
    assert all(list_states(outcomes, name) == ["done", "done"] for name in "abcd")


def test_cases_of_a_batch_have_tasks_of_a_second_together(client, chains):
    engine = TaskEngine(client, works.finish)
    outcome = TaskOutcome("k", "done", seconds=0.1)
    engine.batch_size = 4
    engine._adapt_batch_size([[outcome, outcome], [outcome, outcome], []])
    assert engine.batch_size == 5
    engine._adapt_batch_size([[TaskOutcome("k", "done", seconds=30.0)], []])
    assert engine.batch_size == 1
    engine._adapt_batch_size([[TaskOutcome("k", "done", seconds=0.0)]])
    assert engine.batch_size == 2


def test_worker_returns_after_the_time_of_a_report(chains, monkeypatch):
    assert [len(done) for done in run_in_turn(works.finish, chains[:2], None)] == [2, 2]
    monkeypatch.setattr(pamjax.cluster.engine, "_REPORT_STEP", -1.0)
    assert [len(done) for done in run_in_turn(works.finish, chains[:2], None)] == [1, 0]


def test_case_that_kills_its_worker_once_is_repeated(client, chains):
    outcomes = run(client, chains, works.kill_worker_once)
    assert all(list_states(outcomes, name) == ["done", "done"] for name in NAMES)


def test_task_above_its_time_limit_is_set_aside(client, chains):
    begin = time.monotonic()
    outcomes = run(client, chains, works.exceed_time, timeout=0.5)
    assert time.monotonic() - begin < 40
    assert list_states(outcomes, "poison") == ["set aside"]
    assert outcomes["poison", "check"].reason == "it took longer than the time limit of 0.5 s"
    assert list_states(outcomes, "c") == ["done", "done"]


def test_full_disk_ends_the_run(client, chains):
    with pytest.raises(OSError, match="No space left") as error:
        run(client, chains, works.fill_disk)
    assert error.value.errno == errno.ENOSPC
    # The client is still usable.
    assert run(client, chains[:1], works.finish)


def test_interruption_cancels_the_tasks_in_flight(client, chains):
    def interrupt():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        TaskEngine(client, works.exceed_time).run(chains[2:3], lambda *_: None, interrupt)


def test_outcomes_are_reported_in_the_thread_of_the_caller(client, chains):
    threads = set()
    TaskEngine(client, works.finish).run(chains, lambda *_: threads.add(threading.current_thread()))
    assert threads == {threading.main_thread()}
    assert TaskOutcome("k", "done").reason == ""

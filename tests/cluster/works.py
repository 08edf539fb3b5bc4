"""Functions that run in worker processes in place of a stage: done, killed, slow, or with a full disk."""

import errno
import os
import signal
import time
from pathlib import Path

from pamjax.cluster.run_task import limit_time
from pamjax.fleet.store import TaskOutcome, open_stage_folder, write_outcome


def finish(task, timeout=None):
    """Write one file with the name of the process."""
    with open_stage_folder(task) as folder:
        (folder / "process.txt").write_text(str(os.getpid()))
        outcome = TaskOutcome(task.key, "done")
        write_outcome(folder, task, outcome)
    return outcome


def kill_worker(task, timeout=None):
    """Kill the worker of the case "poison", and count its deaths; finish the others."""
    if task.case == "poison":
        with open(task.folder / "deaths.txt", "a") as file:
            file.write("x")
        os.kill(os.getpid(), signal.SIGKILL)
    return finish(task)


def kill_worker_once(task, timeout=None):
    """Kill the worker of the case "poison" at its first run."""
    if task.case == "poison" and not (task.folder / "deaths.txt").exists():
        return kill_worker(task)
    return finish(task)


def exceed_time(task, timeout=None):
    """Sleep longer than the time limit in the case "poison"."""
    with limit_time(task, timeout):
        time.sleep(4 if task.case == "poison" else 0)
        return finish(task)


def fill_disk(task, timeout=None):
    """Raise the error of a full disk."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(Path("disk")))


def refuse_first(task, timeout=None):
    """Refuse the first stage of the case "poison"."""
    state = "refused" if task.case == "poison" else "done"
    return TaskOutcome(task.key, state)

"""The store of a fleet: a folder with the results of each case.

    fleet.json                  cases, settings and versions of the last run
    model.json                  model that `validate` tests
    cases/NAME/STAGE/           files of `pamjax check`, `fit`, `sample`, `diagnose` or `validate`
    cases/NAME/STAGE/task.json  name and outcome of the task
    cases/NAME/STAGE/time.json  computing time; the only file that differs between equal runs
    tables/                     the same results as Parquet tables

A folder of a stage appears in one step, complete. A task is done if its folder has its name.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from pamjax.errors import BadInput
from pamjax.fleet.plan import FleetCase, FleetPlan
from pamjax.fleet.task import FleetTask, build_task, collect_task_versions, describe_task
from pamjax.records.files import write_atomically

_FLEET_SCHEMA = "pamjax.fleet/1"
_FLEET_FILE, _TASK_FILE, _TIME_FILE, ERROR_FILE = "fleet.json", "task.json", "time.json", "error.txt"
#: Copy of the model that the stage validate tests, for the workers.
_MODEL_FILE = "model.json"
#: File that a running fleet locks.
LOCK_FILE = ".lock"

#: A stage and the thread of its time limit may both replace the folder of a task.
_RENAME_LOCK = threading.Lock()

#: States of a task: complete, input refused, set aside after an unexpected end, and without an outcome.
STATES = DONE, REFUSED, SET_ASIDE, OPEN = "done", "refused", "set aside", "open"


@dataclass(frozen=True)
class TaskOutcome:
    """Outcome of a task.

    Attributes:
        key: name of the task.
        state: "done", "refused" or "set aside"; "open" if it has no outcome.
        reason: why it is not done, one sentence.
        seconds: computing time, s.
    """

    key: str
    state: str
    reason: str = ""
    seconds: float = 0.0


class FleetStore:
    """Folder of a fleet's results.

    Args:
        folder: path of the folder; need not exist.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(os.path.abspath(folder))

    def locate_stage(self, case: str, stage: str) -> Path:
        """Return the folder of a stage of a case."""
        return self.folder / "cases" / case / stage

    def list_tasks(self, plan: FleetPlan, case: FleetCase) -> list[FleetTask]:
        """Return the tasks of a case in their order."""
        model = self.folder / _MODEL_FILE
        return [
            build_task(plan, case, stage, self.locate_stage(case.name, stage), model) for stage in plan.stages
        ]

    def prepare(self) -> None:
        """Create the folder if it does not exist; change no file of a store.

        Raises:
            BadInput: if the folder has other files and is no store.
        """
        # A run that has locked an empty folder may not have written its plan yet.
        if self.folder.is_dir() and any(path.name != LOCK_FILE for path in self.folder.iterdir()):
            read_store_document(self.folder)
        self.folder.mkdir(parents=True, exist_ok=True)

    def write_plan(self, plan: FleetPlan) -> None:
        """Write fleet.json and the tested model to a prepared folder that no other run has locked."""
        if plan.model is not None:
            with write_atomically(self.folder / _MODEL_FILE) as temporary:
                temporary.write_bytes(plan.model.content)
        document = {
            "schema": _FLEET_SCHEMA,
            "name": plan.name,
            "folder": str(plan.folder),
            "stages": list(plan.stages),
            "settings": {
                "seed": plan.seed,
                "figures": plan.figures,
                "report": plan.report,
                **_serialise_tables(plan),
            },
            "versions": collect_task_versions(),
            "cases": [_serialise_case(self, plan, case) for case in plan.cases],
        }
        with write_atomically(self.folder / _FLEET_FILE) as temporary:
            temporary.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", "utf-8")


def read_store_document(folder: Path) -> dict[str, Any]:
    """Return the contents of fleet.json.

    Raises:
        BadInput: if the folder is no store, of another version, or has names that lead out of it.
    """
    rule = f"the store of a fleet must be a folder with {_FLEET_FILE}"
    remedy = "Name the folder that `pamjax fleet` wrote, or an empty one for a new fleet."
    try:
        document = json.loads((folder / _FLEET_FILE).read_text("utf-8"))
    except FileNotFoundError as error:
        raise BadInput.from_rule(rule, f"{folder}, which has none", remedy=remedy) from error
    except (OSError, ValueError) as error:
        raise BadInput.from_rule(f"{folder / _FLEET_FILE} must be readable JSON", remedy=remedy) from error
    if not isinstance(document, dict) or document.get("schema") != _FLEET_SCHEMA:
        schema = document.get("schema") if isinstance(document, dict) else None
        raise BadInput.from_rule(
            f"{folder / _FLEET_FILE} must have the schema {_FLEET_SCHEMA}", repr(schema), remedy=remedy
        )
    _check_case_names(document, folder / _FLEET_FILE)
    return document


def _check_case_names(document: dict[str, Any], file: Path) -> None:
    """Refuse a list of cases whose names lead out of the store, which another program may have written."""
    try:
        names = [name for entry in document["cases"] for name in (entry["name"], *entry["tasks"].keys())]
        paths = [PurePosixPath(name) for name in names]
    except (AttributeError, KeyError, TypeError) as error:
        remedy = "Run `pamjax fleet` again."
        raise BadInput.from_rule(
            f"{file} must list the cases with their names and tasks", remedy=remedy
        ) from error
    for path in paths:
        if path.is_absolute() or ".." in path.parts:
            rule = "the names of cases and stages must lead into the store"
            raise BadInput.from_rule(
                rule, repr(str(path)), str(file), "Use a store that `pamjax fleet` wrote."
            )


def read_outcome(folder: Path, key: str) -> TaskOutcome:
    """Return the outcome of a task in its folder; "open" if the folder has none of this name."""
    document = read_json(folder / _TASK_FILE)
    if document.get("key") != key or document.get("state") not in (DONE, REFUSED, SET_ASIDE):
        return TaskOutcome(key, OPEN)
    seconds = read_json(folder / _TIME_FILE).get("seconds", 0.0)
    return TaskOutcome(key, document["state"], document.get("reason", ""), seconds)


def read_json(file: Path) -> dict[str, Any]:
    """Return a JSON document; empty if the file does not exist or is no such document."""
    with suppress(OSError, ValueError):
        document = json.loads(file.read_text("utf-8"))
        return document if isinstance(document, dict) else {}
    return {}


@contextmanager
def open_stage_folder(task: FleetTask) -> Iterator[Path]:
    """Yield a temporary folder that replaces the task's folder at the end, complete.

    After an exception, the former folder is unchanged.
    """
    task.target.parent.mkdir(parents=True, exist_ok=True)
    temporary = task.target.with_name(f".{task.target.name}-{secrets.token_hex(4)}")
    temporary.mkdir()
    try:
        yield temporary
        former = task.target.with_name(f".{task.target.name}-former-{secrets.token_hex(4)}")
        with _RENAME_LOCK:
            with suppress(FileNotFoundError):
                os.rename(task.target, former)
            # A process that is killed here leaves no folder, and the task runs again.
            os.rename(temporary, task.target)
        shutil.rmtree(former, ignore_errors=True)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def remove_leftovers(task: FleetTask) -> None:
    """Remove the temporary folders of a task whose process ended; no process may still run the task."""
    for leftover in task.target.parent.glob(f".{task.target.name}-*"):
        shutil.rmtree(leftover, ignore_errors=True)


def write_outcome(folder: Path, task: FleetTask, outcome: TaskOutcome) -> None:
    """Write task.json and time.json of an outcome."""
    document = describe_task(task) | {"state": outcome.state, "reason": outcome.reason}
    texts = {
        _TASK_FILE: json.dumps(document, indent=1, sort_keys=True, ensure_ascii=False) + "\n",
        _TIME_FILE: json.dumps({"seconds": round(outcome.seconds, 3)}) + "\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text, "utf-8")


def store_set_aside(task: FleetTask, reason: str, seconds: float = 0.0) -> TaskOutcome:
    """Write the outcome of a task that ended unexpectedly, and return it."""
    outcome = TaskOutcome(task.key, SET_ASIDE, reason, seconds)
    with open_stage_folder(task) as folder:
        write_outcome(folder, task, outcome)
    return outcome


def _serialise_tables(plan: FleetPlan) -> dict[str, Any]:
    """Return the options of the stages that run."""
    tables: dict[str, Any] = {"fit": plan.fit.model_dump()}
    if "sample" in plan.stages:
        tables["sample"] = plan.sample.model_dump()
    if plan.model is not None:
        model = plan.model
        tables["validate"] = {"model": model.file.name, "case": model.case, "checksum": model.checksum}
    return tables


def _serialise_case(store: FleetStore, plan: FleetPlan, case: FleetCase) -> dict[str, Any]:
    origin = asdict(case.specimen)
    return {
        "name": case.name,
        "folder": str(case.folder),
        **origin,
        "date": None if origin["date"] is None else origin["date"].isoformat(),
        "checksum": case.checksum,
        "tasks": {task.stage: task.key for task in store.list_tasks(plan, case)},
    }

"""Tasks of a fleet: each is named by the checksum of its inputs, versions and settings."""

from __future__ import annotations

import hashlib
import json
import platform
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pamjax
from pamjax.fleet.plan import FleetCase, FleetPlan

#: Packages whose versions are part of a task's name, besides Python's.
_SAMPLER_PACKAGES = {"emcee": "emcee", "nuts": "blackjax"}
_NUMERIC_PACKAGES = ("pamjax", "jax", "jaxlib", "numpy", "scipy", "optimistix")


@dataclass(frozen=True)
class FleetTask:
    """One stage of one case.

    Attributes:
        key: SHA-256 of inputs, versions and settings, hexadecimal.
        case: name of the case.
        folder: case folder.
        target: folder of the results.
        stage: command to run.
        checksum: SHA-256 of the inputs.
        settings: settings of the stage.
        model: copy of the model that the stage validate tests, in the store.
    """

    key: str
    case: str
    folder: Path
    target: Path
    stage: str
    checksum: str
    settings: dict[str, Any]
    model: Path | None = None


def build_task(
    plan: FleetPlan, case: FleetCase, stage: str, target: Path, model: Path | None = None
) -> FleetTask:
    """Return the task of a stage of a case.

    Args:
        plan: the plan.
        case: the case.
        stage: command to run.
        target: folder of the results.
        model: file of the model that the stage validate tests.

    >>> from pamjax.records.reading.specimen import Specimen
    >>> case = FleetCase("a", Path("a"), Specimen(), "12")
    >>> plan = FleetPlan("f", Path(), (case,), ("check",))
    >>> task = build_task(plan, case, "check", Path("out"))
    >>> task.key == build_task(plan, case, "check", Path("elsewhere")).key
    True
    """
    settings = _list_settings(plan, stage)
    name = {
        "stage": stage,
        "inputs": case.checksum,
        "settings": settings,
        "versions": _list_versions(settings),
    }
    key = hashlib.sha256(json.dumps(name, sort_keys=True).encode()).hexdigest()
    model = model if stage == "validate" else None
    return FleetTask(key, case.name, case.folder, target, stage, case.checksum, settings, model)


def _list_versions(settings: dict[str, Any]) -> dict[str, str]:
    """Return the versions of a stage: those of all stages, and of its sampler."""
    package = _SAMPLER_PACKAGES.get(settings.get("sampler", ""))
    return collect_task_versions() | ({package: version(package)} if package else {})


def _list_settings(plan: FleetPlan, stage: str) -> dict[str, Any]:
    """Return the settings that a stage uses."""
    fit = plan.fit.model_dump()
    if stage == "check":
        return {"law": fit["law"]}
    if stage == "validate":
        assert plan.model is not None
        return {"checksum": plan.model.checksum, "case": plan.model.case}
    files = {"seed": plan.seed, "report": plan.report}
    if stage == "diagnose":
        return files
    files["figures"] = plan.figures
    if stage == "sample":
        return files | {name: fit[name] for name in ("law", "mechanisms")} | plan.sample.model_dump()
    return files | fit


@cache
def collect_task_versions() -> dict[str, str]:
    """Return the versions of Python and of the numeric packages, and the SHA-256 of pamjax's sources."""
    sources, root = hashlib.sha256(), Path(pamjax.__file__).parent
    for source in sorted(root.rglob("*.py")):
        sources.update(source.relative_to(root).as_posix().encode() + b"\0" + source.read_bytes())
    versions = {package: version(package) for package in _NUMERIC_PACKAGES}
    return versions | {"python": platform.python_version(), "sources": sources.hexdigest()}


def describe_task(task: FleetTask) -> dict[str, Any]:
    """Return the task as a JSON document, without the paths of this machine."""
    entries = asdict(task) | {"versions": _list_versions(task.settings)}
    return {name: value for name, value in entries.items() if name not in ("folder", "target", "model")}

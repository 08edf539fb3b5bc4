"""Cases and settings of a fleet, from FLEET.toml, folders and patterns."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from pathlib import Path, PurePosixPath
from typing import Any

from pamjax.errors import BadInput
from pamjax.fleet.schema import (
    STAGES,
    FitTable,
    FleetDocument,
    GroupTable,
    SampleTable,
    ValidateTable,
    read_fleet_document,
)
from pamjax.records.case import MUSCLE_FILE, RECORDING_FILE
from pamjax.records.files import read_bytes
from pamjax.records.reading.specimen import Specimen, read_date, read_label
from pamjax.records.toml_text import parse_toml

#: Characters of a pattern.
_WILDCARDS = "*?["


@dataclass(frozen=True)
class FleetCase:
    """One case of a fleet.

    Attributes:
        name: path relative to the folder of the fleet, with "/"; unique in the fleet.
        folder: absolute path.
        specimen: origin of the recording.
        checksum: SHA-256 of recording.csv followed by muscle.toml, as `Case.checksum`.
    """

    name: str
    folder: Path
    specimen: Specimen
    checksum: str


@dataclass(frozen=True)
class ReferenceModel:
    """Model that the stage validate tests on every case.

    Attributes:
        file: path of a model.json or fit.json.
        case: name of the case, if the file has several.
        content: bytes of the file.
    """

    file: Path
    case: str | None
    content: bytes = field(repr=False)

    @property
    def checksum(self) -> str:
        """Return the SHA-256 of the file."""
        return hashlib.sha256(self.content).hexdigest()


@dataclass(frozen=True)
class FleetPlan:
    """Cases of a fleet and the settings of their tasks.

    Attributes:
        name: name of the fleet.
        folder: absolute path of the folder that contains all cases.
        cases: in the order of their names.
        stages: commands to run for each case, in order.
        seed, figures, report, fit, sample: settings, as in FLEET.toml.
        model: the model that the stage validate tests; None without this stage.
    """

    name: str
    folder: Path
    cases: tuple[FleetCase, ...]
    stages: tuple[str, ...]
    seed: int = 0
    figures: bool = True
    report: bool = True
    fit: FitTable = field(default_factory=FitTable)
    sample: SampleTable = field(default_factory=SampleTable)
    model: ReferenceModel | None = None


def read_plan(
    sources: Sequence[Path],
    *,
    stages: Sequence[str] | None = None,
    seed: int | None = None,
    figures: bool | None = None,
    report: bool | None = None,
    model: Path | None = None,
) -> FleetPlan:
    """Return the plan of a FLEET.toml, of a folder of cases, or of case folders and patterns.

    Args:
        sources: one FLEET.toml, or folders and patterns.
        stages, seed, figures, report, model: settings that replace those of the file; None keeps a setting.

    Raises:
        BadInput: for a wrong file, a path that does not exist, no case folder, or a stage validate without
            a model.
    """
    stated = {"stages": stages, "seed": seed, "figures": figures, "report": report, "model": model}
    changes = {name: value for name, value in stated.items() if value is not None}
    if len(sources) == 1 and sources[0].suffix == ".toml" and not sources[0].is_dir():
        file = sources[0]
        document = read_fleet_document(read_bytes(file), file.name)
        folder = Path(os.path.abspath(file.parent / document.folder))
        if not folder.is_dir():
            raise BadInput.from_rule("`folder` must be a folder", f"{folder}", file.name, "Check the path.")
        case_folders = _find_by_patterns(folder, document.cases, file.name)
        named = document if document.name else document.model_copy(update={"name": file.stem})
        return _build_plan(named, folder, case_folders, file, changes)
    folder, case_folders = _find_by_paths(sources)
    return _build_plan(FleetDocument(name=folder.name), folder, case_folders, None, changes)


def _build_plan(
    document: FleetDocument,
    folder: Path,
    case_folders: Iterable[Path],
    file: Path | None,
    changes: dict[str, Any],
) -> FleetPlan:
    """Return the plan of a document.

    Args:
        document: entries of FLEET.toml, or the defaults with a name.
        folder: folder of the cases.
        case_folders: the case folders.
        file: path of FLEET.toml; None without one.
        changes: settings that replace those of the document.
    """
    place, file_name = (file.parent, file.name) if file else (Path(), "")
    origins = _assign_groups(folder, document.groups, file_name)
    case_folders = sorted(set(case_folders))
    _check_apart(case_folders)
    cases = [_build_case(case_folder, folder, origins) for case_folder in case_folders]
    wanted = changes.get("stages") or document.stages
    settings = {key: changes.get(key, getattr(document, key)) for key in ("seed", "figures", "report")}
    stated = document.validate_
    if "model" in changes:
        if "validate" not in wanted:
            remedy = "Add it to `--stage`."
            raise BadInput.from_rule("`--model` needs the stage validate", remedy=remedy)
        case = stated.case if stated else None
        stated = ValidateTable(model=os.path.abspath(changes["model"]), case=case)
    return FleetPlan(
        name=document.name,
        folder=folder,
        cases=tuple(sorted(cases, key=lambda case: case.name)),
        stages=tuple(stage for stage in STAGES if stage in wanted),
        fit=document.fit,
        sample=document.sample,
        model=_find_model(stated, place, file_name) if "validate" in wanted else None,
        **settings,
    )


def _find_model(stated: ValidateTable | None, place: Path, file: str) -> ReferenceModel:
    """Return the model of the stage validate, from a path relative to FLEET.toml."""
    if stated is None:
        remedy = "State `model` in [validate] of FLEET.toml, or name it with `--model`."
        raise BadInput.from_rule("the stage validate needs a model.json or fit.json", "", file, remedy)
    path = place / stated.model
    if path.suffix != ".json" or "\0" in stated.model:
        rule = "`model` must be the path of a model.json or fit.json"
        raise BadInput.from_rule(rule, repr(stated.model), file, "A fit or a diagnosis writes it.")
    return ReferenceModel(path, stated.case, read_bytes(path))


def _check_apart(case_folders: Sequence[Path]) -> None:
    """Refuse a case folder inside another one."""
    known = set(case_folders)
    for case_folder in case_folders:
        outer = next((parent for parent in case_folder.parents if parent in known), None)
        if outer is not None:
            got = f"{case_folder} inside {outer}"
            raise BadInput.from_rule(
                "case folders must be apart", got, remedy="Move one, or list the cases by patterns."
            )


def _build_case(case_folder: Path, folder: Path, origins: dict[Path, Specimen]) -> FleetCase:
    name = case_folder.relative_to(folder).as_posix()
    contents = [_read_if_present(case_folder / file) for file in (RECORDING_FILE, MUSCLE_FILE)]
    return FleetCase(
        name=case_folder.name if name == "." else name,
        folder=case_folder,
        specimen=_read_origin(contents[1]).update(origins.get(case_folder, Specimen())),
        checksum=hashlib.sha256(contents[0] + contents[1]).hexdigest(),
    )


def _read_if_present(file: Path) -> bytes:
    """Return the bytes of a file; the task of the case reports a missing one."""
    with suppress(BadInput):
        return read_bytes(file)
    return b""


def _read_origin(muscle: bytes) -> Specimen:
    """Return [specimen] of a muscle.toml; its type is the name of the muscle if none is stated.

    Wrong entries are left out here; the task of the case reports them.
    """
    tables: dict[str, Any] = {}
    with suppress(BadInput):
        tables = parse_toml(muscle, MUSCLE_FILE)
    stated, muscle_table = tables.get("specimen"), tables.get("muscle")
    known, entries = {entry.name for entry in fields(Specimen)}, {}
    for key, raw in (stated if isinstance(stated, dict) else {}).items():
        with suppress(BadInput):
            if key in known:
                entries[key] = read_date(raw) if key == "date" else read_label(raw)
    if not entries.get("type") and isinstance(muscle_table, dict):
        with suppress(BadInput):
            entries["type"] = read_label(muscle_table.get("name"))
    return Specimen(**entries)


def _assign_groups(folder: Path, groups: Sequence[GroupTable], file: str) -> dict[Path, Specimen]:
    """Return what [[groups]] states of each case folder; a later group replaces an earlier one."""
    origins: dict[Path, Specimen] = {}
    for group in groups:
        for case_folder in _find_by_patterns(folder, group.cases, f"[[groups]] of {file}"):
            origins[case_folder] = origins.get(case_folder, Specimen()).update(group.specimen)
    return origins


def _is_case_folder(folder: Path) -> bool:
    """Return whether a folder has at least one of the two files of a case."""
    return (folder / RECORDING_FILE).is_file() or (folder / MUSCLE_FILE).is_file()


def _find_by_patterns(folder: Path, patterns: Sequence[str], where: str) -> list[Path]:
    """Return the case folders of patterns inside a folder.

    Raises:
        BadInput: if a pattern leads out of the folder, or matches no case folder.
    """
    case_folders: list[Path] = []
    for pattern in patterns:
        parts = PurePosixPath(pattern).parts
        if not parts or ".." in parts or PurePosixPath(pattern).is_absolute():
            remedy = "Write it relative to `folder`, or change `folder`."
            raise BadInput.from_rule(
                "a pattern of `cases` must lead into the folder", f"{pattern!r}", where, remedy
            )
        try:
            paths = list(folder.glob(pattern))
        except ValueError as error:
            remedy = "Write `**` between slashes, as `north/**`."
            raise BadInput.from_rule(
                "`**` must be a whole part of a pattern", f"{pattern!r}", where, remedy
            ) from error
        matches = [path for path in paths if _is_case_folder(path) and not _is_hidden(path, folder)]
        if not matches:
            rule = f"no folder with {RECORDING_FILE} matches {pattern!r}"
            raise BadInput.from_rule(rule, where=where, remedy=f"The pattern is relative to {folder}.")
        case_folders += matches
    return case_folders


def _find_by_paths(sources: Sequence[Path]) -> tuple[Path, list[Path]]:
    """Return the common folder and the case folders of folders and patterns of the command line."""
    case_folders: list[Path] = []
    for source in sources:
        path = Path(os.path.abspath(source))
        if path.is_dir():
            matches = [path] if _is_case_folder(path) else _find_by_patterns(path, ["**"], str(source))
        elif any(sign in str(source) for sign in _WILDCARDS):
            root = next(parent for parent in path.parents if not any(s in str(parent) for s in _WILDCARDS))
            matches = _find_by_patterns(root, [path.relative_to(root).as_posix()], str(source))
        else:
            rule = "a fleet must be a FLEET.toml, a folder of cases, or case folders"
            raise BadInput.from_rule(
                rule, f"{source}, which does not exist as such", remedy="Check the path."
            )
        case_folders += matches
    if len(sources) == 1 and not _is_case_folder(Path(sources[0])) and Path(sources[0]).is_dir():
        return Path(os.path.abspath(sources[0])), case_folders
    return Path(os.path.commonpath([str(folder.parent) for folder in case_folders])), case_folders


def _is_hidden(path: Path, folder: Path) -> bool:
    return any(part.startswith(".") for part in path.relative_to(folder).parts)

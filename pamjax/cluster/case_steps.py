"""The stages of one case: the files that the commands of these names write, in a given folder."""

from __future__ import annotations

import errno
import hashlib
import json
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pamjax.errors import BadInput
from pamjax.fleet.plan import ReferenceModel
from pamjax.records.case import Case, read_case
from pamjax.records.files import read_bytes

#: Name of the report of a stage.
_CASE_REPORT_FILE = "report.html"
#: Result of the stage validate.
_VALIDATION_FILE = "validation.json"


def read_unchanged_case(folder: Path, checksum: str) -> Case:
    """Return a case whose files are those of the task.

    Raises:
        BadInput: as `read_case`, or if the files changed.
    """
    case = read_case(folder)
    if case.checksum != checksum:
        raise BadInput.from_rule(
            f"the files of {folder} changed after the run began", remedy="Start the fleet again."
        )
    return case


def _run_check(case: Case, out: Path, settings: dict[str, Any]) -> None:
    """Write check.json: rows, blocks, and which parameters the recording determines."""
    from pamjax.infer.fitting.case_summary import CaseSummary
    from pamjax.infer.fitting.identifiability import check_identifiability

    summary = CaseSummary(case, *check_identifiability(case, settings["law"]))
    text = json.dumps(summary.as_dict(), indent=1, allow_nan=False) + "\n"
    (out / "check.json").write_text(text, "utf-8")


def _run_fit(case: Case, out: Path, settings: dict[str, Any]) -> None:
    """Write the files of `pamjax fit`."""
    from pamjax.infer.fitting.fit import fit
    from pamjax.infer.fitting.io import save

    result = fit(
        [case],
        settings["law"],
        [],
        settings["mechanisms"],
        loss=settings["loss"],
        starts=settings["starts"],
        fold_count=settings["folds"],
        seed=settings["seed"],
    )
    save(result, out)
    if settings["figures"]:
        from pamjax.view.figures.fit import save_fit_figures

        save_fit_figures(result, out)
    if settings["report"]:
        from pamjax.view.reports.fit import write_fit_report

        write_fit_report(result, out / _CASE_REPORT_FILE, _format_fit_command(case, settings))


def _run_sample(case: Case, out: Path, settings: dict[str, Any]) -> None:
    """Write the files of `pamjax sample`, without the saved chain."""
    from pamjax.infer.posterior.io import save_posterior
    from pamjax.infer.posterior.sample import sample

    options = {name: settings[name] for name in ("sampler", "ess", "rhat", "max_draws", "seed")}
    post = sample([case], settings["law"], [], settings["mechanisms"], **options)
    save_posterior(post, out)
    if settings["figures"]:
        from pamjax.view.figures.posterior import save_posterior_figures

        save_posterior_figures(post, out)
    if settings["report"]:
        from pamjax.view.reports.posterior import write_posterior_report

        write_posterior_report(post, out / _CASE_REPORT_FILE, _format_sample_command(case, settings))


def run_diagnose(case: Case, out: Path, settings: dict[str, Any]) -> None:
    """Write the files of `pamjax diagnose`."""
    from pamjax.baselines.comparison import compare_models, save_comparison
    from pamjax.diagnosis.result import save_diagnosis
    from pamjax.diagnosis.run import diagnose

    diagnosis = diagnose(case, seed=settings["seed"])
    save_diagnosis(diagnosis, out)
    comparison = compare_models(diagnosis, settings["seed"])
    if comparison is not None:
        save_comparison(comparison, out)
    if settings["report"]:
        from pamjax.view.reports.diagnosis import write_diagnosis_report

        command = shlex.join(["pamjax", "diagnose", str(case.folder), "--seed", str(settings["seed"])])
        write_diagnosis_report(diagnosis, out / _CASE_REPORT_FILE, command, comparison)


def run_validate(case: Case, out: Path, settings: dict[str, Any]) -> None:
    """Write validation.json: errors of a model on the case, by block.

    Args:
        case: the case.
        out: folder of the stage.
        settings: "model", the path of the model.json or fit.json; "checksum", its SHA-256; "case", the
            name of the case in it.
    """
    from pamjax.diagnosis.validate import read_training_checksums, validate
    from pamjax.infer.fitting.load import load_muscle

    file = settings["model"]
    if hashlib.sha256(read_bytes(file)).hexdigest() != settings["checksum"]:
        # This is no fault of the case: as an error of the disk, it ends the run.
        raise OSError(errno.ESTALE, "another program changed the copy of the model", str(file))
    model = load_muscle(file, case=settings["case"])
    validation = validate(model, case, read_training_checksums(file))
    text = json.dumps(validation.as_dict(), indent=1, allow_nan=False) + "\n"
    (out / _VALIDATION_FILE).write_text(text, "utf-8")


def check_model(model: ReferenceModel) -> None:
    """Check that a model can be tested, before the first case.

    Raises:
        BadInput: as `load_muscle`.
    """
    from pamjax.diagnosis.validate import read_training_checksums
    from pamjax.infer.fitting.load import load_muscle

    load_muscle(model.file, case=model.case)
    read_training_checksums(model.file)


#: Function of each stage.
STEPS: dict[str, Callable[[Case, Path, dict[str, Any]], None]] = {
    "check": _run_check,
    "fit": _run_fit,
    "sample": _run_sample,
    "diagnose": run_diagnose,
    "validate": run_validate,
}


def _format_model_options(settings: dict[str, Any]) -> list[str]:
    words = ["--law", settings["law"]] if settings["law"] else []
    return [*words, "--with", *settings["mechanisms"]] if settings["mechanisms"] else words


def _format_sample_command(case: Case, settings: dict[str, Any]) -> str:
    """Return the command that repeats a posterior."""
    words = ["pamjax", "sample", str(case.folder), "--seed", str(settings["seed"])]
    words += _format_model_options(settings)
    for name in ("sampler", "ess", "rhat", "max_draws"):
        words += [f"--{name.replace('_', '-')}", f"{settings[name]}"]
    return shlex.join(words)


def _format_fit_command(case: Case, settings: dict[str, Any]) -> str:
    """Return the command that repeats a fit."""
    words = ["pamjax", "fit", str(case.folder), "--seed", str(settings["seed"])]
    words += _format_model_options(settings)
    words += ["--loss", settings["loss"], "--starts", str(settings["starts"])]
    return shlex.join([*words, "--folds", str(settings["folds"])])

"""Models of pneumatic artificial muscles in JAX, calibrated on recordings, with their uncertainty."""

import time
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.control.export import export
    from pamjax.control.inverse import Inverse, inverse
    from pamjax.diagnosis.result import Diagnosis
    from pamjax.diagnosis.run import diagnose
    from pamjax.diagnosis.settings import DiagnosisSettings
    from pamjax.diagnosis.validate import validate
    from pamjax.errors import BadInput, InputWarning
    from pamjax.explanation import explain
    from pamjax.fleet.fleet import Fleet, open_fleet
    from pamjax.infer.fitting.fit import fit
    from pamjax.infer.fitting.identifiability import check_identifiability
    from pamjax.infer.fitting.io import save
    from pamjax.infer.fitting.load import load_muscle
    from pamjax.infer.fitting.result import Fit
    from pamjax.infer.posterior.compare import compare
    from pamjax.infer.posterior.io import save_posterior
    from pamjax.infer.posterior.result import Posterior
    from pamjax.infer.posterior.sample import sample
    from pamjax.model.assembly import assemble
    from pamjax.model.muscle import Muscle, predict
    from pamjax.model.parameters import list_parameters
    from pamjax.planning.discriminate import Discrimination, discriminate
    from pamjax.planning.plan import Plan, plan
    from pamjax.records.case import Case, read_case
    from pamjax.records.dataframe import case_from
    from pamjax.records.importing.importer import import_case
    from pamjax.records.recording import Recording
    from pamjax.records.simulate import simulate
    from pamjax.sizing.result import Design
    from pamjax.sizing.size import size
    from pamjax.view.figures.figure_names import list_figures, plot

#: Time at which this process imported pamjax. This process does not run source files that are newer.
IMPORT_TIME = time.time()

#: Module of each public name. A module loads at its first use, so that `pamjax --help` does not load JAX.
_MODULE_OF_NAME = {
    "BadInput": "pamjax.errors",
    "InputWarning": "pamjax.errors",
    "Muscle": "pamjax.model.muscle",
    "predict": "pamjax.model.muscle",
    "assemble": "pamjax.model.assembly",
    "list_parameters": "pamjax.model.parameters",
    "explain": "pamjax.explanation",
    "Case": "pamjax.records.case",
    "read_case": "pamjax.records.case",
    "case_from": "pamjax.records.dataframe",
    "import_case": "pamjax.records.importing.importer",
    "Recording": "pamjax.records.recording",
    "simulate": "pamjax.records.simulate",
    "Fit": "pamjax.infer.fitting.result",
    "check_identifiability": "pamjax.infer.fitting.identifiability",
    "keep_compiled": "pamjax.compile.jax_cache",
    "fit": "pamjax.infer.fitting.fit",
    "load_muscle": "pamjax.infer.fitting.load",
    "Posterior": "pamjax.infer.posterior.result",
    "sample": "pamjax.infer.posterior.sample",
    "save": "pamjax.infer.fitting.io",
    "save_posterior": "pamjax.infer.posterior.io",
    "Design": "pamjax.sizing.result",
    "size": "pamjax.sizing.size",
    "Diagnosis": "pamjax.diagnosis.result",
    "DiagnosisSettings": "pamjax.diagnosis.settings",
    "Inverse": "pamjax.control.inverse",
    "inverse": "pamjax.control.inverse",
    "export": "pamjax.control.export",
    "Plan": "pamjax.planning.plan",
    "plan": "pamjax.planning.plan",
    "Discrimination": "pamjax.planning.discriminate",
    "discriminate": "pamjax.planning.discriminate",
    "diagnose": "pamjax.diagnosis.run",
    "validate": "pamjax.diagnosis.validate",
    "compare": "pamjax.infer.posterior.compare",
    "plot": "pamjax.view.figures.figure_names",
    "list_figures": "pamjax.view.figures.figure_names",
    "Fleet": "pamjax.fleet.fleet",
    "open_fleet": "pamjax.fleet.fleet",
}

__all__ = [
    "BadInput",
    "Case",
    "Design",
    "Diagnosis",
    "DiagnosisSettings",
    "Discrimination",
    "Fit",
    "Fleet",
    "InputWarning",
    "Inverse",
    "Muscle",
    "Plan",
    "Posterior",
    "Recording",
    "assemble",
    "case_from",
    "check_identifiability",
    "compare",
    "diagnose",
    "discriminate",
    "explain",
    "export",
    "fit",
    "import_case",
    "inverse",
    "keep_compiled",
    "list_figures",
    "list_parameters",
    "load_muscle",
    "open_fleet",
    "plan",
    "plot",
    "predict",
    "read_case",
    "sample",
    "save",
    "save_posterior",
    "simulate",
    "size",
    "validate",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("pamjax")
    if name not in _MODULE_OF_NAME:
        raise AttributeError(f"module 'pamjax' has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF_NAME[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)

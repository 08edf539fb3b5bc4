"""Pneumatic artificial muscles in JAX: elastic braids, calibrated on recordings, with honest uncertainty."""

import time
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pamjax.check import BadInput, InputWarning
    from pamjax.design.export import export
    from pamjax.design.inverse import Inverse, inverse
    from pamjax.design.plan import Plan, plan
    from pamjax.design.result import Design
    from pamjax.design.size import size
    from pamjax.design.tell import Contest, tell
    from pamjax.infer.cache import keep_compiled
    from pamjax.infer.determine import determine
    from pamjax.infer.fit import fit
    from pamjax.infer.load import load_muscle
    from pamjax.infer.posterior import Posterior
    from pamjax.infer.result import Fit
    from pamjax.infer.sample import sample
    from pamjax.infer.save import save
    from pamjax.infer.save_posterior import save_posterior
    from pamjax.model.assembly import assemble
    from pamjax.model.catalogue import catalogue
    from pamjax.model.muscle import Muscle, predict
    from pamjax.records.case import Case, read_case
    from pamjax.records.frame import case_from
    from pamjax.records.recording import Recording
    from pamjax.records.rig import import_case
    from pamjax.records.simulate import simulate
    from pamjax.study.diagnose import diagnose
    from pamjax.study.diagnosis import Diagnosis

#: When this process began to import pamjax: sources that were written later are not what runs.
IMPORTED = time.time()

#: Where each public name lives. They load when first used, so that `pamjax --help` loads no JAX.
_HOME = {
    "BadInput": "pamjax.check",
    "InputWarning": "pamjax.check",
    "Muscle": "pamjax.model.muscle",
    "predict": "pamjax.model.muscle",
    "assemble": "pamjax.model.assembly",
    "catalogue": "pamjax.model.catalogue",
    "Case": "pamjax.records.case",
    "read_case": "pamjax.records.case",
    "case_from": "pamjax.records.frame",
    "import_case": "pamjax.records.rig",
    "Recording": "pamjax.records.recording",
    "simulate": "pamjax.records.simulate",
    "Fit": "pamjax.infer.result",
    "determine": "pamjax.infer.determine",
    "keep_compiled": "pamjax.infer.cache",
    "fit": "pamjax.infer.fit",
    "load_muscle": "pamjax.infer.load",
    "Posterior": "pamjax.infer.posterior",
    "sample": "pamjax.infer.sample",
    "save": "pamjax.infer.save",
    "save_posterior": "pamjax.infer.save_posterior",
    "Design": "pamjax.design.result",
    "size": "pamjax.design.size",
    "Diagnosis": "pamjax.study.diagnosis",
    "Inverse": "pamjax.design.inverse",
    "inverse": "pamjax.design.inverse",
    "export": "pamjax.design.export",
    "Plan": "pamjax.design.plan",
    "plan": "pamjax.design.plan",
    "Contest": "pamjax.design.tell",
    "tell": "pamjax.design.tell",
    "diagnose": "pamjax.study.diagnose",
}

__all__ = [
    "BadInput",
    "Case",
    "Contest",
    "Design",
    "Diagnosis",
    "Fit",
    "InputWarning",
    "Inverse",
    "Muscle",
    "Plan",
    "Posterior",
    "Recording",
    "assemble",
    "case_from",
    "catalogue",
    "determine",
    "diagnose",
    "export",
    "fit",
    "import_case",
    "inverse",
    "keep_compiled",
    "load_muscle",
    "plan",
    "predict",
    "read_case",
    "sample",
    "save",
    "save_posterior",
    "simulate",
    "size",
    "tell",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'pamjax' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)

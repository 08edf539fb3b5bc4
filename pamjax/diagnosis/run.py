"""Diagnose: locate the mismatch, name the missing physics, model it, show the gain. The verb of the study."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from pamjax.diagnosis.crossval.cross_validated import borne_out, doubted, untold
from pamjax.diagnosis.crossval.gain import gain, held_out
from pamjax.diagnosis.detect.locate import locate_names, locate_rest
from pamjax.diagnosis.detect.residual_test import leaves_more, leaves_much, rest_of
from pamjax.diagnosis.detect.score_test import signatures
from pamjax.diagnosis.detect.significance import DETECTED, Significance, significance
from pamjax.diagnosis.identifiability import notes
from pamjax.diagnosis.library.candidates import forms
from pamjax.diagnosis.library.library_problem import Problem, problem
from pamjax.diagnosis.next_experiment.experiment import experiments
from pamjax.diagnosis.refit.candidate_fit import Model, settle
from pamjax.diagnosis.refit.misfit_weighting import weighed
from pamjax.diagnosis.refit.noise_correlation import with_memory
from pamjax.diagnosis.result import Diagnosis, Moved, Number, number_of
from pamjax.diagnosis.select.model_averaging import spread
from pamjax.diagnosis.select.selection import Naming, name_mechanisms, without_small
from pamjax.progress import Progress, silent
from pamjax.records.blocks import blocks
from pamjax.records.case import Case, as_case


def diagnose(
    case: Case | str | Path,
    *,
    seed: int = 0,
    progress: Progress = silent,
) -> Diagnosis:
    """Say what a recording's baseline leaves out.

    Args:
        case: the recording and what the lab believes of its muscle, or their folder.
        seed: of the draws behind the p-values.
        progress: called with what is being done and the share done.

    Raises:
        BadInput: for a baseline that no bench has, or a recording without force and diameter.
    """
    case = as_case(case)
    progress("compiling", 0.0)
    found = problem(case)
    found.compile()
    laid = blocks(case.recording)
    out = held_out(laid)
    naming = name_mechanisms(found, ~out, progress)
    progress("judging", 0.85)
    mismatch = _mismatch(found, naming, seed)
    detected = mismatch.p_value < DETECTED
    if not detected:
        naming = replace(naming, model=naming.baseline, names=(), near=None, before=None)
    rest = _rest(found, naming, mismatch, seed)
    unexplained = detected and leaves_more(mismatch, rest)
    if unexplained and naming.before is not None:
        # What is small beside a name is told only where nothing else is: it bends to that.
        naming = without_small(found, naming)
        rest = _rest(found, naming, mismatch, seed)
        unexplained = leaves_more(mismatch, rest)
    came = naming
    if naming.names:
        # Names that bend to what is in no catalogue may leave too little to be told from noise.
        borne = borne_out(found, laid, ~out, naming, much=leaves_much(mismatch, rest))
        rest = rest if borne.model is naming.model else _rest(found, borne, mismatch, seed)
        naming, unexplained = borne, leaves_more(mismatch, rest)
    if naming.names and unexplained:
        naming = doubted(naming)
    score = gain(found, laid, out, naming.baseline, _told(found, naming, ~out))
    every = np.ones(found.n, dtype=bool)
    baseline = settle(found, every, (), naming.baseline.at.values)
    model = baseline
    if naming.names:
        model = with_memory(found, _told(found, naming, every))
        model = spread(found, model, naming.names)
    progress("done", 1.0)
    return Diagnosis(
        found=found,
        naming=naming,
        model=model,
        baseline=baseline,
        mismatch=mismatch,
        where=locate_names(found, baseline, model) if naming.names else locate_rest(found, baseline),
        rest=rest,
        unexplained=unexplained,
        rest_where=locate_rest(found, model) if unexplained else [],
        rest_share=_share(mismatch, rest),
        blocks=laid,
        gain=score,
        parameters=_parameters(found, model),
        moved=_moved(found, baseline, model) if naming.names else {},
        notes=[
            *(untold(came, naming) if unexplained else []),
            *found.case.warnings,
            *notes(found, baseline, model),
        ],
        experiments=experiments(found, model, naming.names),
    )  # fmt: skip


def _mismatch(found: Problem, naming: Naming, seed: int) -> Significance:
    """The baseline's residual, judged; of a table of unknown noise every row, since each tells the noise."""
    judged, seen = naming.baseline, list(naming.first)
    if any(colour and math.isfinite(colour.freedom) for colour in judged.white.colours):
        judged = settle(found, np.ones(found.n, dtype=bool), (), judged.at.values)
        seen = signatures(found, judged.white, judged.at, forms(found))
    return significance(found, judged.white, judged.at, seen, seed)


def _told(found: Problem, naming: Naming, rows: np.ndarray) -> Model:
    """The named model as some rows tell it; a baseline without names stays as it was judged."""
    model = naming.model
    return weighed(found, rows, model.chosen, naming.values) if model.chosen else model


def _rest(found: Problem, naming: Naming, mismatch: Significance, seed: int) -> Significance:
    """What the names leave, judged; the mismatch itself where there are none."""
    return rest_of(found, naming.model, seed) if naming.model.chosen else mismatch


def _share(mismatch: Significance, rest: Significance) -> float:
    before = max(mismatch.square - 1, 0.0)
    return float(np.clip(max(rest.square - 1, 0.0) / before, 0.0, 1.0)) if before > 0 else 0.0


def _parameters(found: Problem, model: Model) -> dict[str, dict[str, Number]]:
    return {
        form.id: {name.rpartition(".")[2]: number_of(found, model, found.place(name)) for name in form.moves}
        for form in model.chosen
    }


def _moved(found: Problem, baseline: Model, model: Model) -> dict[str, Moved]:
    out = {}
    for k in baseline.at.moved:
        before, after, sd = baseline.at.values[k], model.at.values[k], baseline.sd(k)
        shift = (after - before) / sd if sd > 0 else 0.0
        out[found.names[k]] = Moved(float(before), float(after), float(shift), found.meaning[k])
    return out

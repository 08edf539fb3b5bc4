"""Artificial trials for tests of counts, figures and continuation."""

import os
import time
from pathlib import Path

import numpy as np

from pamjax.benchmark.trial import TRIAL_KINDS, RecoveredParameter, Trial, TrialTask

IDS = ("braid_friction", "force_offset", "thread_crimp", "end_taper", "channel_lag")


def uniform(task: TrialTask) -> Trial:
    """Return a scoring result with a uniform p-value."""
    rng = np.random.default_rng([task.trial_index, round(1e3 * task.correlation)])
    return Trial(task.stage, task.kind, task.correlation, task.trial_index, task.seed, "elastic", "isobars",
                 p_value=float(rng.random()))  # fmt: skip


def endless(task: TrialTask) -> Trial:
    """Wait for a minute; the process id is written to the folder of the trials."""
    folder = Path(os.environ["PAMJAX_TEST_FOLDER"])
    (folder / f"{os.getpid()}.pid").touch()
    time.sleep(60)
    return uniform(task)


def made_up(task: TrialTask, detecting: float = 2.0) -> Trial:
    """Return an artificial diagnosis that names large effects and has one false name in ten."""
    rng = np.random.default_rng(
        [list(TRIAL_KINDS).index(task.kind), task.trial_index, round(1e3 * task.correlation)]
    )
    many = TRIAL_KINDS[task.kind]
    ids = tuple(rng.permutation(IDS)[:many].tolist()) if task.kind != "outside" else ("ripple",)
    sizes = tuple(np.exp(rng.uniform(np.log(3), np.log(25), len(ids))).tolist())
    inside = task.kind not in ("outside", "nothing")
    named = [
        id for id, size in zip(ids, sizes, strict=True) if inside and rng.random() < 1 - detecting / size
    ]
    if inside and rng.random() < 0.1:
        named.append("pressure_gain")
    parameters = [
        RecoveredParameter(f"{id}.x", 1.0, 1.0 + 0.1 * rng.standard_normal(), 0.1, True) for id in named
    ]
    before = float(np.hypot(1, max(sizes, default=0.0)))
    return Trial(
        task.stage, task.kind, task.correlation, task.trial_index, task.seed, "elastic", "isobars",
        ids, sizes,
        p_value=float(rng.random()) if not ids else 1e-9,
        named=tuple(named), ties=tuple(() for _ in named),
        probabilities=tuple(rng.uniform(0.6, 1.0, len(named)).tolist()),
        unexplained=task.kind == "outside",
        before={"force": before}, after={"force": 1.0 + 0.1 * rng.random()},
        iou=float(rng.uniform(0.5, 1.0)) if ids else None, iou_blind=0.5 if ids else None,
        parameters=tuple(parameters), selected=(*ids, "mullins_softening"),
        selected_after=1.3, curve_after=2.0,
    )  # fmt: skip

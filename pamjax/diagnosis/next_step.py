"""The most useful next step after a diagnosis."""

from __future__ import annotations

from pamjax.diagnosis.result import Diagnosis
from pamjax.diagnosis.suggested_commands import MODEL_FILE, list_suggested_commands
from pamjax.model.registry import find_mechanism
from pamjax.text import join_words


def describe_next_step(diagnosis: Diagnosis, model: str = MODEL_FILE) -> tuple[str, ...]:
    """Return the most useful next step in sentences; parts between backticks are code.

    Args:
        diagnosis: the diagnosis.
        model: path of model.json, as text for a shell.
    """
    if diagnosis.experiments:
        experiment = diagnosis.experiments[0]
        separates = join_words([f"`{id}`" for id in experiment.separates])
        return (
            f"Run this: {experiment.protocol}.",
            f"It separates {separates} with probability {experiment.power:.2f}.",
        )
    tied = next((m for m in diagnosis.named_mechanisms if m.indistinguishable), None)
    if tied is not None:
        return (f"To separate them: {find_mechanism(tied.id).about.experiment}",)
    if diagnosis.unexplained and not diagnosis.problem.case.recording.has_time:
        return ("If the rows were recorded in sequence, add the column `time`, and repeat the diagnosis.",)
    if diagnosis.unexplained:
        return ("Check the rig and the muscle in the regions of the unexplained part, then record again.",)
    if diagnosis.is_faint:
        return ("Use the baseline, or record more cycles: a longer recording can identify a smaller effect.",)
    if diagnosis.named_mechanisms and not diagnosis.held_out_errors.baseline_rmse:
        return ("Record at least three pressures, so that a block can be held out.",)
    return tuple(f"{use}: `{command}`." for use, command in list_suggested_commands(diagnosis, model)[:1])

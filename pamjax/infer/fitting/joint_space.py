"""The common parameters of recordings that are fitted together: one thread law, and one space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from pamjax.errors import BadInput, suggest_word
from pamjax.infer.problem.parameter_space import FreeParameter, ParameterSpace, build_space
from pamjax.infer.problem.priors import list_free_parameters
from pamjax.model.parameters import THREAD_LAWS
from pamjax.parameter import Meaning
from pamjax.records.case import Case


def choose_law(cases: Sequence[Case], law: str | None) -> str:
    """Return the thread law of all cases, and refuse cases that cannot be fitted together."""
    if not cases:
        raise BadInput.from_rule("a fit needs at least one case", "none", remedy="Pass a case folder.")
    names = [case.name for case in cases]
    for name in names:
        if names.count(name) > 1:
            remedy = "The folder's name distinguishes their parameters: rename one folder."
            raise BadInput.from_rule(
                "cases that are fitted together need different names", f"{name!r} twice", "", remedy
            )
    laws = sorted({law or case.muscle_toml.baseline for case in cases})
    if len(laws) > 1:
        raise BadInput.from_rule(
            "cases that are fitted together share one thread law",
            " and ".join(laws),
            "[baseline] of muscle.toml",
            "Use one law for all of them.",
        )
    if laws[0] not in THREAD_LAWS:
        raise BadInput.from_rule(f"unknown thread law {laws[0]!r}", remedy=suggest_word(laws[0], THREAD_LAWS))
    for case in cases:
        if not case.recording.channels:
            raise BadInput.from_rule(
                "a fit needs a measured force or diameter",
                "neither",
                f"{case.name}/recording.csv",
                "Add a column `force [N]` or `diameter [mm]`.",
            )
    return laws[0]


def build_joint_space(
    cases: Sequence[Case], law: str, share: Sequence[str], mechanisms: Sequence[str] = ()
) -> tuple[ParameterSpace, list[dict[str, str]]]:
    """Return the common space of all cases, and for each case the names of its parameters in that space."""
    parameters: dict[str, FreeParameter] = {}
    renames: list[dict[str, str]] = []
    for case in cases:
        own_parameters = list_free_parameters(case, law, mechanisms)
        is_single_case = len(cases) == 1
        rename = {
            n.name: n.name if is_single_case or n.name in share else f"{case.name}/{n.name}"
            for n in own_parameters
        }
        for n in own_parameters:
            shared_parameter = parameters.setdefault(rename[n.name], replace(n, name=rename[n.name]))
            if (shared_parameter.start, shared_parameter.sd) != (
                n.start,
                n.sd,
            ) and not shared_parameter.sd == n.sd == math.inf:
                raise _build_conflict_error(n.name, "another value or sd", case)
        renames.append(rename)
    free_names = sorted({name for rename in renames for name in rename})
    for name in share:
        if name not in free_names:
            raise BadInput.from_rule(
                f"{name!r} is not a free parameter, so it cannot be shared",
                remedy=suggest_word(name, free_names),
            )
        for case, rename in zip(cases, renames, strict=True):
            if name not in rename:
                raise _build_conflict_error(name, "no sd, or no such parameter", case)
    if not parameters:
        raise BadInput.from_rule(
            "a fit needs a free parameter",
            "every value stated without `sd`",
            "muscle.toml",
            "Write at least one as {value = ..., sd = ...}.",
        )
    return build_space(list(parameters.values())), renames


def _build_conflict_error(name: str, got: str, case: Case) -> BadInput:
    """Return the error for a shared parameter with different priors."""
    rule, remedy = (
        f"a shared parameter ({name}) must have one prior",
        "State the same value and sd in each case.",
    )
    return BadInput.from_rule(rule, got, f"{case.name}/muscle.toml", remedy)


def collect_meanings(
    cases: Sequence[Case], law: str, renames: Sequence[dict[str, str]], mechanisms: Sequence[str]
) -> dict[str, Meaning]:
    """Return the meaning of each parameter of the common space."""
    pairs = [
        (rename[n.name], n.meaning)
        for c, rename in zip(cases, renames, strict=True)
        for n in list_free_parameters(c, law, mechanisms)
    ]
    return dict(pairs)

"""Report of a plan: the runs and their expected precision first, then details and assumptions."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

from pamjax.channels import DISPLAY_UNIT
from pamjax.model.parameters import find_meaning
from pamjax.planning.plan import ALL_PARAMETERS, ExpectedSd, Plan
from pamjax.planning.report import (
    format_loads,
    format_minutes,
    format_misfit,
    format_neglected,
    format_precision,
    format_rough_precision,
    format_simpler_protocols,
    format_single_channel,
    format_usual_protocol,
)
from pamjax.planning.rig_capabilities import RigCapabilities
from pamjax.units import format_quantity
from pamjax.view.figures.plan import PrecisionCourse, plot_commands, plot_precision
from pamjax.view.reports.page import build_picture, write_page


def write_plan_report(
    plan: Plan, course: PrecisionCourse, path: str | Path, command: str = "", checksum: str = ""
) -> Path:
    """Write the report of a plan.

    Args:
        plan: the plan.
        course: expected standard deviation of the goal after each run.
        path: the HTML file; its folder must exist.
        command: shell command that repeats the plan.
        checksum: SHA-256 of the muscle's files.
    """
    return write_page(
        path,
        "plan.html.jinja",
        title=format_headline(plan),
        kicker=f"Plan for {plan.prior.muscle_toml.name} · {plan.prior.law} threads",
        answer=format_answer(plan),
        precision=build_picture(partial(plot_precision, plan, course), "precision"),
        has_single_channel=bool(plan.single_channel),
        commands=build_picture(partial(plot_commands, plan), "commands"),
        runs=[
            [run.description, str(count), format_minutes(count * run.minutes)]
            for count, run in plan.chosen_runs
        ],
        expected_sds=[_build_expected_row(name, expected) for name, expected in plan.expected_sds.items()],
        simpler_protocols=[f"{_capitalise(line)}." for line in format_simpler_protocols(plan)],
        rig=_list_rig_rows(plan),
        rig_errors=[_build_error_row(name, sd) for name, sd in plan.prior.capabilities.assumed_sds.items()],
        neglected=f"{_capitalise(format_neglected(plan))}.",
        checksum=checksum,
        command=command or "pamjax.plan(...)",
    )


def format_headline(plan: Plan) -> str:
    """Return the result in one line."""
    if format_misfit(plan):
        return "Diagnose first: the model does not fit its recording"
    if plan.goal == ALL_PARAMETERS:
        return f"A plan of {format_minutes(plan.minutes)} for all parameters together"
    if not plan.chosen_runs and plan.reaches_goal:
        return f"{plan.goal} is already determined {format_precision(plan, plan.sd)}"
    if not plan.reaches_goal:
        limit = format_minutes(plan.prior.capabilities.minutes)
        return f"No plan of {limit} on this rig determines {plan.goal} to the wanted precision"
    return (
        f"A plan of {format_minutes(plan.minutes)} determines {plan.goal} {format_precision(plan, plan.sd)}"
    )


def format_answer(plan: Plan) -> list[str]:
    """Return the runs and their expected result; with a misfit, the warning first."""
    misfit = format_misfit(plan)
    if not misfit:
        return list(_format_expected_result(plan))
    precision = (
        f" would determine {plan.goal} {format_rough_precision(plan)}"
        if plan.goal != ALL_PARAMETERS
        else " would be the plan"
    )
    return [
        f"{_capitalise(misfit)}. The expected standard deviations are therefore not reliable.",
        f"If the model were correct, {_format_runs(plan)}{precision}.",
    ]


def _format_runs(plan: Plan) -> str:
    """Return the number of runs and checks, with time and rows."""
    run_count = sum(count for count, run in plan.chosen_runs if run.pressure.size)
    check_count = sum(count for count, run in plan.chosen_runs if not run.pressure.size)
    check_text = f" and {_format_count(check_count, 'check')} of the rig" if check_count else ""
    return f"{_format_count(run_count, 'run')}{check_text} ({format_minutes(plan.minutes)}, {plan.rows} rows)"


def _format_expected_result(plan: Plan) -> tuple[str, str]:
    if plan.goal == ALL_PARAMETERS:
        return f"Perform {_format_runs(plan)}.", f"{_capitalise(format_usual_protocol(plan))}."
    if not plan.chosen_runs and plan.reaches_goal:
        return (
            "No measurement is needed.",
            "For a smaller standard deviation use `--to`; for another parameter use `--goal`.",
        )
    current_sd, unit = plan.expected_sds[plan.goal].current_sd, find_meaning(plan.goal).show
    result = (
        f"reduces the standard deviation of {plan.goal} from ± {format_quantity(current_sd, unit, 2)}"
        if math.isfinite(current_sd)
        else f"determines {plan.goal}"
    )
    first_sentence = f"Perform {_format_runs(plan)}. This {result} {format_precision(plan, plan.sd)}."
    return (
        first_sentence,
        f"{_capitalise('; '.join(format_single_channel(plan)) or format_usual_protocol(plan))}.",
    )


def _format_count(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"


def _capitalise(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


def _build_expected_row(name: str, expected: ExpectedSd) -> list[str]:
    meaning = find_meaning(name)
    current_text = (
        f"± {format_quantity(expected.current_sd, meaning.show, 2)}"
        if math.isfinite(expected.current_sd)
        else "unknown"
    )
    return [
        name,
        format_quantity(expected.value, meaning.show),
        current_text,
        f"± {format_quantity(expected.expected_sd, meaning.show, 2)}",
        meaning.about,
    ]


def _list_rig_rows(plan: Plan) -> list[list[str]]:
    capabilities = plan.prior.capabilities
    limits = [
        ["largest contraction", f"{capabilities.max_contraction:.0%}"],
        ["speed of a stroke", f"{1e3 * capabilities.speed:.3g} mm/s"],
    ]
    if capabilities.measures_length:
        limits = [["set forces", format_loads(capabilities)]]
    rows = [
        ["highest pressure", format_quantity(capabilities.max_pressure, "kPa", 3)],
        *limits,
        ["rows per second", f"{capabilities.rate:.3g}"],
        ["set-up time between two runs", f"{capabilities.setup_seconds:.3g} s"],
        ["available time", format_minutes(capabilities.minutes)],
    ]
    rows += [
        [
            f"noise of {name}, per row",
            format_quantity(sd, DISPLAY_UNIT[name], 2) if sd is not None else "not measured",
        ]
        for name, sd in capabilities.channel_sds.items()
    ]
    rows.append(["noise of pressure, per row", format_quantity(capabilities.pressure_sd, "kPa", 2)])
    return [*rows, _build_set_input_row(capabilities)]


def _build_set_input_row(capabilities: RigCapabilities) -> list[str]:
    """Return the noise of the set force of an isotonic rig, else the noise or the error of the length."""
    if capabilities.measures_length:
        sd = capabilities.force_sd
        return ["noise of the set force, per row", format_quantity(sd, "N", 2) if sd else "none"]
    if capabilities.length_level_sd:
        return ["error of length, per setting", format_quantity(capabilities.length_level_sd, "mm", 2)]
    return ["noise of length, per row", format_quantity(capabilities.length_sd, "mm", 2)]


def _build_error_row(name: str, sd: float) -> list[str]:
    meaning = find_meaning(name)
    return [name, f"± {format_quantity(sd, meaning.show, 2)}", meaning.about]

"""`pamjax fleet`: check, fit and diagnose many recordings, and the statistics of their store."""

from __future__ import annotations

import shlex
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

from pamjax.cli.help import ParagraphFormatter
from pamjax.cli.options import Json
from pamjax.cli.screen import (
    REPORT_FILE,
    check_writable,
    format_command,
    print_json,
    print_text,
    print_written_files,
)
from pamjax.errors import BadInput, check_minimum

if TYPE_CHECKING:
    from pamjax.fleet.fleet import Fleet

#: Largest number of cases that the summary lists with their reason.
_MAX_LISTED_CASES = 10

fleet = App(name="fleet", help_format="plaintext", help_formatter=ParagraphFormatter())

Stages = Annotated[
    list[Literal["check", "fit", "diagnose", "validate", "sample"]] | None,
    Parameter(name="--stage", consume_multiple=True, negative=""),
]


@fleet.default
def run(
    sources: list[Path],
    /,
    *,
    out: Path = Path("out/fleet"),
    stage: Stages = None,
    workers: int | None = None,
    memory: str | None = None,
    scheduler: str | None = None,
    timeout: float | None = None,
    retry: Annotated[bool, Parameter(negative="")] = False,
    seed: int | None = None,
    figures: bool | None = None,
    report: bool | None = None,
    model: Path | None = None,
) -> None:
    """Check, fit and diagnose many recordings in parallel, and collect the results in a store.

    The store has a folder for each case and Parquet tables of all of them. The same command continues an
    interrupted run. `pip install -e '.[fleet]'` in the repository adds its packages. `pamjax fleet
    status STORE` prints the state, and `pamjax fleet report STORE` writes a report about the specimens.

    Args:
        sources: a FLEET.toml, a folder of case folders, or case folders and patterns.
        out: folder of the store.
        stage: commands to run for each case: check, fit, diagnose, validate, sample; by default check, fit
            and diagnose.
        workers: number of worker processes on this machine; by default the number of cores.
        memory: memory limit of a worker, as "4 GB"; by default an equal share of the machine.
        scheduler: address of a Dask scheduler to use instead, as tcp://host:8786.
        timeout: time limit of one task in seconds; a task that exceeds it is set aside.
        retry: also repeat the tasks that were set aside.
        seed: random seed of fit, sample and diagnose; by default that of FLEET.toml, or 0.
        figures: write the figures of each fit and posterior.
        report: write report.html for each fit, posterior and diagnosis.
        model: model.json or fit.json that the stage validate tests; by default that of FLEET.toml.
    """
    from pamjax.cluster.connect import check_packages, connect_to_scheduler, start_cluster
    from pamjax.fleet.plan import read_plan
    from pamjax.fleet.store import FleetStore

    check_packages()
    _check_options(workers, memory, scheduler, timeout, seed)
    check_writable(out)
    plan = read_plan(sources, stages=stage, seed=seed, figures=figures, report=report, model=model)
    if plan.model is not None:
        from pamjax.cluster.case_steps import check_model

        check_model(plan.model)
    store = FleetStore(out)
    store.prepare()
    from pamjax.cli.fleet_progress import show_fleet_progress
    from pamjax.cluster.run_fleet import list_open_chains, lock_store, run_chains
    from pamjax.fleet.fleet import build_fleet
    from pamjax.fleet.tables import build_tables, write_tables

    hint = "" if scheduler else " (crashed, killed, or above its memory limit)"
    with lock_store(store):
        store.write_plan(plan)
        chains = list_open_chains(store, plan, retry)
        try:
            if chains:
                open_client = (
                    connect_to_scheduler(scheduler, store.folder)
                    if scheduler
                    else start_cluster(workers, memory)
                )
                with show_fleet_progress() as report_progress, open_client as client:
                    run_chains(client, chains, report_progress, timeout=timeout, death_hint=hint)
        except KeyboardInterrupt:
            print(f"to continue: {format_command()}", file=sys.stderr)
            raise
        tables = build_tables(store.folder)
        paths = write_tables(tables, store.folder)
    _print_summary(build_fleet(out, tables))
    print_text(f"next: pamjax fleet report {shlex.quote(str(out))}")
    print_written_files([out / path.relative_to(store.folder) for path in paths])


@fleet.command
def status(store: Path, /, *, json: Json = False) -> None:
    """Print the number of tasks in each state, and the cases that were refused or set aside.

    Args:
        store: folder that `pamjax fleet` wrote.
        json: print one JSON document.
    """
    from pamjax.cluster.connect import check_packages

    check_packages()
    from pamjax.fleet.fleet import open_fleet

    if json:
        print_json(_build_status(open_fleet(store)))
    else:
        _print_summary(open_fleet(store))


@fleet.command
def report(store: Path, /) -> None:
    """Compare the specimens of a fleet: distributions, outliers, rigs, drift, mechanisms.

    Writes report.html and the Parquet tables to the folder of the store. Prints the findings.

    Args:
        store: folder that `pamjax fleet` wrote.
    """
    from pamjax.cluster.connect import check_packages
    from pamjax.fleet.analysis import analyse_fleet
    from pamjax.fleet.fleet import build_fleet
    from pamjax.fleet.tables import build_tables, write_tables

    check_packages()
    tables = build_tables(store)
    paths = write_tables(tables, store)
    result = build_fleet(store, tables)
    answers = analyse_fleet(result)
    from pamjax.view.reports.fleet import format_fleet_summary, write_fleet_report

    paths.append(write_fleet_report(result, answers, store / REPORT_FILE, format_command()))
    print_text(format_fleet_summary(result, answers))
    print_written_files(paths)


def _check_options(
    workers: int | None, memory: str | None, scheduler: str | None, timeout: float | None, seed: int | None
) -> None:
    if scheduler is not None and (workers is not None or memory is not None):
        name = "`--workers`" if workers is not None else "`--memory`"
        remedy = "Set it where the workers of that cluster start."
        raise BadInput.from_rule(
            f"{name} is for the workers of this machine", "`--scheduler` too", remedy=remedy
        )
    if workers is not None:
        check_minimum("--workers", workers, 1)
    if memory is not None:
        from pamjax.cluster.connect import parse_memory

        parse_memory(memory)
    if timeout is not None and not timeout > 0:
        raise BadInput.from_rule("`--timeout` must be positive", f"{timeout:g} s")
    if seed is not None:
        check_minimum("--seed", seed, 0)


def _build_status(result: Fleet) -> dict:
    from pamjax.fleet.frames import list_rows
    from pamjax.fleet.store import DONE, OPEN

    failed = [row for row in list_rows(result.cases) if row["state"] not in (DONE, OPEN)]
    return {
        "name": result.name,
        "cases": len(result.cases),
        "tasks": {
            stage: dict(Counter(table["state"])) for stage, table in result.tasks.groupby("stage", sort=False)
        },
        "failed": [{key: row[key] for key in ("case", "state", "reason")} for row in failed],
    }


def _print_summary(result: Fleet) -> None:
    from pamjax.fleet.store import STATES

    state = _build_status(result)
    print_text(f"{state['name']}: {state['cases']} cases")
    for stage, counts in state["tasks"].items():
        numbers = [f"{counts[name]} {name}" for name in STATES if name in counts]
        print_text(f"  {stage:<9} {', '.join(numbers)}")
    for entry in state["failed"][:_MAX_LISTED_CASES]:
        print_text(f"  {entry['state']}: {entry['case']}: {entry['reason']}")
    rest = len(state["failed"]) - _MAX_LISTED_CASES
    if rest > 0:
        print_text(f"  {rest} more: `pamjax fleet status {shlex.quote(str(result.folder))} --json` lists all")

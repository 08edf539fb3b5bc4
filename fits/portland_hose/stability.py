"""Stability of the diagnoses: whether names and errors change with treatments that keep the physics.

python fits/portland_hose/stability.py FOLDER_WITH_CASES --out out/stability

Each hose is diagnosed after each treatment of `treatments.py`. The first treatment is the reference. Two
names are the same if one of them is tied with the other. Each diagnosis is written when it ends, and a
diagnosis that exists is not repeated; delete its folder to repeat it. The script prints the tables and writes
them to stability.md. With `--table` it prints the tables of the existing diagnoses only.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path

from command_line import build_parser, list_cases
from name_stability import (
    Change,
    Name,
    StabilitySummary,
    TreatedResult,
    compare_results,
    find_best_rival,
    summarise_changes,
)
from treatments import REFERENCE, TREATMENTS, Treatment

from pamjax.compile.jax_cache import keep_compiled
from pamjax.diagnosis.result import Diagnosis, save_diagnosis
from pamjax.diagnosis.run import diagnose
from pamjax.records.case import read_case
from pamjax.records.files import write_atomically

#: Results of one hose by the id of the treatment.
HoseResults = dict[str, TreatedResult]

TREATMENT_OF_ID = {treatment.id: treatment for treatment in TREATMENTS}

#: File with the numbers of one diagnosis.
RESULT_FILE = "stability.json"


def collect_numbers(diagnosis: Diagnosis, seconds: float) -> TreatedResult:
    """Return the numbers of a diagnosis that the tables and the search for causes need."""
    errors = diagnosis.held_out_errors
    names = tuple(
        Name(
            id=name.id,
            probability=name.probability,
            ties=name.indistinguishable,
            rivals={id: float(increase) for id, increase in name.rival_bic_increase.items()},
            form_error=name.form_error,
        )
        for name in diagnosis.named_mechanisms
    )
    return TreatedResult(
        names=names,
        unexplained=bool(diagnosis.unexplained),
        p_value=float(diagnosis.residual_test.p_value),
        likeness=diagnosis.likenesses[0].id if diagnosis.likenesses else "",
        rows=diagnosis.problem.n,
        held_out=errors.block_description,
        error=errors.model_rmse["force"],
        equation_error=errors.equation_rmse["force"],
        baseline_error=errors.baseline_rmse["force"],
        expected_error=errors.expected_rmse.get("force", float("nan")),
        noise=diagnosis.model.noise.compute_rms_sd(diagnosis.problem.channels.index("force")),
        seconds=seconds,
    )


def diagnose_treated(folder: Path, treatment: Treatment, out: Path) -> TreatedResult:
    """Return the numbers of one diagnosis; save it, and write the numbers last."""
    case = treatment.apply(read_case(folder))
    start = time.process_time()
    diagnosis = diagnose(case)
    result = collect_numbers(diagnosis, time.process_time() - start)
    save_diagnosis(diagnosis, out)
    (out / "report.txt").write_text(f"{diagnosis}\n", encoding="utf-8")
    with write_atomically(out / RESULT_FILE) as temporary:
        temporary.write_text(json.dumps(result.as_dict(), indent=1) + "\n", encoding="utf-8")
    return result


def read_results(out: Path, hose: str) -> HoseResults:
    """Return the results of a hose that exist, in the order of the treatments."""
    files = {treatment.id: out / hose / treatment.id / RESULT_FILE for treatment in TREATMENTS}
    return {
        id: TreatedResult.from_dict(json.loads(file.read_text(encoding="utf-8")))
        for id, file in files.items()
        if file.exists()
    }


def format_names(names: tuple[Name, ...]) -> str:
    """Return names with their probabilities, and their ties in brackets."""
    cells = [
        f"`{name.id}` {name.probability:.2f}" + (f" (= {', '.join(name.ties)})" if name.ties else "")
        for name in names
    ]
    return ", ".join(cells) or "none"


def format_best_rival(names: tuple[Name, ...]) -> str:
    """Return the rival with the lowest BIC, relative to the chosen model."""
    best = find_best_rival(names)
    return "–" if best is None else f"`{best[0]}` {best[1]:+.0f}"


def format_diagnoses(results: dict[str, HoseResults]) -> str:
    """Return all diagnoses as a Markdown table."""
    lines = [
        "| hose | treatment | rows | named mechanisms, probability (= tied) | lowest BIC of a rival"
        " | unexplained | p of residual | noise, N | held-out rms, N | without form errors, N | expected, N"
        " | processor, s |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for hose, by_treatment in results.items():
        for id, result in by_treatment.items():
            cells = [
                hose.removeprefix("hose-"),
                TREATMENT_OF_ID[id].title,
                str(result.rows),
                format_names(result.names),
                format_best_rival(result.names),
                (result.likeness or "yes") if result.unexplained else "no",
                f"{result.p_value:.0e}",
                f"{result.noise:.2f}",
                f"{result.error:.3g}",
                f"{result.equation_error:.3g}",
                f"{result.expected_error:.3g}",
                f"{result.seconds:.0f}",
            ]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def list_changes(results: dict[str, HoseResults]) -> dict[tuple[str, str], Change]:
    """Return the change of each diagnosis from its reference, by hose and treatment."""
    return {
        (hose, id): compare_results(by_treatment[REFERENCE.id], result)
        for hose, by_treatment in results.items()
        if REFERENCE.id in by_treatment
        for id, result in by_treatment.items()
        if id != REFERENCE.id
    }


def format_summary_row(title: str, summary: StabilitySummary) -> str:
    """Return one row of the summary."""
    low, mean, high = summary.ratios
    cells = [
        title,
        f"{summary.same} of {summary.diagnoses}",
        f"{summary.kept} of {summary.named} ({summary.identical})",
        str(summary.new),
        f"{low:.2f}, {mean:.2f}, {high:.2f}",
    ]
    return "| " + " | ".join(cells) + " |"


def format_summary(changes: dict[tuple[str, str], Change]) -> str:
    """Return the summary by hose, by treatment and over all, as a Markdown table."""
    lines = [
        "| group | diagnoses with the same names | reference names that remain (same id)"
        " | new names"
        " | error over reference: smallest, geometric mean, largest |",
        "|---|---|---|---|---|",
    ]
    groups = {hose: [c for (h, _), c in changes.items() if h == hose] for hose, _ in changes}
    groups |= {t.title: [c for (_, id), c in changes.items() if id == t.id] for t in TREATMENTS}
    groups["all"] = list(changes.values())
    lines += [format_summary_row(title, summarise_changes(group)) for title, group in groups.items() if group]
    return "\n".join(lines)


def write_tables(results: dict[str, HoseResults], out: Path) -> None:
    """Print the tables and write them to stability.md."""
    text = f"{format_diagnoses(results)}\n\n{format_summary(list_changes(results))}\n"
    print(text, flush=True)
    with write_atomically(out / "stability.md") as temporary:
        temporary.write_text(text, encoding="utf-8")


def diagnose_missing(folder: Path, treatments: Sequence[Treatment], out: Path) -> None:
    """Diagnose a hose after the treatments that have no result yet."""
    for treatment in treatments:
        if treatment.id not in read_results(out, folder.name):
            result = diagnose_treated(folder, treatment, out / folder.name / treatment.id)
            print(f"{folder.name}, {treatment.title}: {format_names(result.names)}", flush=True)


def choose_treatments(ids: str) -> list[Treatment]:
    """Return the treatments with some ids, separated by commas; all for an empty text."""
    return [TREATMENT_OF_ID[id] for id in ids.split(",")] if ids else list(TREATMENTS)


def main(arguments: list[str] | None = None) -> None:
    parser = build_parser(__doc__)
    parser.add_argument("--only", default="", help="names of the cases, separated by commas")
    parser.add_argument("--treatments", default="", help=f"some of {','.join(TREATMENT_OF_ID)}")
    parser.add_argument("--table", action="store_true", help="print the tables of existing diagnoses only")
    options = parser.parse_args(arguments)
    names = options.only.split(",") if options.only else [path.name for path in list_cases(options.cases)]
    treatments = [] if options.table else choose_treatments(options.treatments)
    options.out.mkdir(parents=True, exist_ok=True)
    keep_compiled()
    for name in names:
        diagnose_missing(options.cases / name, treatments, options.out)
    write_tables({name: read_results(options.out, name) for name in names}, options.out)


if __name__ == "__main__":
    main()

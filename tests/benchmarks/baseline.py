"""Compare the baseline of `pamjax fit` with the baseline of `pamjax diagnose` on the same recordings.

    python -m tests.benchmarks.baseline DIAGNOSES CASE [CASE ...]

DIAGNOSES is the folder that `pamjax diagnose CASE ... --out DIAGNOSES` wrote. Each case is fitted. A line for
each parameter has the difference of the two values in standard deviations of the fit, and the ratio of
the two standard deviations.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

from pamjax.compile.jax_cache import keep_compiled
from pamjax.infer.fitting.fit import fit
from pamjax.records.case import read_case
from pamjax.units import compute_si_factor


def compare_baselines(diagnoses: Path, folder: Path) -> list[dict]:
    """Return one dict for each parameter that both baselines have with a standard deviation."""
    case = read_case(folder)
    document = json.loads((diagnoses / case.name / "diagnosis.json").read_text("utf-8"))
    estimates = fit(case).estimates
    lines = []
    for name, entry in document["baseline"]["parameters"].items():
        estimate, factor = estimates.get(name), compute_si_factor(entry["unit"])
        if estimate is None or estimate.sd is None or entry["sd"] is None:
            continue
        lines.append(
            {
                "case": case.name,
                "parameter": name,
                "mismatch": document["mismatch"]["detected"],
                "difference_in_sd": (entry["value"] * factor - estimate.value) / estimate.sd,
                "sd_ratio": entry["sd"] * factor / estimate.sd,
            }
        )
    return lines


def main() -> None:
    """Print the table and its largest entries."""
    diagnoses, *folders = sys.argv[1:]
    keep_compiled()
    lines = [line for folder in folders for line in compare_baselines(Path(diagnoses), Path(folder))]
    for line in lines:
        mark = "mismatch" if line["mismatch"] else "no mismatch"
        name = f"{line['case']:10s} {line['parameter']:22s} {mark:12s}"
        print(f"{name} difference {line['difference_in_sd']:+8.2f} sd, ratio of sds {line['sd_ratio']:.2f}")
    for mismatch in (False, True):
        some = [line for line in lines if line["mismatch"] is mismatch]
        if some:
            largest = max(abs(line["difference_in_sd"]) for line in some)
            widest = max(abs(math.log(line["sd_ratio"])) for line in some)
            group = "with a mismatch" if mismatch else "without a mismatch"
            print(f"{group}: largest difference {largest:.2f} sd, largest factor {math.exp(widest):.2f}")


if __name__ == "__main__":
    main()

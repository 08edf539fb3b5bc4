"""Compare `pamjax fit` with the baseline of `pamjax diagnose` on the same recordings.

    python -m tests.benchmarks.baseline CASE [CASE ...] [--json FILE]

The baseline is fitted as `pamjax diagnose` fits it, without the rest of the diagnosis. A line for each
parameter has the difference of the two values in standard deviations of the fit, and the ratio of the two
standard deviations. A value at its limit has no standard deviation in a fit; its difference is in standard
deviations of the baseline.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from pamjax.compile.jax_cache import keep_compiled
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.refit.model_fit import ModelFit, fit_model
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.infer.fitting.fit import fit
from pamjax.infer.problem.priors import is_length_error
from pamjax.records.case import read_case
from tests.benchmarks.keep import arguments, keep


def compare_baselines(folder: Path) -> list[dict]:
    """Return one dict for each parameter of the muscle."""
    case = read_case(folder)
    problem = build_library_problem(case)
    all_rows = np.ones(problem.n, dtype=bool)
    # As `diagnose` reports it: with the stated noise.
    baseline = fit_model(problem, all_rows, (), problem.neutral, max_noise_ratio=1.0)
    estimates, lines = fit(case).estimates, []
    for k in baseline.estimate.free:
        name = problem.names[k]
        if is_length_error(name):
            continue
        estimate, sd = estimates[name], baseline.sd(k)
        lines.append(
            {
                "case": case.name,
                "parameter": name,
                "misfit": _has_misfit(baseline),
                "at_limit": estimate.at_limit,
                "difference_in_sd": (baseline.estimate.values[k] - estimate.value) / (estimate.sd or sd),
                "sd_ratio": None if estimate.sd is None else sd / estimate.sd,
            }
        )
    return lines


def _has_misfit(baseline: ModelFit) -> bool:
    return baseline.variance_inflation > DEFAULT_SETTINGS.min_misfit_mean_square


def summarise(lines: list[dict]) -> dict:
    """Return the largest difference, sd, and the largest factor between two sds."""
    ratios = [abs(math.log(line["sd_ratio"])) for line in lines if line["sd_ratio"] is not None]
    return {
        "cases": len({line["case"] for line in lines}),
        "largest_difference_in_sd": max(abs(line["difference_in_sd"]) for line in lines),
        "largest_sd_factor": math.exp(max(ratios, default=0.0)),
    }


def main() -> None:
    """Print the table and its largest entries."""
    folders, file = arguments()
    keep_compiled()
    lines = []
    for folder in folders:
        lines += compare_baselines(Path(folder))
        for line in lines[-3:]:
            ratio = "at its limit" if line["sd_ratio"] is None else f"ratio of sds {line['sd_ratio']:.3f}"
            name = f"{line['case']:10s} {line['parameter']:22s} {'misfit' if line['misfit'] else 'noise':7s}"
            print(f"{name} difference {line['difference_in_sd']:+.3f} sd, {ratio}", flush=True)
    summary = {}
    for misfit in (False, True):
        some = [line for line in lines if line["misfit"] is misfit]
        if some:
            group = "with a misfit" if misfit else "without a misfit"
            summary[group] = summarise(some)
            print(
                f"{group}: {summary[group]['cases']} cases, largest difference"
                f" {summary[group]['largest_difference_in_sd']:.3f} sd, largest factor"
                f" {summary[group]['largest_sd_factor']:.3f}"
            )
    keep(file, {f"{group}: {name}": value for group, of in summary.items() for name, value in of.items()})


if __name__ == "__main__":
    main()

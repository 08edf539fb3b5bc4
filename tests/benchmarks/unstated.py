"""Rate of false alarms of a diagnosis if the noise of the sensors is not stated.

    python -m tests.benchmarks.unstated 200 [--json FILE]

The simulated recordings conceal no effect. Their noise has various correlations; the noise of the force and
diameter sensors, or of all sensors, is not stated. Only the score test runs, some seconds per recording.
"""

import dataclasses
import multiprocessing
from pathlib import Path

import numpy as np
from scipy.stats import beta

from pamjax.benchmark.trial import TrialTask, draw_ground_truth, score_recording
from pamjax.compile.jax_cache import keep_compiled
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from tests.benchmarks.keep import arguments, keep

SEED = 40
SILENT = {
    "force and diameter": {"force": None, "diameter": None},
    "all four": {"force": None, "diameter": None, "pressure": None, "length": None},
}


def p_value(setting: tuple[str, float, int]) -> float:
    """Return the p-value of one recording with sensors of unstated noise."""
    silent, correlation, number = setting
    case = draw_ground_truth(TrialTask("score", "nothing", correlation, number, SEED)).case
    sensors = dataclasses.replace(case.muscle_toml.sensors, **SILENT[silent])
    muscle_toml = dataclasses.replace(case.muscle_toml, sensors=sensors)
    return score_recording(dataclasses.replace(case, muscle_toml=muscle_toml), number).p_value


def main(count: int = 200, file: Path | None = None) -> None:
    kinds = [(silent, correlation) for silent in SILENT for correlation in (0.0, 0.5, 0.9)]
    settings = [(*kind, number) for number in range(count) for kind in kinds]
    with multiprocessing.get_context("spawn").Pool(2, keep_compiled) as pool:
        p_values = np.array(pool.map(p_value, settings, chunksize=6)).reshape(count, len(kinds))
    figures: dict[str, float] = {"recordings of each kind": count}
    print(f"{'nothing is stated of':<20} noise  below 0.01, 0.05, 0.1, 0.5 and at most (95 %) below 0.01")
    for (silent, correlation), values in zip(kinds, p_values.T, strict=True):
        shares = [
            float(np.mean(values < level)) for level in (DEFAULT_SETTINGS.detection_p_value, 0.05, 0.1, 0.5)
        ]
        alarms = int(np.sum(values < DEFAULT_SETTINGS.detection_p_value))
        most = float(beta.ppf(0.95, alarms + 1, count - alarms))
        print(f"{silent:<20} {correlation:<5}  " + ", ".join(f"{s:.3f}" for s in shares) + f"; {most:.3f}")
        about = f"{silent} not stated, correlation {correlation}"
        figures |= {f"{about}, alarms": alarms, f"{about}, upper limit [%]": 100 * most}
        figures[f"{about}, p below 0.05 [%]"] = 100 * shares[1]
    keep(file, figures)


if __name__ == "__main__":
    words, file = arguments()
    main(*map(int, words), file=file)

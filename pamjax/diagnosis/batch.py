"""Diagnosis of several recordings in parallel."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed

from pamjax.diagnosis.result import Diagnosis
from pamjax.diagnosis.run import diagnose
from pamjax.diagnosis.settings import DEFAULT_SETTINGS, DiagnosisSettings
from pamjax.errors import BadInput
from pamjax.jit import keep_default_device
from pamjax.progress import Progress, ignore_progress
from pamjax.records.case import Case


def diagnose_all(
    cases: Sequence[Case],
    *,
    seed: int = 0,
    settings: DiagnosisSettings = DEFAULT_SETTINGS,
    progress: Progress = ignore_progress,
    workers: int | None = None,
) -> Iterator[tuple[Case, Diagnosis | BadInput]]:
    """Yield the diagnosis of each recording as soon as it is complete.

    Args:
        cases: the recordings, with different names.
        seed: seed of the random draws for the p-values.
        settings: thresholds of the diagnosis.
        progress: called with the current step and the completed fraction.
        workers: number of threads, at most one for each case; if omitted, the number of cores, at most four.

    Yields:
        each case with its diagnosis, or with the error of a bad input.
    """
    finished_count = 0

    def diagnose_case(case: Case, report_progress: Progress) -> Diagnosis | BadInput:
        try:
            return diagnose(case, seed=seed, settings=settings, progress=report_progress)
        except BadInput as error:
            return error

    if not cases:
        return
    workers = min(workers or min(os.cpu_count() or 1, 4), len(cases))
    if workers == 1:
        for case in cases:
            yield (
                case,
                diagnose_case(
                    case, lambda step, share, n=finished_count: progress(step, (n + share) / len(cases))
                ),
            )
            finished_count += 1
        return
    pool = ThreadPoolExecutor(workers)
    try:
        cases_by_future: dict[Future, Case] = {
            pool.submit(keep_default_device(diagnose_case), case, ignore_progress): case for case in cases
        }
        progress(f"{len(cases)} recordings", 0.0)
        for future in as_completed(cases_by_future):
            finished_count += 1
            progress(f"{finished_count} of {len(cases)}", finished_count / len(cases))
            yield cases_by_future[future], future.result()
    finally:
        # After an interruption do not wait for the other recordings.
        pool.shutdown(wait=False, cancel_futures=True)

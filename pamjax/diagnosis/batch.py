"""Several recordings in one call: both cores."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed

from pamjax.diagnosis.result import Diagnosis
from pamjax.diagnosis.run import diagnose
from pamjax.errors import BadInput
from pamjax.progress import Progress, ignore_progress
from pamjax.records.case import Case


def diagnose_all(
    cases: Sequence[Case],
    *,
    seed: int = 0,
    progress: Progress = ignore_progress,
    workers: int | None = None,
) -> Iterator[tuple[Case, Diagnosis | BadInput]]:
    """Diagnose each recording, and hand out each verdict as soon as it is there.

    Args:
        cases: the recordings, named differently.
        seed: of the draws behind the p-values.
        progress: called with what is being done and the share done.
        workers: threads; the compiled programs run side by side in them. None takes the machine's cores,
            four at most.

    Yields:
        each case with its diagnosis, or with why it cannot be diagnosed.
    """
    done = 0

    def diagnose_case(case: Case, report_progress: Progress) -> Diagnosis | BadInput:
        try:
            return diagnose(case, seed=seed, progress=report_progress)
        except BadInput as error:
            return error

    workers = min(workers or os.cpu_count() or 1, 4, len(cases))
    if workers == 1:
        for case in cases:
            whole = done
            yield case, diagnose_case(case, lambda doing, s, w=whole: progress(doing, (w + s) / len(cases)))
            done += 1
        return
    pool = ThreadPoolExecutor(workers)
    try:
        cases_by_future: dict[Future, Case] = {
            pool.submit(diagnose_case, case, ignore_progress): case for case in cases
        }
        progress(f"{len(cases)} recordings", 0.0)
        for future in as_completed(cases_by_future):
            done += 1
            progress(f"{done} of {len(cases)}", done / len(cases))
            yield cases_by_future[future], future.result()
    finally:
        # Who is interrupted waits for no other recording.
        pool.shutdown(wait=False, cancel_futures=True)

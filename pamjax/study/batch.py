"""Several recordings in one call: one compiled program, both cores."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed

from pamjax.check import BadInput
from pamjax.progress import Progress, silent
from pamjax.records.case import Case
from pamjax.study.diagnose import STEP, diagnose
from pamjax.study.diagnosis import Diagnosis


def diagnose_all(
    cases: Sequence[Case],
    *,
    seed: int = 0,
    progress: Progress = silent,
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

    def one(case: Case, size: int, tell: Progress) -> Diagnosis | BadInput:
        try:
            return diagnose(case, size=size, seed=seed, progress=tell)
        except BadInput as error:
            return error

    sizes = common_sizes([case.recording.n for case in cases])
    workers = min(workers or os.cpu_count() or 1, 4, len(cases))
    if workers == 1:
        for case, size in zip(cases, sizes, strict=True):
            whole = done
            yield case, one(case, size, lambda doing, s, w=whole: progress(doing, (w + s) / len(cases)))
            done += 1
        return
    with ThreadPoolExecutor(workers) as pool:
        waiting: dict[Future, Case] = {
            pool.submit(one, case, size, silent): case for case, size in zip(cases, sizes, strict=True)
        }
        progress(f"{len(cases)} recordings", 0.0)
        for future in as_completed(waiting):
            done += 1
            progress(f"{done} of {len(cases)}", done / len(cases))
            yield waiting[future], future.result()


def common_sizes(rows: Sequence[int]) -> list[int]:
    """Rows to pad each recording to: few different sizes, none much larger than it must be.

    >>> common_sizes([3000, 3300, 3400, 9000])
    [3584, 3584, 3584, 9216]
    """
    sizes: list[int] = []
    # From the longest down: a shorter one shares its program unless that would be half as long again.
    for n in sorted(rows, reverse=True):
        own = STEP * -(-n // STEP)
        if not sizes or sizes[-1] > 1.5 * own:
            sizes.append(own)
    return [min(size for size in sizes if size >= n) for n in rows]

"""Mutate input files, and require that each one is accepted or refused in one sentence.

    python -m tests.faults.mutate [COUNT] [--seed S] [--only KIND ...] [--first K] [--keep DIR] [--json FILE]

COUNT is the number of mutations for each kind of input in `inputs.KINDS`. A mutation fails if its reader
raises another exception or a foreign warning, takes more processor time than `LONGEST_TIME`, or needs more
memory than `LARGEST_MEMORY`. DIR keeps the files of the failures. `--first K` starts at mutation K.
"""

from __future__ import annotations

import argparse
import faulthandler
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import unicodedata
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from pamjax.cli.main import DISK_ERRORS
from pamjax.errors import BadInput, InputWarning
from tests.benchmarks.keep import arguments, keep
from tests.faults.inputs import KINDS, InputKind, write_example, write_mutation

#: Longest processor time of one reading, s, and largest growth of the memory, bytes.
LONGEST_TIME, LARGEST_MEMORY = 5.0, 1_000_000_000
#: Time on the clock after which a reading is stopped, s; other programs may slow it down.
LONGEST_WAIT = 30.0
#: Unicode categories that a message must not have: control, surrogate, and separators of lines.
CONTROL_CATEGORIES = {"Cc", "Cs", "Zl", "Zp"}
#: Longest message, characters.
LONGEST_MESSAGE = 1500


class TooSlowError(Exception):
    """A reading that takes too long."""


@dataclass
class MutationTally:
    """Results of the mutations of one kind.

    Attributes:
        accepted, refused: numbers of mutations.
        failures: number of the mutation, and what is wrong with it.
        slowest: longest processor time of a reading, s.
        largest: largest growth of the memory, bytes.
    """

    accepted: int = 0
    refused: int = 0
    failures: list[tuple[int, str]] = field(default_factory=list)
    slowest: float = 0.0
    largest: int = 0


def run_mutations(kind: InputKind, count: int, seed: int, first: int = 0, keep_folder: Path | None = None):
    """Return the `MutationTally` of `count` mutations from number `first`.

    Args:
        kind: the kind of input.
        count: number of mutations.
        seed: seed of the mutations; a mutation depends on it and on its number only.
        first: number of the first mutation.
        keep_folder: folder that gets the files of the failures; None keeps none.
    """
    tally = MutationTally()
    read_examples(kind)
    for number in range(first, first + count):
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch) / "input"
            folder.mkdir()
            write_mutation(kind, folder, np.random.default_rng([seed, number, *kind.name.encode()]))
            problem = _read(kind, folder, tally)
            if problem:
                tally.failures.append((number, problem))
            if problem and keep_folder:
                place = keep_folder / f"{kind.name}-{number}".replace(" ", "-")
                shutil.copytree(folder, place, symlinks=True, ignore=_list_special_files, dirs_exist_ok=True)
    return tally


def read_examples(kind: InputKind) -> None:
    """Read the examples of a kind without a change; this also loads the packages that its reader needs."""
    for example in kind.build_examples():
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch) / "input"
            folder.mkdir()
            write_example(example, folder)
            kind.read(folder)


def _read(kind: InputKind, folder: Path, tally: MutationTally) -> str:
    """Read a mutated input, and return what is wrong; empty if it is accepted or refused in one sentence."""
    problem, before, start = "", reset_peak_memory(), time.process_time()
    try:
        with limit_time(), warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", InputWarning)
            kind.read(folder)
        tally.accepted += 1
    except BadInput as error:
        tally.refused += 1
        problem = find_fault(str(error))
    except OSError as error:
        # The command line prints these as one sentence.
        tally.refused += error.errno in DISK_ERRORS
        problem = "" if error.errno in DISK_ERRORS else f"{type(error).__name__}: {error}"
    except TooSlowError:
        problem = f"no end after {LONGEST_WAIT:g} s"
    except Exception as error:
        places = [f"{Path(f.filename).name}:{f.lineno}" for f in traceback.extract_tb(error.__traceback__)]
        problem = f"{type(error).__name__}: {str(error)[:200]!r} at {' '.join(places[-4:])}"
    seconds, growth = time.process_time() - start, read_peak_memory() - before
    tally.slowest, tally.largest = max(tally.slowest, seconds), max(tally.largest, growth)
    if seconds > LONGEST_TIME:
        problem = problem or f"{seconds:.1f} s of processor time"
    if growth > LARGEST_MEMORY:
        problem = problem or f"{growth / 1e6:.0f} MB"
    return problem


def find_fault(message: str) -> str:
    """Return what is wrong with a message; empty if it is one line that ends as a sentence."""
    categories = {unicodedata.category(character) for character in message}
    if len(message.splitlines()) != 1 or categories & CONTROL_CATEGORIES:
        return f"not one line: {message[:200]!r}"
    if len(message) > LONGEST_MESSAGE:
        return f"{len(message)} characters: {message[:200]!r}"
    if not message.endswith((".", "?")) or "Traceback" in message:
        return f"no sentence: {message[:200]!r}"
    return ""


@contextmanager
def limit_time() -> Iterator[None]:
    """Raise `TooSlowError` in the block after `LONGEST_WAIT`; end the process if that has no effect."""

    def stop(*_: object) -> None:
        raise TooSlowError

    former = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LONGEST_WAIT)
    # A loop in compiled code never returns to Python's handler of the signal.
    faulthandler.dump_traceback_later(2 * LONGEST_WAIT, exit=True, file=sys.__stderr__ or 2)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, former)


def reset_peak_memory() -> int:
    """Reset the peak of this process's memory, and return it, bytes; only Linux can reset it."""
    reset = Path("/proc/self/clear_refs")
    if reset.exists():
        reset.write_text("5")
    return read_peak_memory()


def read_peak_memory() -> int:
    """Return the peak of this process's memory, bytes."""
    status = Path("/proc/self/status")
    if not status.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    lines = status.read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM"))


def _list_special_files(folder: str, names: list[str]) -> list[str]:
    """Return the names that cannot be copied, such as pipes."""
    paths = {name: Path(folder) / name for name in names}
    return [
        n for n, path in paths.items() if not path.is_symlink() and not path.is_file() and not path.is_dir()
    ]


def main() -> None:
    words, file = arguments()
    parser = argparse.ArgumentParser(prog="python -m tests.faults.mutate")
    parser.add_argument("count", nargs="?", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args(words)
    table = Table("input", "mutations", "accepted", "refused", "failures", "slowest [ms]", "memory [MB]")
    figures: dict[str, float] = {}
    failure_count = 0
    for name in options.only:
        tally = run_mutations(KINDS[name], options.count, options.seed, options.first, options.keep)
        failure_count += len(tally.failures)
        numbers = {
            "mutations": options.count,
            "accepted": tally.accepted,
            "refused": tally.refused,
            "failures": len(tally.failures),
            "slowest [ms]": float(f"{1e3 * tally.slowest:.3g}"),
            "memory [MB]": round(tally.largest / 1e6, 1),
        }
        table.add_row(name, *(f"{number:g}" for number in numbers.values()))
        figures |= {f"{name}, {label}": number for label, number in numbers.items()}
        for number, problem in tally.failures[:30]:
            print(f"{name} {number}: {problem}", file=sys.stderr)
    Console().print(table)
    keep(file, figures)
    raise SystemExit(1 if failure_count else 0)


if __name__ == "__main__":
    main()

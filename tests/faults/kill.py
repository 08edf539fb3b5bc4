"""Kill commands at random moments with SIGKILL, run them again, and compare with an undisturbed run.

    python -m tests.faults.kill [KILLS] [--seed S] [--only fit sample] [--minutes M] [--out DIR] [--json FILE]

KILLS is the number of moments for each command. Half of them are fractions of the time of an undisturbed run.
The others follow a change of the output folder, because a write takes only milliseconds. The same command is
killed up to `KILLS_IN_A_ROW` times and then runs to its end. After each kill, every file must be complete. At
the end the results must equal those of the undisturbed run, apart from times.
"""

from __future__ import annotations

import argparse
import itertools
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import pamjax
from tests.benchmarks.keep import arguments, keep
from tests.faults.read_back import find_differences, find_incomplete_files, list_leftovers, list_results
from tests.faults.small_cases import write_simulated_case, write_template_cases

#: Options that make each command fast. `case` and `cases` are folders beside `out`.
COMMANDS = {
    "fit": ("fit", "case", "--starts", "1", "--folds", "2"),
    "sample": (
        "sample", "case", "--ess", "100", "--rhat", "1.2", "--max-draws", "1000",
        "--no-figures", "--no-report",
    ),
    "diagnose": ("diagnose", "case", "--no-compare", "--no-report"),
    "prove": ("prove", "--stage", "score", "--nothing", "3", "--single", "0", "--outside", "0"),
    "fleet": (
        "fleet", "cases", "--stage", "check", "fit", "--workers", "1", "--no-figures", "--no-report",
    ),
}  # fmt: skip

#: Folder of the package, because the runs have other working folders.
SOURCES = str(Path(pamjax.__file__).parents[1])
#: Largest number of kills of one command before it runs to its end.
KILLS_IN_A_ROW = 4
#: Longest time between a change of the folder and a kill, s: about the time of a write.
LONGEST_DELAY = 0.05
#: Time between two looks at the folder, s.
LOOK_TIME = 0.01
#: Longest time of a run, s; a longer one counts as hanging.
LONGEST_RUN = 900.0


@dataclass(frozen=True)
class Moment:
    """When a run is killed: a time after its start, or after a change of its output folder.

    Attributes:
        delay: time after the start or the change, s.
        change: number of the change, from 1; 0 for the start.
    """

    delay: float
    change: int = 0


@dataclass
class Tally:
    """Results of the kills of one command.

    Attributes:
        kills: moments that were drawn.
        landed: kills that ended the command before its own end.
        runs: runs that were completed after their kills.
        equal: completed runs with the results of the undisturbed run.
        incomplete: files that could not be read after a kill, each with its error.
        different: files that differ from those of the undisturbed run, or the error of the command.
        leftovers: temporary files that completed runs leave.
    """

    kills: int = 0
    landed: int = 0
    runs: int = 0
    equal: int = 0
    incomplete: list[str] = field(default_factory=list)
    different: list[str] = field(default_factory=list)
    leftovers: int = 0

    @property
    def is_clean(self) -> bool:
        """Return whether no file was incomplete and all runs are equal."""
        return not self.incomplete and self.equal == self.runs


class KillTrial:
    """One command, its undisturbed run, and the tally of its kills.

    Args:
        name: name of the command in `COMMANDS`.
        words: arguments of the command without `--out`.
        inputs: folder with `case` and `cases`.
        folder: folder of the runs.
        seed: seed of the moments.
    """

    def __init__(self, name: str, words: Sequence[str], inputs: Path, folder: Path, seed: int) -> None:
        self.words, self.inputs, self.folder = words, inputs, folder / name
        # Reports and stores contain their path, so all runs use the same one.
        self.work, self.undisturbed = self.folder / "work", self.folder / "undisturbed"
        self.random = np.random.default_rng([seed, *name.encode()])
        self.tally = Tally()
        self.duration, self.changes = 0.0, 0

    def run_undisturbed(self) -> None:
        """Run the command to its end, measure its time, and count the changes of its folder."""
        self._prepare()
        start = time.monotonic()
        process = self._start()
        self.changes = sum(1 for _ in self._iterate_changes(process))
        self._finish(process)
        self.duration = time.monotonic() - start
        if incomplete := find_incomplete_files(self.work / "out"):
            raise SystemExit(f"undisturbed run: {incomplete}")
        os.rename(self.work, self.undisturbed)

    def run_killed(self, kills: int) -> None:
        """Kill the command up to `kills` times, complete it, and compare its results."""
        self._prepare()
        for k in range(kills):
            self.tally.kills += 1
            start, process = time.monotonic(), self._start()
            is_killed = self._kill_at(process, self._draw_moment())
            self.tally.landed += is_killed
            self.tally.incomplete += find_incomplete_files(self.work / "out")
            if not is_killed:
                if k == 0:
                    # The undisturbed run may also compile, and then later runs are shorter.
                    self.duration = min(self.duration, time.monotonic() - start)
                break
        self.tally.runs += 1
        try:
            self._finish(self._start())
        except RuntimeError as error:
            self.tally.different.append(str(error))
            return
        differences = find_differences(self.work / "out", self.undisturbed / "out")
        self.tally.different += differences
        self.tally.equal += not differences
        self.tally.leftovers += len(list_leftovers(self.work / "out"))

    def _prepare(self) -> None:
        shutil.rmtree(self.work, ignore_errors=True)
        # A worker of a killed fleet may still write here.
        shutil.copytree(self.inputs, self.work, dirs_exist_ok=True)

    def _start(self) -> subprocess.Popen[str]:
        command = [*self._list_command(), "--out", "out"]
        with (self.folder / "errors.txt").open("w") as errors:
            return subprocess.Popen(
                command, cwd=self.work, stdout=subprocess.DEVNULL, stderr=errors, text=True,
                env={**os.environ, "PYTHONPATH": SOURCES},
            )  # fmt: skip

    def _list_command(self) -> list[str]:
        return [sys.executable, "-m", "pamjax", *self.words]

    def _finish(self, process: subprocess.Popen[str]) -> None:
        """Wait for the end of a run.

        Raises:
            RuntimeError: if it takes too long, or ends with an error.
        """
        try:
            code = process.wait(timeout=LONGEST_RUN)
        except subprocess.TimeoutExpired as error:
            process.kill()
            raise RuntimeError(f"no end after {LONGEST_RUN:g} s") from error
        if code:
            message = (self.folder / "errors.txt").read_text()[-1000:]
            raise RuntimeError(f"exit code {code}: {message}")

    def _draw_moment(self) -> Moment:
        if self.changes and self.random.random() < 0.5:
            change = int(self.random.integers(1, self.changes, endpoint=True))
            return Moment(float(self.random.uniform(0.0, LONGEST_DELAY)), change)
        return Moment(float(self.random.uniform(0.0, self.duration)))

    def _kill_at(self, process: subprocess.Popen[str], moment: Moment) -> bool:
        """Kill a run at a moment; return whether it was still running."""
        if moment.change:
            changes = self._iterate_changes(process)
            next(itertools.islice(changes, moment.change - 1, None), None)
        try:
            process.wait(timeout=moment.delay)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
        return process.wait() == -signal.SIGKILL

    def _iterate_changes(self, process: subprocess.Popen[str]) -> Iterator[None]:
        """Yield at each change of the output folder, until the process ends."""
        before = self._describe_folder()
        while process.poll() is None:
            time.sleep(LOOK_TIME)
            now = self._describe_folder()
            if now != before:
                before = now
                yield

    def _describe_folder(self) -> frozenset[tuple[str, int]]:
        """Return the names and sizes of all files, temporary ones included."""
        paths = (
            os.path.join(root, name)
            for root, _, names in os.walk(self.work / "out")
            for name in names
        )  # fmt: skip
        return frozenset((path, _measure_size(path)) for path in paths)


def _measure_size(path: str) -> int:
    """Return the size of a file in bytes, or -1 if it has disappeared since it was listed."""
    try:
        return os.path.getsize(path)
    except FileNotFoundError:
        return -1


def main() -> None:
    words, file = arguments()
    parser = argparse.ArgumentParser(prog="python -m tests.faults.kill")
    parser.add_argument("kills", nargs="?", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    parser.add_argument("--minutes", type=float, default=float("inf"))
    parser.add_argument("--out", type=Path)
    options = parser.parse_args(words)
    end = time.monotonic() + 60.0 * options.minutes
    with tempfile.TemporaryDirectory() as scratch:
        folder = (options.out or Path(scratch)).resolve()

        def keep_figures(trials: dict[str, KillTrial]) -> None:
            keep(file, list_figures(trials))

        trials = run_trials(options.only, options.kills, options.seed, folder, end, keep_figures)
    print_table(trials)
    raise SystemExit(0 if all(trial.tally.is_clean for trial in trials.values()) else 1)


def run_trials(
    names: Sequence[str],
    kills: int,
    seed: int,
    folder: Path,
    end: float = float("inf"),
    report: Callable[[dict[str, KillTrial]], None] = lambda trials: None,
) -> dict[str, KillTrial]:
    """Return the trials of some commands after their kills.

    Args:
        names: the commands.
        kills: number of moments for each command.
        seed: seed of the moments.
        folder: folder of the runs.
        end: time of `time.monotonic` after which no further run starts.
        report: called with all trials after each completed run, so that an interrupted study has figures.
    """
    inputs = write_inputs(folder / "inputs")
    trials = {name: KillTrial(name, COMMANDS[name], inputs, folder, seed) for name in names}
    for name, trial in trials.items():
        trial.folder.mkdir(parents=True)
        trial.run_undisturbed()
        print(f"{name}: undisturbed run, {trial.duration:.0f} s", file=sys.stderr)
    # In turn, so that a limit of time leaves similar numbers for all commands.
    while time.monotonic() < end and (open_trials := [t for t in trials.values() if t.tally.kills < kills]):
        for trial in open_trials:
            if time.monotonic() < end:
                trial.run_killed(min(KILLS_IN_A_ROW, kills - trial.tally.kills))
                _report_failures(trial)
                report(trials)
    return trials


def write_inputs(folder: Path) -> Path:
    """Write the case folders of all commands, and return their folder."""
    made = write_simulated_case(folder / "simulation")
    os.rename(made, folder / "case")
    shutil.rmtree(folder / "simulation")
    write_template_cases(folder / "cases")
    return folder


def _report_failures(trial: KillTrial) -> None:
    tally = trial.tally
    print(f"{trial.words[0]}: {tally.landed} of {tally.kills} kills landed", file=sys.stderr)
    for text in (*tally.incomplete, *tally.different):
        print(f"  {text}", file=sys.stderr)


def print_table(trials: dict[str, KillTrial]) -> None:
    """Print the tally of each command."""
    table = Table("command", "kills", "landed", "incomplete files", "runs", "equal runs")
    for name, trial in trials.items():
        tally = trial.tally
        numbers = tally.kills, tally.landed, len(tally.incomplete), tally.runs, tally.equal
        table.add_row(name, *map(str, numbers))
    Console().print(table)


def list_figures(trials: dict[str, KillTrial]) -> dict[str, float]:
    """Return the numbers of all tallies by label."""
    figures: dict[str, float] = {}
    for name, trial in trials.items():
        tally = trial.tally
        figures |= {
            f"{name}, undisturbed run [s]": trial.duration,
            f"{name}, changes of the folder": trial.changes,
            f"{name}, kills": tally.kills,
            f"{name}, kills that landed": tally.landed,
            f"{name}, incomplete files": len(tally.incomplete),
            f"{name}, completed runs": tally.runs,
            f"{name}, equal runs": tally.equal,
            f"{name}, temporary files left": tally.leftovers,
            f"{name}, result files": len(list(list_results(trial.undisturbed / "out"))),
        }
    totals = [trial.tally for trial in trials.values()]
    figures["all kills"] = sum(tally.kills for tally in totals)
    figures["all kills that landed"] = sum(tally.landed for tally in totals)
    return figures


if __name__ == "__main__":
    main()

"""A proof counts what it should, with its interval, and goes on where it was stopped."""

import math
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from pamjax.benchmark.prove import build_tasks, read_trials, run_proof
from pamjax.benchmark.rates import Rate, build_documents, format_markdown
from pamjax.benchmark.tally import (
    compute_coverage,
    compute_reliability,
    tabulate_false_alarms,
    tabulate_recovery,
    tabulate_trials,
)
from pamjax.benchmark.trial import RecoveredParameter, Trial, TrialTask, parse_trial
from pamjax.errors import BadInput
from tests.benchmark.trials import made_up, uniform

COUNTS = {"nothing": 4, "single": 6, "pair": 3, "triple": 2, "outside": 2}


def trial(kind="pair", concealed=("end_taper", "force_offset"), named=("end_taper", "force_gain"), **more):
    told = {"sizes": (4.0, 9.0)[: len(concealed)], "p_value": 1e-9, "ties": ((),) * len(named)}
    told |= {"probabilities": (0.9,) * len(named)} | more
    return Trial("all", kind, 0.5, 0, 0, "elastic", "isobars", concealed, named=named, **told)


@pytest.mark.parametrize(("hits", "of"), [(0, 100), (3, 40), (40, 40), (1000, 2000)])
def test_the_limits_of_a_rate_are_where_binomial_tails_are_what_they_should(hits, of):
    low, high = Rate(hits, of).compute_interval()
    if hits:
        assert binom.sf(hits - 1, of, low) == pytest.approx(0.025, rel=1e-6)
    if hits < of:
        assert binom.cdf(hits, of, high) == pytest.approx(0.025, rel=1e-6)
        assert binom.cdf(hits, of, Rate(hits, of).upper_limit) == pytest.approx(0.05, rel=1e-6)


def test_no_alarm_in_two_hundred_leaves_one_and_a_half_percent():
    assert Rate(0, 200).upper_limit == pytest.approx(1 - 0.05 ** (1 / 200))


def test_a_right_name_is_right_and_another_wrong():
    one = trial()
    assert (one.effects_found, one.names_right, one.is_exact) == ((True, False), (True, False), False)


def test_a_stand_in_is_right_only_where_it_was_shown_to_be_one():
    said = trial(stand_ins=(("force_offset", "force_gain"),))
    assert said.effects_found == said.names_right == (True, True)
    assert said.is_exact
    # A tie that the tool offers counts for nothing by itself.
    assert not trial(ties=((), ("force_offset",))).is_exact


def test_nothing_is_alarmed_by_each_of_three():
    quiet = trial("nothing", (), (), p_value=0.5)
    assert not quiet.is_alarm
    assert trial("nothing", (), (), p_value=0.009).is_alarm
    assert trial("nothing", (), (), p_value=0.5, unexplained=True).is_alarm
    assert trial("nothing", (), ("force_gain",), p_value=0.5).is_alarm


def test_uniform_p_values_pass_and_others_do_not():
    p = (np.arange(500) + 0.5) / 500
    fair, squared = (
        [Trial("score", "nothing", 0.0, k, 0, "elastic", "isobars", p_value=v) for k, v in enumerate(values)]
        for values in (p.tolist(), (p**1.3).tolist())
    )
    (_, fine), (_, bad) = (tabulate_false_alarms(group) for group in (fair, squared))
    chance = [float(line.text.split()[2]) for line in (fine, bad)]
    assert chance[0] > 0.05 > 1e-3 > chance[1]


def test_intervals_count_as_covering_when_they_do():
    def numbers(z):
        return tuple(RecoveredParameter("force_gain.gain", 0.0, value, 1.0, True) for value in z)

    normal = np.random.default_rng(0).standard_normal(2000)
    low, high = compute_coverage([trial(numbers=numbers(normal))], own=False).compute_interval(0.999)
    assert low < 0.9 < high
    assert (
        compute_coverage([trial(numbers=numbers(1.5 * normal))], own=False).compute_interval(0.999)[1] < 0.9
    )
    assert compute_coverage([trial(numbers=numbers(normal))], own=True).total == 0


def test_probabilities_are_held_against_how_often_they_were_right():
    told = compute_reliability([trial(probabilities=(0.99, 0.6)), trial(probabilities=(0.98, 0.7))])
    assert [(round(p, 3), rate.hits, rate.total) for p, rate in told] == [(0.65, 0, 2), (0.985, 2, 2)]


def test_obvious_effects_are_counted_apart():
    some = [trial("single", ("end_taper",), ("end_taper",), sizes=(9.0,)),
            trial("single", ("end_taper",), ("force_gain",), sizes=(4.0,))]  # fmt: skip
    told = {line.label: line.rate for line in tabulate_recovery(some)}
    assert told["single, obvious (8 sd and more): first name right"] == Rate(1, 1)
    assert told["single, just detectable (3 to 8 sd): first name right"] == Rate(0, 1)


def test_a_trial_is_read_as_it_was_written():
    one = made_up(TrialTask("all", "triple", 0.9, 3))
    assert parse_trial(one.format_line()) == one


def test_a_stopped_run_goes_on_where_it_was(tmp_path):
    file, tasks, asked = tmp_path / "trials.jsonl", build_tasks(COUNTS, (0.0, 0.9)), []

    def stopping(task):
        if len(asked) == 5:
            raise KeyboardInterrupt
        asked.append(task)
        return made_up(task)

    with pytest.raises(KeyboardInterrupt):
        run_proof(tasks, file, attempt=stopping)
    assert len(read_trials(file)) == 5
    # A power cut: the last line is half there.
    whole = file.read_text()
    file.write_text(whole[: -len(whole.splitlines()[-1]) // 2])
    assert len(read_trials(file)) == 4
    again = []
    trials = run_proof(tasks, file, attempt=lambda task: again.append(task) or made_up(task))
    assert len(again) == len(tasks) - 4
    assert trials == [made_up(task) for task in tasks]
    assert run_proof(tasks, file, attempt=stopping) == trials


@pytest.mark.slow
def test_two_processes_give_the_same_trials(tmp_path):
    tasks = build_tasks({"nothing": 6}, (0.5,), stage="score")
    alone = run_proof(tasks, tmp_path / "one.jsonl", attempt=uniform)
    assert run_proof(tasks, tmp_path / "two.jsonl", workers=2, attempt=uniform) == alone


@pytest.mark.slow
def test_the_processes_of_a_killed_proof_end_with_it(tmp_path):
    words = (
        "from pathlib import Path\n"
        "from pamjax.benchmark.prove import run_proof, build_tasks\n"
        "from tests.benchmark.trials import endless\n"
        "if __name__ == '__main__':\n"
        f"    file = Path({str(tmp_path)!r}) / 'trials.jsonl'\n"
        "    run_proof(build_tasks({'nothing': 4}, [0.0]), file, workers=2, attempt=endless)\n"
    )
    script = tmp_path / "killed.py"
    script.write_text(words)
    root = str(Path(__file__).parents[2])
    own = {"PAMJAX_TEST_FOLDER": str(tmp_path), "PYTHONPATH": root}
    proof = subprocess.Popen([sys.executable, str(script)], env={**os.environ, **own})
    try:
        _until(lambda: list(tmp_path.glob("*.pid")))
        helpers = [int(path.stem) for path in tmp_path.glob("*.pid")]
    finally:
        proof.kill()
        proof.wait()
    _until(lambda: not any(map(_runs, helpers)))


def _until(happened, seconds=60.0):
    end = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < end
        time.sleep(0.1)


def _runs(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{process}/stat")
    return not (status.exists() and status.read_text().rpartition(")")[2].split()[0] == "Z")


def test_another_seed_is_another_proof(tmp_path):
    file = tmp_path / "trials.jsonl"
    run_proof(build_tasks({"nothing": 2}, (0.0,)), file, attempt=made_up)
    run_proof(build_tasks({"nothing": 2}, (0.0,), seed=1), file, attempt=made_up)
    assert len(read_trials(file)) == 4


def test_a_file_of_something_else_is_refused(tmp_path):
    file = tmp_path / "trials.jsonl"
    file.write_text('{"kind": "single"}\n')
    with pytest.raises(BadInput, match=r"line 1 of trials\.jsonl"):
        read_trials(file)


def test_the_table_says_the_same_in_three_forms():
    lines = tabulate_trials([made_up(task) for task in build_tasks(COUNTS, (0.0, 0.9))])
    told = build_documents(lines)
    assert set(told) == {"table.md", "table.csv", "table.json"}
    assert told["table.md"] == format_markdown(lines)
    assert all(line.label in told["table.csv"] and line.label in told["table.md"] for line in lines)
    assert not any(math.isnan(line.rate.share) for line in lines if line.rate and line.rate.total)

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

from pamjax.benchmark.prove import prove, read_trials, tasks_of
from pamjax.benchmark.rates import Rate, as_markdown, documents
from pamjax.benchmark.tally import alarms, covered, recovery, reliability, table
from pamjax.benchmark.trial import Recovered, Task, Trial, read_line
from pamjax.errors import BadInput
from tests.benchmark.trials import made_up, uniform

COUNTS = {"nothing": 4, "single": 6, "pair": 3, "triple": 2, "outside": 2}


def trial(kind="pair", concealed=("end_taper", "force_offset"), named=("end_taper", "force_gain"), **more):
    told = {"sizes": (4.0, 9.0)[: len(concealed)], "p_value": 1e-9, "ties": ((),) * len(named)}
    told |= {"probabilities": (0.9,) * len(named)} | more
    return Trial("all", kind, 0.5, 0, 0, "elastic", "isobars", concealed, named=named, **told)


@pytest.mark.parametrize(("hits", "of"), [(0, 100), (3, 40), (40, 40), (1000, 2000)])
def test_the_limits_of_a_rate_are_where_binomial_tails_are_what_they_should(hits, of):
    low, high = Rate(hits, of).limits()
    if hits:
        assert binom.sf(hits - 1, of, low) == pytest.approx(0.025, rel=1e-6)
    if hits < of:
        assert binom.cdf(hits, of, high) == pytest.approx(0.025, rel=1e-6)
        assert binom.cdf(hits, of, Rate(hits, of).at_most) == pytest.approx(0.05, rel=1e-6)


def test_no_alarm_in_two_hundred_leaves_one_and_a_half_percent():
    assert Rate(0, 200).at_most == pytest.approx(1 - 0.05 ** (1 / 200))


def test_a_right_name_is_right_and_another_wrong():
    one = trial()
    assert (one.found, one.right, one.exact) == ((True, False), (True, False), False)


def test_a_stand_in_is_right_only_where_it_was_shown_to_be_one():
    said = trial(stand_ins=(("force_offset", "force_gain"),))
    assert said.found == said.right == (True, True)
    assert said.exact
    # A tie that the tool offers counts for nothing by itself.
    assert not trial(ties=((), ("force_offset",))).exact


def test_nothing_is_alarmed_by_each_of_three():
    quiet = trial("nothing", (), (), p_value=0.5)
    assert not quiet.alarm
    assert trial("nothing", (), (), p_value=0.009).alarm
    assert trial("nothing", (), (), p_value=0.5, unexplained=True).alarm
    assert trial("nothing", (), ("force_gain",), p_value=0.5).alarm


def test_uniform_p_values_pass_and_others_do_not():
    p = (np.arange(500) + 0.5) / 500
    fair, squared = (
        [Trial("score", "nothing", 0.0, k, 0, "elastic", "isobars", p_value=v) for k, v in enumerate(values)]
        for values in (p.tolist(), (p**1.3).tolist())
    )
    (_, fine), (_, bad) = (alarms(group) for group in (fair, squared))
    chance = [float(line.text.split()[2]) for line in (fine, bad)]
    assert chance[0] > 0.05 > 1e-3 > chance[1]


def test_intervals_count_as_covering_when_they_do():
    def numbers(z):
        return tuple(Recovered("force_gain.gain", 0.0, value, 1.0, True) for value in z)

    normal = np.random.default_rng(0).standard_normal(2000)
    low, high = covered([trial(numbers=numbers(normal))], own=False).limits(0.999)
    assert low < 0.9 < high
    assert covered([trial(numbers=numbers(1.5 * normal))], own=False).limits(0.999)[1] < 0.9
    assert covered([trial(numbers=numbers(normal))], own=True).of == 0


def test_probabilities_are_held_against_how_often_they_were_right():
    told = reliability([trial(probabilities=(0.99, 0.6)), trial(probabilities=(0.98, 0.7))])
    assert [(round(p, 3), rate.hits, rate.of) for p, rate in told] == [(0.65, 0, 2), (0.985, 2, 2)]


def test_obvious_effects_are_counted_apart():
    some = [trial("single", ("end_taper",), ("end_taper",), sizes=(9.0,)),
            trial("single", ("end_taper",), ("force_gain",), sizes=(4.0,))]  # fmt: skip
    told = {line.what: line.rate for line in recovery(some)}
    assert told["single, obvious (8 sd and more): first name right"] == Rate(1, 1)
    assert told["single, just detectable (3 to 8 sd): first name right"] == Rate(0, 1)


def test_a_trial_is_read_as_it_was_written():
    one = made_up(Task("all", "triple", 0.9, 3))
    assert read_line(one.line()) == one


def test_a_stopped_run_goes_on_where_it_was(tmp_path):
    file, tasks, asked = tmp_path / "trials.jsonl", tasks_of(COUNTS, (0.0, 0.9)), []

    def stopping(task):
        if len(asked) == 5:
            raise KeyboardInterrupt
        asked.append(task)
        return made_up(task)

    with pytest.raises(KeyboardInterrupt):
        prove(tasks, file, attempt=stopping)
    assert len(read_trials(file)) == 5
    # A power cut: the last line is half there.
    whole = file.read_text()
    file.write_text(whole[: -len(whole.splitlines()[-1]) // 2])
    assert len(read_trials(file)) == 4
    again = []
    trials = prove(tasks, file, attempt=lambda task: again.append(task) or made_up(task))
    assert len(again) == len(tasks) - 4
    assert trials == [made_up(task) for task in tasks]
    assert prove(tasks, file, attempt=stopping) == trials


@pytest.mark.slow
def test_two_processes_give_the_same_trials(tmp_path):
    tasks = tasks_of({"nothing": 6}, (0.5,), stage="score")
    alone = prove(tasks, tmp_path / "one.jsonl", attempt=uniform)
    assert prove(tasks, tmp_path / "two.jsonl", workers=2, attempt=uniform) == alone


@pytest.mark.slow
def test_the_processes_of_a_killed_proof_end_with_it(tmp_path):
    words = (
        "from pathlib import Path\n"
        "from pamjax.benchmark.prove import prove, tasks_of\n"
        "from tests.benchmark.trials import endless\n"
        "if __name__ == '__main__':\n"
        f"    file = Path({str(tmp_path)!r}) / 'trials.jsonl'\n"
        "    prove(tasks_of({'nothing': 4}, [0.0]), file, workers=2, attempt=endless)\n"
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
    prove(tasks_of({"nothing": 2}, (0.0,)), file, attempt=made_up)
    prove(tasks_of({"nothing": 2}, (0.0,), seed=1), file, attempt=made_up)
    assert len(read_trials(file)) == 4


def test_a_file_of_something_else_is_refused(tmp_path):
    file = tmp_path / "trials.jsonl"
    file.write_text('{"kind": "single"}\n')
    with pytest.raises(BadInput, match=r"line 1 of trials\.jsonl"):
        read_trials(file)


def test_the_table_says_the_same_in_three_forms():
    lines = table([made_up(task) for task in tasks_of(COUNTS, (0.0, 0.9))])
    told = documents(lines)
    assert set(told) == {"table.md", "table.csv", "table.json"}
    assert told["table.md"] == as_markdown(lines)
    assert all(line.what in told["table.csv"] and line.what in told["table.md"] for line in lines)
    assert not any(math.isnan(line.rate.share) for line in lines if line.rate and line.rate.of)

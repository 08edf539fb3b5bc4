"""The simulation study: counts, confidence intervals, and continuation after an interruption."""

import math
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from pamjax.benchmark import trial as trial_module
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
from tests.agreement import RECOVERED
from tests.benchmark.trials import made_up, uniform
from tests.diagnosis.bank import build_setup

COUNTS = {"nothing": 4, "single": 6, "pair": 3, "triple": 2, "outside": 2}


def trial(kind="pair", concealed=("end_taper", "force_offset"), named=("end_taper", "force_gain"), **more):
    result = {"sizes": (4.0, 9.0)[: len(concealed)], "p_value": 1e-9, "ties": ((),) * len(named)}
    result |= {"probabilities": (0.9,) * len(named)} | more
    return Trial("all", kind, 0.5, 0, 0, "elastic", "isobars", concealed, named=named, **result)


@pytest.mark.parametrize(("hits", "of"), [(0, 100), (3, 40), (40, 40), (1000, 2000)])
def test_limits_of_a_rate_agree_with_binomial_tails(hits, of):
    low, high = Rate(hits, of).compute_interval()
    if hits:
        assert binom.sf(hits - 1, of, low) == pytest.approx(0.025, rel=1e-6)
    if hits < of:
        assert binom.cdf(hits, of, high) == pytest.approx(0.025, rel=1e-6)
        assert binom.cdf(hits, of, Rate(hits, of).upper_limit) == pytest.approx(0.05, rel=1e-6)


@pytest.mark.parametrize(
    ("hits", "of", "low", "high"),
    [(81, 263, 0.2527, 0.3676), (15, 148, 0.0578, 0.1617), (0, 20, 0.0, 0.1684), (1, 29, 0.0009, 0.1776)],
)
def test_an_interval_is_the_printed_clopper_pearson_interval(hits, of, low, high):
    """The values are those of R. G. Newcombe, Statistics in Medicine 17, 857 (1998), table I."""
    assert Rate(hits, of).compute_interval() == pytest.approx((low, high), abs=5e-5)


def test_a_rate_without_data_has_the_widest_interval():
    assert Rate(0, 0).compute_interval() == (0.0, 1.0)


def test_upper_limit_of_zero_in_two_hundred_is_one_and_a_half_percent():
    assert Rate(0, 200).upper_limit == pytest.approx(1 - 0.05 ** (1 / 200))


def test_correct_and_wrong_names_are_counted():
    result = trial()
    assert (result.effects_found, result.names_right, result.is_exact) == (
        (True, False),
        (True, False),
        False,
    )


def test_substitute_counts_as_correct_only_if_it_is_indistinguishable():
    result = trial(verified_ties=(("force_offset", "force_gain"),))
    assert result.effects_found == result.names_right == (True, True)
    assert result.is_exact
    # A tie that the tool reports is not sufficient evidence.
    assert not trial(ties=((), ("force_offset",))).is_exact


def test_false_alarms_are_counted_for_all_three_criteria():
    quiet = trial("nothing", (), (), p_value=0.5)
    assert not quiet.is_alarm
    assert trial("nothing", (), (), p_value=0.009).is_alarm
    assert trial("nothing", (), (), p_value=0.5, unexplained=True).is_alarm
    assert trial("nothing", (), ("force_gain",), p_value=0.5).is_alarm


def test_only_uniform_p_values_pass():
    p = (np.arange(500) + 0.5) / 500
    fair, squared = (
        [Trial("score", "nothing", 0.0, k, 0, "elastic", "isobars", p_value=v) for k, v in enumerate(values)]
        for values in (p.tolist(), (p**1.3).tolist())
    )
    (_, fine), (_, bad) = (tabulate_false_alarms(group) for group in (fair, squared))
    chance = [float(line.text.split()[2]) for line in (fine, bad)]
    assert chance[0] > 0.05 > 1e-3 > chance[1]


def test_coverage_of_intervals_is_counted():
    def numbers(z):
        return tuple(RecoveredParameter("force_gain.gain", 0.0, value, 1.0, True) for value in z)

    normal = np.random.default_rng(0).standard_normal(2000)
    low, high = compute_coverage([trial(parameters=numbers(normal))], own=False).compute_interval(0.999)
    assert low < 0.9 < high
    assert (
        compute_coverage([trial(parameters=numbers(1.5 * normal))], own=False).compute_interval(0.999)[1]
        < 0.9
    )
    assert compute_coverage([trial(parameters=numbers(normal))], own=True).total == 0


def test_probabilities_are_compared_with_the_fraction_of_correct_names():
    result = compute_reliability([trial(probabilities=(0.99, 0.6)), trial(probabilities=(0.98, 0.7))])
    assert [(round(p, 3), rate.hits, rate.total) for p, rate in result] == [(0.65, 0, 2), (0.985, 2, 2)]


def test_large_effects_are_counted_separately():
    some = [trial("single", ("end_taper",), ("end_taper",), sizes=(9.0,)),
            trial("single", ("end_taper",), ("force_gain",), sizes=(4.0,))]  # fmt: skip
    result = {line.label: line.rate for line in tabulate_recovery(some)}
    assert result["one effect of 8 sd or more: first mechanism correct"] == Rate(1, 1)
    assert result["one effect of 3 to 8 sd: first mechanism correct"] == Rate(0, 1)


def test_trial_is_unchanged_after_writing_and_reading():
    result = made_up(TrialTask("all", "triple", 0.9, 3))
    assert parse_trial(result.format_line()) == result


@pytest.mark.parametrize(("bank", "name"), [("own", "verified_ties"), ("other-forms", "reported_ties")])
def test_ties_of_a_saved_trial_belong_to_their_bank(bank, name):
    line = (
        f'{{"stage": "all", "kind": "pair", "correlation": 0.0, "number": 7, "seed": 0, "law": "elastic",'
        f' "blocks": "isobars", "stand_ins": [["force_offset", "force_gain"]], "bank": "{bank}"}}'
    )
    saved = parse_trial(line)
    assert (saved.trial_index, getattr(saved, name)) == (7, (("force_offset", "force_gain"),))
    assert len(saved.verified_ties + saved.reported_ties) == 1
    assert parse_trial(saved.format_line()) == saved


def test_interrupted_run_is_continued(tmp_path):
    file, tasks, run_tasks = tmp_path / "trials.jsonl", build_tasks(COUNTS, (0.0, 0.9)), []

    def stopping(task):
        if len(run_tasks) == 5:
            raise KeyboardInterrupt
        run_tasks.append(task)
        return made_up(task)

    with pytest.raises(KeyboardInterrupt):
        run_proof(tasks, file, attempt=stopping)
    assert len(read_trials(file)) == 5
    # After a power failure the last line may be incomplete.
    whole = file.read_text()
    file.write_text(whole[: -len(whole.splitlines()[-1]) // 2])
    assert len(read_trials(file)) == 4
    again = []
    trials = run_proof(tasks, file, attempt=lambda task: again.append(task) or made_up(task))
    assert len(again) == len(tasks) - 4
    assert trials == [made_up(task) for task in tasks]
    assert run_proof(tasks, file, attempt=stopping) == trials


@pytest.mark.slow
def test_trials_of_small_recordings_agree_with_what_was_injected(tmp_path, monkeypatch):
    """One muscle and bench for all trials: its recordings share the compiled program of the bank."""
    monkeypatch.setattr(trial_module, "draw_setup", lambda rng: build_setup())
    file = tmp_path / "trials.jsonl"
    tasks = build_tasks({"nothing": 1, "single": 1}, (0.5,), seed=3, with_competitors=True)
    nothing, single = trials = run_proof(tasks, file)
    assert [trial.error for trial in trials] == ["", ""]
    assert read_trials(file) == trials
    assert not nothing.is_alarm
    assert single.is_exact
    assert single.after["force"] < min(1.3, single.before["force"])
    assert single.selected
    assert single.iou is not None
    assert all(abs(n.value - n.true) < RECOVERED * n.sd for n in single.parameters if n.same)
    # The stage without a selection of mechanisms has the same recordings and p-values.
    (score,) = run_proof(build_tasks({"nothing": 1}, (0.5,), stage="score", seed=3), file)
    assert score.p_value == pytest.approx(nothing.p_value)


@pytest.mark.slow
def test_number_of_processes_does_not_change_the_trials(tmp_path):
    tasks = build_tasks({"nothing": 6}, (0.5,), stage="score")
    alone = run_proof(tasks, tmp_path / "one.jsonl", attempt=uniform)
    assert run_proof(tasks, tmp_path / "two.jsonl", workers=2, attempt=uniform) == alone


@pytest.mark.slow
def test_child_processes_end_with_a_killed_run(tmp_path):
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


def test_trials_of_another_seed_are_not_reused(tmp_path):
    file = tmp_path / "trials.jsonl"
    run_proof(build_tasks({"nothing": 2}, (0.0,)), file, attempt=made_up)
    run_proof(build_tasks({"nothing": 2}, (0.0,), seed=1), file, attempt=made_up)
    assert len(read_trials(file)) == 4


def test_file_of_another_kind_is_refused(tmp_path):
    file = tmp_path / "trials.jsonl"
    file.write_text('{"kind": "single"}\n')
    with pytest.raises(BadInput, match=r"line 1 of trials\.jsonl"):
        read_trials(file)


def test_three_forms_of_the_table_agree():
    lines = tabulate_trials([made_up(task) for task in build_tasks(COUNTS, (0.0, 0.9))])
    result = build_documents(lines)
    assert set(result) == {"table.md", "table.csv", "table.json"}
    assert result["table.md"] == format_markdown(lines)
    assert all(line.label in result["table.csv"] and line.label in result["table.md"] for line in lines)
    assert not any(math.isnan(line.rate.share) for line in lines if line.rate and line.rate.total)

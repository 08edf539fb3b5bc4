"""Grades of the bank of other forms: correct mechanisms, tables, and continuation of a killed run."""

import math
from dataclasses import replace

import pytest

from pamjax.benchmark.bank_tally import compute_f1, tabulate_bank
from pamjax.benchmark.bank_trial import draw_task_recording, find_reported_ties, run_bank_trial
from pamjax.benchmark.other_forms import draw
from pamjax.benchmark.other_forms.case_files import build_bank_case
from pamjax.benchmark.other_forms.draw import BANK_KINDS
from pamjax.benchmark.prove import build_tasks, read_trials, run_proof
from pamjax.benchmark.rates import Rate
from pamjax.benchmark.trial import RecoveredParameter, Trial, TrialTask, parse_trial
from tests.diagnosis.bank import build_setup

COUNTS = dict.fromkeys(BANK_KINDS, 2)


def build_trial(
    kind="pair", concealed=("end_taper", "force_gain"), named=("end_taper", "force_gain"), **more
):
    ties = more.pop("ties", tuple(() for _ in named))
    result = {"forms": tuple("usual" if id == "force_gain" else "cone" for id in concealed), "ties": ties}
    result |= {"sizes": (4.0, 9.0, 20.0)[: len(concealed)], "probabilities": (0.9,) * len(named)}
    result |= {"reported_ties": find_reported_ties(set(concealed), named, ties), "p_value": 1e-9}
    return Trial(
        "all", kind, 0.5, 0, 0, "elastic", "isobars", concealed, named=named, bank="other-forms",
        **(result | more),
    )  # fmt: skip


def make_up(task):
    """Return a trial that names every second recording right; importable by its name."""
    count, has_outside = BANK_KINDS[task.kind]
    ids = ("end_taper", "force_gain", "braid_friction")[:count]
    return replace(
        build_trial(task.kind, ids, ids if task.trial_index % 2 else (), p_value=1.0 if not ids else 1e-9),
        correlation=task.correlation, trial_index=task.trial_index, seed=task.seed,
        outside="ripple" if has_outside else "", outside_size=5.0 * has_outside, unexplained=has_outside,
        misstated=bool(task.trial_index % 2),
    )  # fmt: skip


def tabulate(*trials):
    return {line.label: line.rate or line.text for line in tabulate_bank(trials)}


def test_name_counts_by_its_id_or_by_a_reported_tie():
    assert build_trial().is_exact
    tied = build_trial(named=("end_taper", "pressure_gain"), ties=((), ("force_gain",)))
    assert tied.effects_found == tied.names_right == (True, True)
    assert tied.is_exact


def test_wrong_name_and_tie_with_a_wrong_id_are_refused():
    """Negative control: a grader that accepts any tie would pass them."""
    wrong = build_trial(named=("end_taper", "pressure_gain"), ties=((), ("force_offset",)))
    assert wrong.names_right == wrong.effects_found == (True, False)
    result = tabulate(wrong)
    assert result["recall: effects named"] == Rate(1, 2)
    assert result["recall, effects in another form"] == Rate(1, 1)
    assert result["recall, offsets, gains and delays"] == Rate(0, 1)
    assert result["precision: named mechanisms that are correct"] == Rate(1, 2)
    assert result["exact, one to three effects"] == Rate(0, 1)
    assert result["first mechanism correct"] == Rate(1, 1)


def test_empty_and_perfect_answers_have_their_scores():
    silent = tabulate(build_trial(named=()))
    assert (silent["recall: effects named"], silent["F1"]) == (Rate(0, 2), "0.00")
    perfect = tabulate(build_trial(), build_trial("single", ("end_taper",), ("end_taper",)))
    assert (perfect["recall: effects named"], perfect["F1"]) == (Rate(3, 3), "1.00")
    assert perfect["exact, one effect"] == Rate(1, 1)
    assert compute_f1(Rate(0, 0), Rate(0, 0)) is None


def test_outside_effects_and_nulls_have_lines_of_their_own():
    outside = build_trial("outside", (), ("braid_locking",), outside="stop", unexplained=True)
    mixed = build_trial("mixed", ("end_taper",), ("end_taper",), outside="stop", unexplained=False)
    quiet = build_trial("nothing", (), (), p_value=0.5)
    result = tabulate(outside, mixed, quiet, replace(quiet, misstated=True, p_value=1e-4))
    assert result["outside alone: an unexplained misfit"] == Rate(1, 1)
    assert result["outside alone: a mechanism named"] == Rate(1, 1)
    assert result["outside with a mechanism: an unexplained misfit"] == Rate(0, 1)
    assert result["outside with a mechanism: the mechanism named"] == Rate(1, 1)
    assert result["nothing concealed, exact sensors: any alarm"] == Rate(0, 1)
    assert result["nothing concealed, misstated sensors: any alarm"] == Rate(1, 1)
    assert result["nothing concealed, misstated sensors: a mechanism named"] == Rate(0, 1)
    assert "recall: effects named" not in result


def test_intervals_probabilities_and_held_out_errors_are_counted():
    numbers = tuple(RecoveredParameter("force_gain.gain", 0.0, z, 1.0, True) for z in (0.5, 1.6, 1.7))
    trial = build_trial(parameters=numbers, held_out_ratios=(0.6, 1.1), probabilities=(0.6, 0.999))
    result = tabulate(trial)
    assert result["90 % intervals of offsets, gains and delays"] == Rate(2, 3)
    assert result["mechanisms that make the held-out error larger"] == Rate(1, 2)
    assert result["mechanisms with a mean probability of 0.999: correct"] == Rate(1, 1)
    assert result["effects of 2 to 5 sd named"] == result["effects of 5 to 10 sd named"] == Rate(1, 1)


def test_probability_of_an_outside_effect_is_compared_with_its_presence():
    present = build_trial("outside", (), (), outside="stop", unexplained_probability=0.94)
    absent = replace(present, kind="single", outside="")
    result = tabulate(present, present, absent)
    assert result["an effect outside the library with probability 0.940: present"] == Rate(2, 3)


def test_killed_run_continues_after_a_truncated_line(tmp_path):
    file, done = tmp_path / "trials.jsonl", []
    tasks = build_tasks(COUNTS, (0.0, 0.9), bank="other-forms", seed=4)
    assert len({task.key for task in tasks}) == len(tasks) == 24
    trials = run_proof(tasks, file, attempt=make_up)
    text = file.read_text()
    file.write_text(text[: -len(text.splitlines()[-1]) // 2])
    again = run_proof(tasks, file, attempt=lambda task: done.append(task) or make_up(task))
    assert (again, len(done)) == (trials, 1)
    assert [parse_trial(trial.format_line()) for trial in trials] == trials
    # Another seed and the other bank are other trials.
    other = build_tasks(COUNTS, (0.0, 0.9), bank="other-forms", seed=5)
    run_proof(other, file, attempt=make_up)
    assert len(read_trials(file)) == 48
    assert not {t.key for t in other} & {t.key for t in build_tasks(COUNTS, (0.0, 0.9), seed=4)}


def test_tasks_draw_the_same_recording_again():
    task = TrialTask("all", "single", 0.5, 2, seed=7, bank="other-forms")
    first, again = (build_bank_case(draw_task_recording(task), "x") for _ in range(2))
    assert first.checksum == again.checksum
    other = draw_task_recording(replace(task, seed=8))
    assert build_bank_case(other, "x").checksum != first.checksum


@pytest.mark.slow
def test_small_recording_is_diagnosed_from_end_to_end(tmp_path, monkeypatch):
    """Its muscle and bench are those of the bank of the tests, whose compiled program it shares."""
    monkeypatch.setattr(draw, "draw_setup", lambda rng: build_setup())
    tasks = build_tasks({"single": 1}, (0.5,), seed=3, bank="other-forms")
    trials = run_proof(tasks, tmp_path / "trials.jsonl", attempt=run_bank_trial)
    assert [trial.error for trial in trials] == [""]
    assert read_trials(tmp_path / "trials.jsonl") == trials
    (single,) = trials
    assert single.concealed
    assert len(single.held_out_ratios) == len(single.named)
    assert all(math.isfinite(ratio) for ratio in single.held_out_ratios)

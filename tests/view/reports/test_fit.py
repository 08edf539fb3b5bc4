"""The first words of a fit's report: every channel with its noise, names of programs as they are."""

from dataclasses import replace
from types import SimpleNamespace

from pamjax.records.reading.muscle_toml import Sensors
from pamjax.view.reports.fit import _build_score_row, _list_assumptions, format_agreement
from pamjax.view.wording import capitalise_sentence
from tests.view.figures.test_fit import lengths, strokes


def fit(*cases):
    return SimpleNamespace(
        cases=cases,
        law="elastic",
        mechanisms=(),
        converged=True,
        steps=9,
        starts=4,
        agreeing_starts=4,
        loss="linear",
    )


def test_every_channel_is_named_with_its_noise():
    assert format_agreement(fit(strokes())) == (
        "Force is met to 2 N (noise 2 N) and diameter to 0.05 mm (noise 0.05 mm);"
        " isobars that the fit never saw are missed by 3 N and 0.075 mm."
    )
    assert format_agreement(fit(lengths(), lengths())).startswith(
        "In bench, the worst of 2, force is met to 2 N (noise 2 N);"
    )
    assert "(the residual's own noise 2 N)" in format_agreement(fit(lengths(given=False)))


def test_noise_tells_what_the_lab_states_of_it():
    one = strokes()
    entry = replace(one.case.entry, sensors=Sensors(force=1.2, diameter=5e-5))
    one = replace(one, case=replace(one.case, entry=entry))
    assert [_build_score_row(one, channel)[3] for channel in ("force", "diameter")] == [
        "2 N, its sensor's 1.2 N",
        "0.05 mm, stated",
    ]
    said = list(_list_assumptions(fit(one)))
    assert any(line.startswith("Noise of force is 2 N a sample: 1.2 N as the lab states it") for line in said)
    assert "Noise of diameter is 0.05 mm a sample, as the lab states it." in said


def test_a_name_is_no_word_to_begin_with_a_capital():
    assert capitalise_sentence("muscle.turns and thread.modulus move together").startswith("muscle.turns")
    assert capitalise_sentence("no two numbers are correlated above 0.8").startswith("No two")

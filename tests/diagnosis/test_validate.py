"""Validation on another recording: reported misfit of its blocks."""

from pamjax.diagnosis.validate import BlockValidation, Validation


def test_misfit_is_reported_with_block_and_worst_channel():
    good = BlockValidation(
        "isobar 100 kPa", {"force": 2.4, "diameter": 1e-5}, {"force": 2.0, "diameter": 1e-5}
    )
    bad = BlockValidation(
        "isobar 200 kPa", {"force": 4.0, "diameter": 5e-5}, {"force": 2.0, "diameter": 1e-5}
    )
    validation = Validation("b", {"force": 3.0}, {"force": 2.0}, (good, bad), 0, ())
    lines = str(validation).splitlines()
    assert "  1 of 2 blocks are predicted to 1.25 times the noise: isobar 100 kPa" in lines
    assert "  larger errors: isobar 200 kPa (diameter 5 times the noise)" in lines
    assert "larger errors" not in str(Validation("b", {"force": 2.4}, {"force": 2.0}, (good,), 0, ()))

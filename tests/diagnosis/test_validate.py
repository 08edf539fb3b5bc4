"""What a validation says of the blocks that a model predicts and misses."""

from pamjax.diagnosis.validate import BlockValidation, Validation


def test_what_is_missed_is_told_by_its_block_and_its_worst_channel():
    good = BlockValidation(
        "isobar 100 kPa", {"force": 2.4, "diameter": 1e-5}, {"force": 2.0, "diameter": 1e-5}
    )
    bad = BlockValidation(
        "isobar 200 kPa", {"force": 4.0, "diameter": 5e-5}, {"force": 2.0, "diameter": 1e-5}
    )
    one = Validation("b", {"force": 3.0}, {"force": 2.0}, (good, bad), 0, ())
    lines = str(one).splitlines()
    assert "  fits 1 of 2 blocks, to 1.25 of noise: isobar 100 kPa" in lines
    assert "  misses isobar 200 kPa (diameter by 5 of noise)" in lines
    assert "misses" not in str(Validation("b", {"force": 2.4}, {"force": 2.0}, (good,), 0, ()))

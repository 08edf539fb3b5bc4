"""A spec: any unit, one sentence for what cannot be used, and a catalogue that is what it says."""

import copy

import pytest

from pamjax.errors import BadInput
from pamjax.sizing.requirements import build_task, compute_margin, compute_margin_slope
from pamjax.sizing.schema import read_entries
from pamjax.sizing.spec import read_spec
from tests.agreement import BY_DIFFERENCE, agree, difference

GOOD = {
    "supply": {"pressure": "6 bar"},
    "force": [{"at_least": "300 N", "contraction": "10 %"}],
    "envelope": {"length": "10 in", "diameter": "3 cm"},
}


def with_(**changes):
    return copy.deepcopy(GOOD) | changes


def test_any_unit_arrives_in_si():
    spec = read_spec(with_(limits={"rest_length": ["4 in", "0.2 m"], "braid_angle": "70 deg"}))
    words = spec.entries
    assert words.supply.pressure == pytest.approx(6e5)
    assert words.envelope.length == pytest.approx(0.254)
    assert words.force[0].contraction == pytest.approx(0.1)
    assert words.limits.rest_length == pytest.approx((0.1016, 0.2))
    assert words.limits.braid_angle == pytest.approx((1.221730, 1.221730))
    stroke = read_spec(with_(stroke={"length": "2 in", "stiffness": "3 N/mm"})).entries.stroke
    assert stroke.stiffness == pytest.approx(3000.0)


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ({"force": GOOD["force"]}, "a spec must state a table [supply]"),
        (with_(supply={"pressure": "6 kg"}), "a pressure must have a unit of pressure; got 'kg'"),
        (with_(supply={"presure": "6 bar"}), "Did you mean `pressure`?"),
        (with_(envelop={}), "`envelop` is no entry (the spec). Did you mean `envelope`?"),
        (with_(minimise="weight"), "`minimise` is one of diameter, mass, air, pressure, cost, length"),
        (with_(force=[{"at_least": "-3 N"}]), "must be positive; got -3 N"),
        (with_(force=[{"at_least": "3 N", "contraction": 1.2}]), "must lie between 0 and 1; got 1.2"),
        (with_(force=[]), "a spec must state [[force]], [stroke] or `free_contraction`"),
        (with_(envelope={}), "a spec must say how long the muscle is, or how far it moves"),
        (with_(envelope={"length": "50 mm", "fittings": "30 mm"}), "two fittings must be shorter"),
        (with_(force=[{"at_least": "3 N", "pressure": "7 bar"}]), "supply (600 kPa); got 700 kPa"),
        (with_(threads={"kinds": "kevlr"}), "'kevlr' is no thread pamjax knows"),
        (with_(thread=[{"name": "mine"}]), "density and diameters; got no `modulus`"),
        (with_(minimise="cost"), "cost needs a price a kilogram of each material; got aramid"),
        (with_(limits={"wall": ["2 mm", "1 mm"]}), "has its lowest value first"),
        (with_(parallel=[1, 0]), "must be a positive whole number"),
        (with_(probability=1), "`probability` must lie between 0 and 1; got 1 in the spec."),
        (with_(name=3), "`name` is of another kind; got 3 in the spec. It should be a valid string."),
        (with_(force=[{"at_least": "3 N"}] * 10), "at most 9 [[force]] entries; got 10"),
        (with_(safety={"thread": 0.2}), "how many times stronger than its load, at least 1"),
        (with_(minimise="mass", against="mass"), "`against` is another objective than `minimise`; got mass"),
        (with_(force={"at_least": "3 N"}), "each `force` is a table of its own; got [force] in the spec."),
        (with_(minimise="diameter", parallel=13), "the diameter of a bundle is known for up to 12 muscles"),
        (b"minimise = ", "the spec must be TOML"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_told_in_a_sentence(said, told):
    with pytest.raises(BadInput) as found:
        read_entries(said, "the spec") if isinstance(said, bytes) else read_spec(said)
    assert told in str(found.value)
    assert "\n" not in str(found.value)


def test_a_price_and_a_thread_of_ones_own():
    mine = {"name": "mine", "modulus": "20 GPa", "strength": "1 GPa", "density": "1300 kg/m^3",
            "diameters": "0.25 mm", "price": 30.0}  # fmt: skip
    spec = read_spec(with_(minimise="cost", thread=[mine], bladder=[{"name": "latex", "price": 5.0}]))
    (thread,) = spec.threads
    assert (thread.name, thread.price, thread.modulus.low) == ("mine", 30.0, 20e9)
    (bladder,) = spec.bladders
    assert bladder.price == 5.0
    assert bladder.modulus.value == pytest.approx(0.4e6)


def test_requirements_say_what_the_spec_says():
    asked = build_task(read_spec(with_(stroke={"length": "50 mm", "load": "100 N"}, free_contraction=0.2)))
    by_key = {one.key: one for one in asked.requirements}
    assert by_key["force 1"].description == "pull 300 N at 10 %"
    assert by_key["stroke"].description == "move 100 N by 50 mm"
    assert asked.point_count == 1 + 1 + 5 + 1
    assert by_key["diameter"].bounds == (0.03,) * asked.point_count
    assert not by_key["fit"].stated


@pytest.mark.parametrize(("y", "bound"), [(0.5, 1.0), (0.02, 1.0), (-3.0, 1.0), (4.0, 2.0), (-1.0, 0.0)])
def test_room_is_smooth_and_its_slope_exact(y, bound):
    def at(x):
        return compute_margin(x, bound, 1, 2.0)

    agree(compute_margin_slope(y, bound, 2.0), difference(at, y, 1e-4), BY_DIFFERENCE)
    assert at(bound) == 0

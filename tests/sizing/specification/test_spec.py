"""A spec: units, messages for invalid entries, and materials of the catalogue."""

import copy

import pytest

from pamjax.errors import BadInput
from pamjax.sizing.requirements import build_task, compute_margin, compute_margin_slope
from pamjax.sizing.specification.schema import read_entries
from pamjax.sizing.specification.spec import read_spec
from tests.agreement import BY_DIFFERENCE, agree, difference

GOOD = {
    "supply": {"pressure": "6 bar"},
    "force": [{"at_least": "300 N", "contraction": "10 %"}],
    "envelope": {"length": "10 in", "diameter": "3 cm"},
}


def with_(**changes):
    return copy.deepcopy(GOOD) | changes


def test_units_are_converted_to_si():
    spec = read_spec(with_(limits={"rest_length": ["4 in", "0.2 m"], "braid_angle": "70 deg"}))
    entries = spec.entries
    assert entries.supply.pressure == pytest.approx(6e5)
    assert entries.envelope.length == pytest.approx(0.254)
    assert entries.force[0].contraction == pytest.approx(0.1)
    assert entries.limits.rest_length == pytest.approx((0.1016, 0.2))
    assert entries.limits.braid_angle == pytest.approx((1.221730, 1.221730))
    stroke = read_spec(with_(stroke={"length": "2 in", "stiffness": "3 N/mm"})).entries.stroke
    assert stroke.stiffness == pytest.approx(3000.0)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ({"force": GOOD["force"]}, "a spec must state a table [supply]"),
        (with_(supply={"pressure": "6 kg"}), "a pressure must have a unit of pressure; got 'kg'"),
        (with_(supply={"presure": "6 bar"}), "Did you mean `pressure`?"),
        (with_(envelop={}), "unknown entry `envelop` (the spec). Did you mean `envelope`?"),
        (with_(minimise="weight"), "`minimise` must be one of diameter, mass, air, pressure, cost, length"),
        (with_(force=[{"at_least": "-3 N"}]), "must be positive; got -3 N"),
        (with_(force=[{"at_least": "3 N", "contraction": 1.2}]), "must be at least 0 and below 1; got 1.2"),
        (with_(force=[]), "a spec must state [[force]], [stroke] or `free_contraction`"),
        (with_(envelope={}), "a spec must state a length of the muscle, a stroke or a shortening"),
        (with_(envelope={"length": "50 mm", "fittings": "30 mm"}), "two fittings must be shorter"),
        (with_(force=[{"at_least": "3 N", "pressure": "7 bar"}]), "supply (600 kPa); got 700 kPa"),
        (with_(threads={"kinds": "kevlr"}), "unknown thread 'kevlr'"),
        (with_(thread=[{"name": "mine"}]), "density and diameters; got no `modulus`"),
        (with_(minimise="cost"), "cost needs a price per kilogram of each material; got no price of aramid"),
        (with_(limits={"wall": ["2 mm", "1 mm"]}), "must have its lowest value first"),
        (with_(parallel=[1, 0]), "must be a positive whole number"),
        (with_(probability=1), "`probability` must be at least 0 and below 1; got 1 in the spec."),
        (with_(name=3), "`name` has the wrong type; got 3 in the spec. It should be a valid string."),
        (with_(force=[{"at_least": "3 N"}] * 10), "at most 9 [[force]] entries; got 10"),
        (with_(safety={"thread": 0.2}), "the safety factor `[safety] thread` must be at least 1; got 0.2"),
        (with_(minimise="mass", against="mass"), "`against` must differ from `minimise`; got mass"),
        (
            with_(force={"at_least": "3 N"}),
            "each `force` must be a table of its own; got [force] in the spec.",
        ),
        (
            with_(minimise="diameter", parallel=13),
            "the diameter of a bundle can be computed for at most 12 muscles",
        ),
        (b"minimise = ", "the spec must be TOML"),
    ],
)  # fmt: skip
def test_invalid_spec_gives_a_message_of_one_line(spec, message):
    with pytest.raises(BadInput) as error:
        read_entries(spec, "the spec") if isinstance(spec, bytes) else read_spec(spec)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_spec_can_state_a_thread_and_a_price():
    own_thread = {"name": "mine", "modulus": "20 GPa", "strength": "1 GPa", "density": "1300 kg/m^3",
            "diameters": "0.25 mm", "price": 30.0}  # fmt: skip
    spec = read_spec(with_(minimise="cost", thread=[own_thread], bladder=[{"name": "latex", "price": 5.0}]))
    (thread,) = spec.threads
    assert (thread.name, thread.price, thread.modulus.low) == ("mine", 30.0, 20e9)
    (bladder,) = spec.bladders
    assert bladder.price == 5.0
    assert bladder.modulus.value == pytest.approx(0.4e6)


def test_requirements_describe_the_entries_of_the_spec():
    task = build_task(read_spec(with_(stroke={"length": "50 mm", "load": "100 N"}, free_contraction=0.2)))
    by_key = {requirement.key: requirement for requirement in task.requirements}
    assert by_key["force 1"].description == "force at least 300 N at 10 % contraction"
    assert by_key["stroke"].description == "stroke 50 mm with load 100 N"
    assert task.point_count == 1 + 1 + 5 + 1
    assert by_key["diameter"].bounds == (0.03,) * task.point_count
    assert not by_key["fit"].stated


@pytest.mark.parametrize(("y", "bound"), [(0.5, 1.0), (0.02, 1.0), (-3.0, 1.0), (4.0, 2.0), (-1.0, 0.0)])
def test_slope_of_the_margin_is_exact(y, bound):
    def margin(x):
        return compute_margin(x, bound, 1, 2.0)

    agree(compute_margin_slope(y, bound, 2.0), difference(margin, y, 1e-4), BY_DIFFERENCE)
    assert margin(bound) == 0

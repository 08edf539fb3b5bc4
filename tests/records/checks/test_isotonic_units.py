"""A wrong pressure unit of a free contraction is refused or reported, with the probable unit."""

from pathlib import Path

import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.records.case import build_case
from tests.agreement import SOLVED, agree

ROOT = Path(__file__).parents[3]
THREAD, TURNS, REST = 0.214, 1.2, 0.2
BLADDER, WALL = 0.018, 0.001
MUSCLE = f"""\
[muscle]
name = "free"
rest_length = "{1e3 * REST:g} mm"
thread_length = "{1e3 * THREAD:g} mm"
turns = {TURNS}

[bladder]
inner_diameter = "{1e3 * BLADDER:g} mm"
thickness = "{1e3 * WALL:g} mm"

[test]
measured = "length"
load = "0 N"
"""


def energy(length, modulus):
    """Return the energy of a thin neo-Hookean tube in an inextensible braid, J."""
    diameter = lambda x: np.sqrt(THREAD**2 - x**2) / (np.pi * TURNS)  # noqa: E731
    axial, hoop = length / REST, diameter(length) / diameter(REST)
    volume = np.pi * WALL * (BLADDER + WALL) * REST
    return volume * modulus / 6 * (axial**2 + hoop**2 + (axial * hoop) ** -2 - 3)


def contract(modulus, load=0.0):
    """Return lengths, m, and pressures, Pa, of a muscle in balance with its rubber and a load."""
    length = REST * (1 - np.linspace(0.02, 0.25, 24))
    step = 1e-6 * REST
    push = -(energy(length + step, modulus) - energy(length - step, modulus)) / (2 * step)
    area = (3 * length**2 - THREAD**2) / (4 * np.pi * TURNS**2)
    return length, (push + load) / area


def read(modulus, true="kPa", header="kPa", toml=MUSCLE, load=0.0):
    """Return the warnings of a recording with pressures in one unit under a header of another one."""
    scale = {"kPa": 1e3, "bar": 1e5, "psi": 6894.757}
    length, pressure = contract(modulus, load)
    rows = "".join(f"{p / scale[true]:.8g},{1e3 * x:.8g}\n" for p, x in zip(pressure, length, strict=True))
    text = f"pressure [{header}],length [mm]\n{rows}"
    toml = toml.replace('"0 N"', f'"{load:g} N"')
    return build_case(toml.encode(), text.encode(), Path("case"), "carry", "relaxed").warnings


@pytest.mark.parametrize("load", [0.0, 20.0])
@pytest.mark.parametrize("modulus", [0.3e6, 1.2e6, 15e6])
def test_usual_rubber_in_the_right_unit_has_no_warning(modulus, load):
    assert read(modulus, load=load) == ()


def test_modulus_agrees_with_that_of_the_simulated_tube():
    (warning,) = read(0.2e6)
    agree(float(warning.partition("got ")[2].split()[0]), 0.2, SOLVED)


@pytest.mark.parametrize(("header", "is_refused"), [("kPa", True), ("psi", False)])
def test_bar_under_another_header_is_reported(header, is_refused):
    expected = f"Probable cause: pressure in bar under a header of {header}."
    if is_refused:
        with pytest.raises(BadInput, match="Young's modulus of the bladder must be within") as error:
            read(2.5e6, "bar", header)
        assert expected in str(error.value)
        return
    (warning,) = read(2.5e6, "bar", header)
    assert expected in warning


def test_stated_modulus_shows_a_smaller_error_of_the_unit():
    stated = MUSCLE.replace("[test]", 'modulus = "1.2 MPa"\n\n[test]')
    assert read(1.2e6, toml=stated) == ()
    (warning,) = read(1.2e6, "psi", "kPa", toml=stated)
    assert "pressure in psi under a header of kPa" in warning


def test_assumed_wall_only_warns():
    unstated = MUSCLE.replace(f'inner_diameter = "{1e3 * BLADDER:g} mm"\nthickness = "{1e3 * WALL:g} mm"', "")
    assert read(6e6, toml=unstated) == ()
    (warning,) = read(6e6, "bar", "kPa", toml=unstated)
    assert "pressure in bar under a header of kPa" in warning


@pytest.mark.parametrize(("header", "is_right"), [("bar", True), ("kPa", False)])
def test_real_free_contraction_passes_only_in_its_unit(header, is_right):
    folder = ROOT / "fits" / "petre_2021" / "zero-load"
    text = (folder / "recording.csv").read_text().replace("pressure [bar]", f"pressure [{header}]")
    arguments = ((folder / "muscle.toml").read_bytes(), text.encode(), folder, "carry", "relaxed")
    if is_right:
        assert build_case(*arguments).warnings == ()
        return
    with pytest.raises(BadInput, match="pressure in bar under a header of kPa"):
        build_case(*arguments)

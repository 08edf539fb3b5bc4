"""Units in the headers of rig files: gauge pressure, absolute pressure, and misspelt units."""

import numpy as np
import pytest

NAMES = 'force = "F"\npressure = "P"'


def rows(pressure="kPa", force="N"):
    return f"P [{pressure}],F [{force}]\n100,30\n200,65\n300,100\n"


@pytest.mark.parametrize(
    ("units", "message"),
    [
        (("kPaq", "N"), "unknown unit 'kPaq' (column `P [kPaq]` of run.csv). Did you mean `kPa`?"),
        (("kpa.", "N"), "unknown unit 'kpa.' (column `P [kpa.]` of run.csv). Did you mean `kPa`?"),
        (("kPa", "Nn"), "unknown unit 'Nn' (column `F [Nn]` of run.csv). Did you mean `N`?"),
        (("kPa", "kNN"), "unknown unit 'kNN' (column `F [kNN]` of run.csv). Did you mean `kN`?"),
        (("kPa", "newtn"), "unknown unit 'newtn' (column `F [newtn]` of run.csv). Did you mean `newton`?"),
        (("kPa", "mm"), "a force must have a unit of force; got 'mm' in column `F [mm]` of run.csv."),
    ],
)
def test_wrong_unit_in_a_header_is_named_with_its_column(refuse, units, message):
    text = refuse(rows(*units), columns=NAMES)
    assert text.startswith(message)
    channel = "pressure" if units[0] != "kPa" else "force"
    assert text.endswith(f" Correct the header, or write the `unit` of `{channel}` in [columns].")


def test_wrong_unit_in_columns_is_named_there(refuse):
    columns = 'force = "F"\npressure = {column = "P", unit = "kPaq"}'
    assert refuse(rows(), columns=columns) == "unknown unit 'kPaq' ([columns] pressure). Did you mean `kPa`?"


def test_misspelt_unit_is_not_proposed_as_the_header(refuse):
    message = refuse(rows("kPaq"), columns='force = "F [N]"\npressure = "P [kPa]"')
    assert message == (
        "unknown unit 'kPaq' (column `P [kPaq]` of run.csv). Did you mean `kPa`? Correct the header, or write"
        ' {column = "P", unit = "kPa"} in [columns].'
    )


def test_another_known_unit_is_proposed_as_the_header(refuse):
    message = refuse(rows("bar"), columns='force = "F [N]"\npressure = "P [kPa]"')
    assert message == "run.csv must have a column `P [kPa]`; got none. Did you mean `P [bar]`?"


@pytest.mark.parametrize("pressure", ["P", "P [kPa]"])
def test_absolute_pressure_is_refused(refuse, pressure):
    message = refuse(rows("kPaa"), columns=f'force = "F"\npressure = "{pressure}"')
    assert message == (
        "`pressure` must be gauge pressure; got 'kPaa' in column `P [kPaa]` of run.csv."
        ' Write unit = "kPa" in [columns]. If the sensor reads absolute pressure, write also zero = 101.3,'
        " the pressure of the atmosphere."
    )


def test_remedy_for_absolute_pressure_is_accepted(rig):
    columns = 'force = "F"\npressure = {column = "P", unit = "kPa", zero = 101.3}'
    np.testing.assert_allclose(rig(rows("kPaa"), columns=columns).pressure, [-1300, 98700, 198700])


def test_unit_of_gauge_pressure_is_read(rig):
    text = rows("psig").replace("00,", "0,")
    np.testing.assert_allclose(rig(text, columns=NAMES).pressure, 6894.757 * np.array([10, 20, 30]), atol=0.1)

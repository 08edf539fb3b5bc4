"""Supplied tables: complete, with sources and valid units, and with the printed values."""

import shutil
from math import pi

import pytest

from pamjax.errors import BadInput
from pamjax.records import shipped_tables as tables
from pamjax.records.shipped_tables import (
    convert_to_si,
    find_data_folder,
    list_shipped,
    read_quantities,
    read_shipped,
    read_sidecar,
)
from pamjax.units import compute_si_factor, parse_unit

NAMES = (
    "chambers_wereley_2022/effects",
    "chambers_wereley_2022/materials",
    "chambers_wereley_2022/table1",
    "chambers_wereley_2022/table2",
    "martens_boblan_2017/dmsp-10-250",
    "martens_boblan_2017/dmsp-20-300",
    "petre_2021/zero-load",
)
MATERIALS = (
    "materials/bladders", "materials/fittings", "materials/sleeves", "materials/threads", "materials/tubes",
    "materials/yarns",
)  # fmt: skip
KINDS = {"pressure": "pressure", "modulus": "pressure", "force": "force", "diameter": "length"}


def test_list_of_supplied_tables():
    assert list_shipped() == sorted((*NAMES, *MATERIALS))


@pytest.mark.parametrize("name", MATERIALS)
def test_each_row_of_our_own_tables_names_its_sources(name):
    table, about = read_shipped(name), read_sidecar(name)
    assert list(about["columns"]) == list(table.columns)
    assert about["source"]["licence"]
    for keys in table["source"]:
        assert set(keys.split(";")) <= set(about["sources"])
    for header in table.columns:
        low = header.replace(" [", " low [")
        if low in table:
            assert (table[low] <= table[header]).all()
            assert (table[header] <= table[header.replace(" [", " high [")]).all()


@pytest.mark.parametrize("name", NAMES)
def test_sidecar_belongs_to_its_table(name):
    table, about = read_shipped(name), read_sidecar(name)
    assert list(about["columns"]) == list(table.columns)
    assert about["title"]
    assert about["read"]
    assert about["source"]["licence"] == "CC BY 4.0"
    assert about["source"]["doi"].startswith(("10.3390/act", "10.3390/app"))


@pytest.mark.parametrize("name", NAMES)
def test_units_of_tables_are_valid(name):
    table = read_shipped(name)
    for header, column in read_sidecar(name)["columns"].items():
        if unit := column["unit"]:
            assert header.endswith(f"[{unit}]") or header in ("value", "tolerance")
            assert compute_si_factor(unit) > 0
            if kind := KINDS.get(header.split(" [")[0]):
                assert parse_unit(unit, kind) == pytest.approx(compute_si_factor(unit))
    for unit in table.get("unit", ()):
        assert compute_si_factor(str(unit)) > 0


def test_table1_satisfies_the_triangle_relation():
    printed = convert_to_si(read_shipped("chambers_wereley_2022/table1"))
    known = read_quantities("chambers_wereley_2022/materials")
    thread = (known["rest_length"] ** 2 + (pi * known["turns"] * printed["diameter"]) ** 2) ** 0.5
    # Half a printed digit of the thread length, and the effect of half a digit of the diameter.
    assert (abs(thread - printed["thread_length"]) < 0.07e-3).all()
    assert list(printed["read"]) == ["measured"] * 5 + ["predicted"]


def test_table2_as_printed():
    printed = read_shipped("chambers_wereley_2022/table2").set_index("material")
    assert printed.loc["Nylon", "modulus [GPa]"] == 4.3
    assert printed.loc["PET", "force_change [N]"] == -1170.0
    assert printed.loc["Low stiffness (10 % of Kevlar)", "diameter_change [percent]"] == 30.1
    with pytest.raises(BadInput, match="names without units must be unique; got `diameter_change` twice"):
        convert_to_si(printed)


def test_materials_in_si():
    known = read_quantities("chambers_wereley_2022/materials")
    assert known["thread_length"] == pytest.approx(0.251206)
    assert known["threads"] == 144
    assert known["thread_area"] == pytest.approx(0.0858e-6)
    assert known["modulus_cited"] == pytest.approx(112e9)
    assert known["breaking_strength_lbf"] == pytest.approx(known["breaking_strength_section3"], abs=0.5)
    assert known["modulus_nylon_text"] == known["modulus_pet_table2"]


def test_force_maps_are_complete_and_positive():
    small = convert_to_si(read_shipped("martens_boblan_2017/dmsp-10-250"))
    large = convert_to_si(read_shipped("martens_boblan_2017/dmsp-20-300"))
    assert (len(small), len(large)) == (17 * 5, 21 * 6)
    for table in (small, large):
        assert (table.groupby("length")["force"].apply(lambda f: f.is_monotonic_increasing)).all()
    assert large["force"].max() == 1653.5
    assert small["force"].max() == 542.5
    assert "slack" in read_sidecar("martens_boblan_2017/dmsp-10-250")["columns"]["force [N]"]["about"]


def test_a_changed_table_is_refused(tmp_path, monkeypatch):
    shutil.copytree(find_data_folder(), tmp_path / "data")
    monkeypatch.setattr(tables, "find_data_folder", lambda: tmp_path / "data")
    read_shipped("chambers_wereley_2022/table1")
    path = tmp_path / "data" / "chambers_wereley_2022" / "table1.csv"
    path.write_bytes(path.read_bytes().replace(b"26.52", b"26.53"))
    with pytest.raises(
        BadInput, match=r"must have the sha256 that its sidecar states; got another sha256 in .*table1"
    ):
        read_shipped("chambers_wereley_2022/table1")


def test_unknown_table_is_refused_with_a_hint():
    with pytest.raises(BadInput, match=r"Did you mean `chambers_wereley_2022/table1`\?"):
        read_shipped("chambers_wereley_2022/tabel1")
    with pytest.raises(BadInput, match=r"unknown shipped table `\.\./pyproject`"):
        read_sidecar("../pyproject")
    with pytest.raises(BadInput, match="a table of quantities must have the columns"):
        read_quantities("chambers_wereley_2022/table1")

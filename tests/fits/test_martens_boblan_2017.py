"""The committed force maps are what the build script makes, and score as they did."""

import importlib
import json
import sys
from io import StringIO
from pathlib import Path

import pandas as pd
import pytest

from fits.comparison import compare
from pamjax.infer.fitting.fit import fit
from pamjax.records.case import read_case
from pamjax.records.shipped_tables import read_shipped

FOLDER = Path(__file__).parents[2] / "fits" / "martens_boblan_2017"
EXPECTED = json.loads((FOLDER / "expected.json").read_text(encoding="utf-8"))
OURS = ("build", "case")

INELASTIC, SAROSI = "braid, inelastic threads", "Sárosi"
INNER, REST = "inner lengths held out", "rest length held out"


@pytest.fixture(scope="module")
def ours():
    """The modules of the folder by name; the folder is no package, and leaves no trace."""
    sys.path.insert(0, str(FOLDER))
    kept = {name: sys.modules.pop(name) for name in OURS if name in sys.modules}
    try:
        yield {name: importlib.import_module(name) for name in OURS}
    finally:
        sys.path.remove(str(FOLDER))
        for name in OURS:
            sys.modules.pop(name, None)
        sys.modules.update(kept)


@pytest.fixture(scope="module")
def built(ours):
    return ours["build"].build()


@pytest.fixture(scope="module", params=["dmsp-10-250", "dmsp-20-300"])
def scored(request):
    """A map's name, and the scores of the braid with inelastic threads beside the rivals'."""
    case = read_case(FOLDER / request.param)
    return request.param, compare(case, [fit(case, "inelastic", starts=1)])


def test_folders_hold_what_is_built(built):
    committed = {
        p.relative_to(FOLDER).as_posix() for p in FOLDER.glob("*/*") if p.suffix in (".csv", ".toml")
    }
    assert committed == set(built)
    for path, text in built.items():
        assert (FOLDER / path).read_text(encoding="utf-8") == text, f"run build.py: {path} is out of date"


@pytest.mark.parametrize(("name", "slack"), [("dmsp-10-250", 45), ("dmsp-20-300", 66)])
def test_only_slack_cells_are_blank(built, name, slack):
    printed = read_shipped(f"martens_boblan_2017/{name}")
    recorded = pd.read_csv(StringIO(built[f"{name}/recording.csv"]))
    assert recorded["force [N]"].isna().sum() == slack
    pd.testing.assert_frame_equal(recorded.fillna(0.0), printed)


def test_scores_are_unchanged(scored):
    name, found = scored
    for model in found.scores:
        for split, rmse in EXPECTED[name][model].items():
            # Far beyond full scale a formula's extrapolation is but a number of digits.
            if rmse < found.full_scale:
                assert found.rmse(model, split) == pytest.approx(rmse, rel=0.01), f"{model}, {split}"


def test_the_bare_braid_loses_to_the_formula_between_lengths(scored):
    _, found = scored
    assert found.best("in sample") == found.best(INNER) == SAROSI
    assert found.rmse(INELASTIC, INNER) > 5 * found.rmse(SAROSI, INNER)


def test_nobody_predicts_the_rest_length(scored):
    _, found = scored
    assert min(found.rmse(model, REST) for model in found.scores) > 0.1 * found.full_scale


@pytest.mark.slow
def test_stretching_threads_are_not_what_is_missing():
    case, model = read_case(FOLDER / "dmsp-20-300"), "braid, elastic threads"
    found = compare(case, [fit(case, "elastic", starts=1)])
    expected = EXPECTED["dmsp-20-300"]
    assert found.rmse(model, "in sample") == pytest.approx(expected[model]["in sample"], rel=0.01)
    assert found.rmse(model, "in sample") > 0.9 * expected[INELASTIC]["in sample"]


def test_every_map_is_expected(ours):
    assert list(EXPECTED) == list(ours["case"].MUSCLES)

"""build.py writes the stored force maps, and their scores are unchanged."""

import json
from io import StringIO

import pandas as pd
import pytest

from fits.comparison import compare
from pamjax.infer.fitting.fit import fit
from pamjax.records.case import read_case
from pamjax.records.shipped_tables import read_shipped
from tests.fits.scripts import FITS, import_scripts

FOLDER = FITS / "martens_boblan_2017"
EXPECTED = json.loads((FOLDER / "expected.json").read_text(encoding="utf-8"))
SCRIPTS = ("build", "case")

INELASTIC, SAROSI = "braid, inelastic threads", "Sárosi"
INNER, REST = "inner lengths held out", "rest length held out"


@pytest.fixture(scope="module")
def scripts():
    """Return the scripts of the folder, by name."""
    with import_scripts("martens_boblan_2017", *SCRIPTS) as modules:
        yield dict(zip(SCRIPTS, modules, strict=True))


@pytest.fixture(scope="module")
def build_files(scripts):
    return scripts["build"].build_files()


@pytest.fixture(scope="module", params=["dmsp-10-250", "dmsp-20-300"])
def scored_comparison(request):
    """Return the name of a map, and the scores of the inelastic braid and of the formulas."""
    case = read_case(FOLDER / request.param)
    return request.param, compare(case, [fit(case, "inelastic", starts=1)])


def test_folders_agree_with_their_script(build_files):
    committed = {
        p.relative_to(FOLDER).as_posix() for p in FOLDER.glob("*/*") if p.suffix in (".csv", ".toml")
    }
    assert committed == set(build_files)
    for path, text in build_files.items():
        assert (FOLDER / path).read_text(encoding="utf-8") == text, f"run build.py: {path} is out of date"


@pytest.mark.parametrize(("name", "slack"), [("dmsp-10-250", 45), ("dmsp-20-300", 66)])
def test_only_slack_cells_are_blank(build_files, name, slack):
    printed = read_shipped(f"martens_boblan_2017/{name}")
    recorded = pd.read_csv(StringIO(build_files[f"{name}/recording.csv"]))
    assert recorded["force [N]"].isna().sum() == slack
    pd.testing.assert_frame_equal(recorded.fillna(0.0), printed)


def test_scores_are_unchanged(scored_comparison):
    name, comparison = scored_comparison
    for model in comparison.scores:
        for split, rmse in EXPECTED[name][model].items():
            # The digits of a diverged extrapolation far beyond full scale are not reproducible.
            if rmse < comparison.full_scale:
                assert comparison.rmse(model, split) == pytest.approx(rmse, rel=0.01), f"{model}, {split}"


def test_formula_predicts_better_between_lengths(scored_comparison):
    _, comparison = scored_comparison
    assert comparison.best("in sample") == comparison.best(INNER) == SAROSI
    assert comparison.rmse(INELASTIC, INNER) > 5 * comparison.rmse(SAROSI, INNER)


def test_no_model_predicts_the_rest_length(scored_comparison):
    _, comparison = scored_comparison
    assert min(comparison.rmse(model, REST) for model in comparison.scores) > 0.1 * comparison.full_scale


@pytest.mark.slow
def test_elastic_threads_do_not_reduce_the_misfit():
    case, model = read_case(FOLDER / "dmsp-20-300"), "braid, elastic threads"
    comparison = compare(case, [fit(case, "elastic", starts=1)])
    expected = EXPECTED["dmsp-20-300"]
    assert comparison.rmse(model, "in sample") == pytest.approx(expected[model]["in sample"], rel=0.01)
    assert comparison.rmse(model, "in sample") > 0.9 * expected[INELASTIC]["in sample"]


def test_every_map_is_expected(scripts):
    assert list(EXPECTED) == list(scripts["case"].MUSCLES)

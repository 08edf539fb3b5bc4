"""The free contraction of Petre (2021): the case follows from the table, and rubber and friction fit it."""

import numpy as np
import pytest

from pamjax.infer.fitting.fit import fit
from pamjax.records.blocks import find_blocks
from pamjax.records.case import read_case
from tests.fits.scripts import FITS, import_scripts

FOLDER = FITS / "petre_2021"


@pytest.fixture(scope="module")
def case():
    return read_case(FOLDER / "zero-load")


def test_folder_agrees_with_its_script():
    with import_scripts("petre_2021", "build") as (build,):
        files = build.build_files()
    committed = {
        p.relative_to(FOLDER).as_posix() for p in FOLDER.glob("*/*") if p.suffix in (".csv", ".toml")
    }
    assert committed == set(files)
    for path, text in files.items():
        assert (FOLDER / path).read_text(encoding="utf-8") == text, f"run build.py: {path} is out of date"


def test_runs_are_the_blocks(case):
    blocks = find_blocks(case.recording)
    assert (blocks.kind, len(blocks)) == ("cycles", 5)
    assert case.recording.channels == ("length",)
    assert np.all(case.recording.force == 0)


def test_loop_is_as_large_as_stated(case):
    recording = case.recording
    at_350 = np.isclose(recording.pressure, 350e3)
    loops = recording.length[at_350].reshape(5, 2)
    assert np.mean(loops[:, 0] - loops[:, 1]) == pytest.approx(3.29e-3, abs=0.01e-3)


@pytest.mark.slow
def test_friction_explains_the_loop(case):
    rubbed = fit(case, mechanisms=("bladder_elasticity", "braid_friction"), starts=1, fold_count=2)
    # Half of the loop is the smallest rms error of a model that does not depend on the direction.
    half_loop = 0.5 * 3.29e-3
    assert rubbed.cases[0].held_out_score.rmse["length"] < 0.4 * half_loop

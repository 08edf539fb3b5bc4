"""The gallery: its code runs and draws every picture of the page, and an error of the code ends the build."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = (DOCS / "gallery.md").read_text("utf-8")
#: Width of the text of the site, pixels: a narrower picture would be blurred.
MIN_WIDTH = 700


def import_conf():
    spec = importlib.util.spec_from_file_location("docs_conf", DOCS / "conf.py")
    conf = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(conf)
    return conf


@pytest.fixture(scope="module")
def gallery(tmp_path_factory):
    """Return the names that the code of the page assigns, and the folder with its figures."""
    folder = tmp_path_factory.mktemp("gallery")
    return import_conf().run_gallery(PAGE, folder), folder


def list_pictures(text):
    """Return the (figure that a block of code writes, picture below the block) of a page."""
    return re.findall(
        r"""savefig\("([\w-]+\.png)"[^)]*\)\n```\n\n!\[[^\]]+\]\(_generated/gallery/([^)]+)\)""", text
    )


@pytest.mark.slow
def test_code_draws_every_picture_of_the_page(gallery):
    pairs = list_pictures(PAGE)
    assert 10 <= len(pairs) == PAGE.count("![") == PAGE.count("```python")
    assert all(written == shown for written, shown in pairs)
    _, folder = gallery
    assert {path.name for path in folder.glob("*.png")} == {shown for _, shown in pairs}
    for _, shown in pairs:
        image = matplotlib.image.imread(folder / shown)
        assert image.shape[1] >= MIN_WIDTH, shown
        # An empty frame has no colour.
        assert (np.ptp(image[..., :3], axis=2) > 0.1).mean() > 5e-4, shown


@pytest.mark.slow
def test_table_has_all_names_of_figures(gallery):
    names, _ = gallery
    rows = re.findall(r"^\| `(\w+)` \| (.*) \|$", PAGE, re.M)
    assert len(rows) == 6
    for result, cell in rows:
        assert re.findall("`(.*?)`", cell) == names[result].list_figures(), result


def test_picture_of_other_code_is_detected():
    text = 'fit.plot().savefig("a.png")\n```\n\n![A fit](_generated/gallery/b.png)'
    assert list_pictures(text) == [("a.png", "b.png")]


@pytest.mark.slow
def test_error_of_the_code_fails_the_build(tmp_path):
    (tmp_path / "docs").mkdir()
    (tmp_path / "fits").mkdir()
    (tmp_path / "docs/conf.py").write_bytes((DOCS / "conf.py").read_bytes())
    (tmp_path / "docs/index.md").write_text("# Home\n\n```{toctree}\ngallery\n```\n")
    (tmp_path / "docs/gallery.md").write_text("# Gallery\n\n```python\nassert 1 == 2, 'no figure'\n```\n")
    words = [
        sys.executable,
        "-m",
        "sphinx",
        "-q",
        "-b",
        "html",
        str(tmp_path / "docs"),
        str(tmp_path / "site"),
    ]
    process = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False, cwd=DOCS.parent)
    assert process.returncode != 0
    assert "no figure" in process.stderr


def test_command_that_fails_is_an_error(tmp_path):
    with pytest.raises(RuntimeError, match=r"the command of the gallery failed: \$ pamjax check nowhere"):
        import_conf().run_gallery("```console\n$ pamjax check nowhere\n```\n", tmp_path)

"""The gallery: an error of its code, or a difference between page and figures, ends the build of the site.

`test_site.py` builds the site.
"""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import matplotlib.image
import numpy as np
import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = (DOCS / "gallery.md").read_text("utf-8")

#: A page with one figure and a table of names.
SMALL_PAGE = """\
```python
fit.plot().savefig("a.png")
```

![A fit](_generated/gallery/a.png)

| `fit` | `prediction`, `residual` |
"""


def import_conf():
    spec = importlib.util.spec_from_file_location("docs_conf", DOCS / "conf.py")
    conf = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(conf)
    return conf


def find_differences(folder, page=SMALL_PAGE, width=800, colour=1.0, name="a.png"):
    """Return the differences of a page and one picture, in which a tenth has a colour."""
    image = np.ones((100, width, 3))
    image[:10, :, 0] = 1 - colour
    matplotlib.image.imsave(folder / name, image)
    names = {"fit": SimpleNamespace(list_figures=lambda: ["prediction", "residual"])}
    return import_conf().find_gallery_differences(page, names, folder)


def test_page_of_its_figures_has_no_difference(tmp_path):
    assert find_differences(tmp_path) == []


@pytest.mark.parametrize(
    ("changes", "difference"),
    [
        ({"width": 600}, "a.png is narrower than 700 pixels"),
        ({"colour": 0.0}, "a.png is empty"),
        ({"name": "b.png"}, "a.png is not drawn"),
        ({"name": "b.png"}, "b.png is not shown"),
        ({"page": SMALL_PAGE.replace("gallery/a.png", "gallery/b.png")}, "a.png is shown as b.png"),
        ({"page": SMALL_PAGE + "![Another](b.png)"}, "each block of Python code needs one picture below it"),
        ({"page": SMALL_PAGE.replace(", `residual`", "")}, "the figures of `fit` are prediction, residual"),
    ],
)
def test_difference_is_found(tmp_path, changes, difference):
    assert difference in find_differences(tmp_path, **changes)


def test_gallery_shows_all_results():
    assert len(import_conf().list_pictures(PAGE)) >= 10
    assert len(re.findall(r"^\| `(\w+)` \| (.*) \|$", PAGE, re.M)) == 6


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

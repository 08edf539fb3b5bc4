"""The wheel that is built from the sdist works without a checkout."""

import json
import os
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest

import pamjax

ROOT = Path(__file__).resolve().parents[1]


def test_every_public_name_is_in_the_reference_and_can_be_loaded():
    reference = (ROOT / "docs" / "reference.md").read_text("utf-8")
    for name in pamjax.__all__:
        assert f"pamjax.{name}" in reference
        assert getattr(pamjax, name).__name__ == name
    assert pamjax.__version__ == version("pamjax")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Return the wheel, built from the sdist."""
    folder = tmp_path_factory.mktemp("dist")
    words = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    subprocess.run(words, check=True, capture_output=True, timeout=300)
    (sdist,) = folder.glob("*.tar.gz")
    assert sdist.stat().st_size < 20e6
    (file,) = folder.glob("*.whl")
    assert file.stat().st_size < 3e6
    return file


@pytest.fixture(scope="module")
def run_installed(wheel, tmp_path_factory):
    """Return a function that runs the installed `pamjax` in its own environment and folder.

    The dependencies are those of the test environment; pamjax comes from the wheel.
    """
    folder = tmp_path_factory.mktemp("elsewhere")
    venv.create(folder / "env", with_pip=False)
    scheme = "nt" if os.name == "nt" else "posix_prefix"
    paths = sysconfig.get_paths(scheme, {"base": str(folder / "env"), "platbase": str(folder / "env")})
    python = Path(paths["scripts"]) / "python"
    (Path(paths["purelib"]) / "zz_dependencies.pth").write_text(sysconfig.get_paths()["purelib"])
    words = ["install", "--no-deps", "--no-index", "--quiet", "--disable-pip-version-check", str(wheel)]
    subprocess.run([sys.executable, "-m", "pip", "--python", str(python), *words], check=True, timeout=120)

    def _run(*words, module=False):
        program = (
            [str(python), "-c", words[0]] if module else [str(Path(paths["scripts"]) / "pamjax"), *words]
        )
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"HOME": str(folder)}
        process = subprocess.run(
            program, cwd=folder, env=environment, capture_output=True, text=True, timeout=300, check=False
        )
        assert process.returncode == 0, process.stderr
        return process.stdout

    _run.folder = folder
    return _run


@pytest.mark.slow
def test_wheel_contains_types_data_and_templates(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert {
        "pamjax/py.typed",
        "pamjax/data/chambers_wereley_2022/table1.csv",
        "pamjax/view/pages/report.html.jinja",
    } <= set(names)
    assert not [name for name in names if name.startswith(("tests", "fits", "docs"))]


@pytest.mark.slow
def test_installed_package_runs_without_a_checkout(run_installed):
    where = run_installed("import pamjax; print(pamjax.__file__)", module=True)
    assert str(run_installed.folder) in where
    version = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    assert run_installed("--version").strip() == version
    assert "diagnose" in run_installed("--help")
    assert "unit      GPa" in run_installed("explain", "thread.modulus")
    shipped = "from pamjax.records.shipped_tables import list_shipped; print(len(list_shipped()))"
    assert int(run_installed(shipped, module=True)) >= 6
    run_installed("new", "mine")
    document = json.loads(run_installed("fit", "mine", "--starts", "1", "--folds", "2", "--json"))
    assert document["converged"]
    assert (run_installed.folder / "out" / "fit.json").exists()


def test_shell_completion_is_installed(tmp_path):
    words = "from pamjax.cli.main import main; main(['--install-completion', '--shell', 'bash'])"
    environment = os.environ | {"HOME": str(tmp_path), "PYTHONPATH": str(ROOT)}
    subprocess.run(
        [sys.executable, "-c", words], env=environment, check=True, capture_output=True, timeout=60
    )
    (script,) = [path for path in tmp_path.rglob("*pamjax*") if path.is_file()]
    assert "diagnose" in script.read_text("utf-8")


def test_version_and_citation_agree():
    text = (ROOT / "CITATION.cff").read_text("utf-8")
    version = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    assert f"\nversion: {version}\n" in text

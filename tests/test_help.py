"""`help` of every public function: arguments, result, errors and an example that runs."""

import inspect
import shutil
import textwrap
from pathlib import Path

import pytest

import pamjax
from pamjax.cli.main import app, main
from tests.view import made_up

FUNCTIONS = sorted(name for name in pamjax.__all__ if inspect.isfunction(getattr(pamjax, name)))
#: Functions that refuse no input.
WITHOUT_ERRORS = {"list_parameters", "simulate"}
#: Functions whose examples need a store, the files of a rig, or minutes of computation.
NOT_RUN = {
    "compare",
    "discriminate",
    "import_case",
    "open_fleet",
    "plan",
    "sample",
    "save_posterior",
    "validate",
}
#: Commands without a function: a study of the tool itself, and the commands for files.
WITHOUT_FUNCTION = {"prove", "new", "check", "import", "fleet"}


def find_missing_sections(function):
    """Return the sections that a docstring lacks."""
    text, parameters = inspect.getdoc(function) or "", inspect.signature(function).parameters
    wanted = ["Returns:", *(["Args:"] if parameters else [])]
    wanted += [] if function.__name__ in WITHOUT_ERRORS else ["Raises:"]
    missing = [section for section in wanted if section not in text]
    missing += [name for name in parameters if f"{name}:" not in text and f"{name}, " not in text + ", "]
    return missing + ([] if "Example:" in text or ">>>" in text else ["Example:"])


def get_example(function):
    """Return the code of the example of a docstring; empty for a doctest."""
    text = inspect.getdoc(function) or ""
    return textwrap.dedent(text.partition("Example:\n")[2]) if ">>>" not in text else ""


@pytest.mark.parametrize("name", FUNCTIONS)
def test_help_is_complete(name):
    assert find_missing_sections(getattr(pamjax, name)) == []


def test_missing_section_is_detected():
    def compute_force(pressure):
        """Return the force.

        Args:
            length: m.
        """

    assert find_missing_sections(compute_force) == ["Returns:", "Raises:", "pressure", "Example:"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with the case `mine` that the examples use."""
    folder = tmp_path_factory.mktemp("examples")
    assert main(["new", str(folder / "mine")]) == 0
    shutil.copytree(folder / "mine", folder / "rubbed")
    (folder / "out").mkdir()
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in FUNCTIONS if get_example(getattr(pamjax, name))])
def test_example_runs(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    program = compile(get_example(getattr(pamjax, name)), name, "exec")
    if name in NOT_RUN:
        return
    # A diagnosis needs minutes; its figures and attributes are those of any other diagnosis.
    monkeypatch.setattr(pamjax, "diagnose", lambda case: made_up.diagnosis(), raising=False)
    names = {"pamjax": pamjax}
    if name in ("plot", "list_figures"):
        names["fit"] = pamjax.fit("mine", starts=1)
    exec(program, names)


def test_every_command_has_a_function():
    commands = {command for command in app if command[0] != "-"}
    assert commands - set(dir(pamjax)) == WITHOUT_FUNCTION
    assert Path(inspect.getfile(pamjax.validate)).name == "validate.py"

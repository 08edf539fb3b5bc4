"""Configuration of the documentation site: pages in Markdown, and some that are generated from the code.

pip install -e '.[docs]'
sphinx-build -W -b html docs out/site
"""

import contextlib
import re
import shlex
import shutil
import tempfile
from pathlib import Path

import matplotlib.image
import numpy as np

HERE = Path(__file__).parent
project = "pamjax"
author = "The pamjax authors"
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
]
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "pamjax"
html_show_sourcelink = False
copybutton_prompt_text = "$ "
#: Width of the text of the site, pixels: a narrower picture would be blurred.
MIN_PICTURE_WIDTH = 700
autodoc_typehints = "none"
autodoc_member_order = "bysource"
#: The docstrings describe the attributes.
napoleon_use_ivar = True


def write_pages(_=None):
    """Write the pages of commands, mechanisms and parameters from the code."""
    folder = HERE / "_generated"
    folder.mkdir(exist_ok=True)
    for name, text in {"commands": commands(), "mechanisms": mechanisms(), "numbers": parameters()}.items():
        page = folder / f"{name}.md"
        if not page.exists() or page.read_text("utf-8") != text:
            page.write_text(text, "utf-8")


def draw_gallery(_=None):
    """Run the code of the gallery, and write its figures to `_generated/gallery`.

    Raises:
        Exception: any error of the code, or a difference between page and figures, ends the build.
    """
    from pamjax.compile.jax_cache import keep_compiled

    keep_compiled()
    target = HERE / "_generated" / "gallery"
    shutil.rmtree(target, ignore_errors=True)  # a former figure would hide that a figure is missing
    target.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as folder:
        text = (HERE / "gallery.md").read_text("utf-8")
        names = run_gallery(text, Path(folder))
        if differences := find_gallery_differences(text, names, Path(folder)):
            raise RuntimeError("the gallery differs from its figures: " + "; ".join(differences))
        for figure in Path(folder).glob("*.png"):
            shutil.copy(figure, target)


def run_gallery(text, folder):
    """Run the commands and the Python code of a page in a folder, and return the names that it assigns."""
    from pamjax.cli.main import main

    (folder / "fits").symlink_to(HERE.parent / "fits")
    names = {"__name__": "gallery"}
    with contextlib.chdir(folder):
        for language, code in re.findall(r"^```(console|python)\n(.*?)^```", text, re.S | re.M):
            if language == "python":
                exec(compile(code, "gallery.md", "exec"), names)
            elif main(shlex.split(code.removeprefix("$ pamjax "))):
                raise RuntimeError(f"the command of the gallery failed: {code}")
    return names


def list_pictures(text):
    """Return the (figure that a block of code writes, picture below the block) of a page."""
    return re.findall(
        r"""savefig\("([\w-]+\.png)"[^)]*\)\n```\n\n!\[[^\]]+\]\(_generated/gallery/([^)]+)\)""", text
    )


def find_gallery_differences(text, names, folder):
    """Return a sentence for each difference between the gallery and the figures that its code draws.

    Args:
        text: the page.
        names: the names that its code assigns.
        folder: folder of the figures.
    """
    pairs, drawn = list_pictures(text), {path.name for path in folder.glob("*.png")}
    shown = {picture for _, picture in pairs}
    out = [f"{written} is shown as {picture}" for written, picture in pairs if written != picture]
    if not len(pairs) == text.count("![") == text.count("```python"):
        out.append("each block of Python code needs one picture below it")
    out += [f"{name} is not shown" for name in sorted(drawn - shown)]
    out += [f"{name} is not drawn" for name in sorted(shown - drawn)]
    for name in sorted(shown & drawn):
        image = matplotlib.image.imread(folder / name)
        if image.shape[1] < MIN_PICTURE_WIDTH:
            out.append(f"{name} is narrower than {MIN_PICTURE_WIDTH} pixels")
        # An empty frame has no colour.
        if (np.ptp(image[..., :3], axis=2) > 0.1).mean() < 5e-4:
            out.append(f"{name} is empty")
    for result, cell in re.findall(r"^\| `(\w+)` \| (.*) \|$", text, re.M):
        if re.findall("`(.*?)`", cell) != list(names[result].list_figures()):
            out.append(f"the figures of `{result}` are {', '.join(names[result].list_figures())}")
    return out


def commands():
    """Return the page of all commands with their options."""
    import inspect

    from pamjax.cli.main import app

    lines = ["# Commands", "", "Every command with its options, as `pamjax COMMAND --help` prints them.", ""]
    for name in (name for name in app if not name.startswith("-")):
        command = app[name]
        text = inspect.getdoc(command.default_command) or command.help
        lines += [f"## pamjax {name}", "", *text.split("Args:")[0].strip().splitlines(), ""]
        for argument in command.assemble_argument_collection(parse_docstring=True):
            if argument.name == "*":  # a group whose options follow one by one
                continue
            help = " ".join((argument.parameter.help or "").split())
            lines += [f"- `{argument.name}`: {help}"]
        lines += [
            "",
            *(["```text", *command.help_epilogue.splitlines(), "```", ""] if command.help_epilogue else []),
        ]
    return "\n".join(lines) + "\n"


def mechanisms():
    """Return the page of all mechanisms: equation, signature, limits and source."""
    from pamjax.model.parameters import list_parameters
    from pamjax.model.registry import MECHANISMS

    lines = [
        "# Mechanisms",
        "",
        "The library of `pamjax diagnose`, `fit --with` and `simulate --with`.",
        "This page is generated. `pamjax explain ID` prints the same; `--figure` draws the effect.",
        "",
    ]
    for kind in MECHANISMS:
        about = kind.about
        lines += [f"## {kind.id}", "", about.title[:1].upper() + about.title[1:] + ".", "", "```text"]
        lines += [*about.equation.splitlines(), "```", ""]
        mistaken = ", ".join(
            f"[{c}](#{c})" if c in {k.id for k in MECHANISMS} else c for c in about.confusable
        )
        lines += [
            f"- **Signature:** {about.signature}",
            f"- **Neglects:** {about.neglects}",
            f"- **Easily confused with:** {mistaken or 'nothing in the library'}",
            f"- **Distinguished by:** {about.experiment}",
            f"- **Source:** {about.source}",
            "",
        ]
        lines += table({n: m for n, m in list_parameters().items() if n.startswith(f"{kind.id}.")})
    return "\n".join(lines) + "\n"


def parameters():
    """Return the page of the parameters of a muscle and its threads."""
    from pamjax.model.parameters import list_parameters

    own = {n: m for n, m in sorted(list_parameters().items()) if n.startswith(("muscle.", "thread."))}
    intro = "The parameters of a muscle, by their names in `muscle.toml`, reports and `pamjax explain`."
    return "\n".join(["# Parameters of a muscle", "", intro, "", *table(own)]) + "\n"


def table(meanings):
    """Return a table of parameters with unit, limits and meaning."""
    from pamjax.units import compute_si_factor

    if not meanings:
        return []
    lines = ["| parameter | unit | limits | meaning |", "|---|---|---|---|"]
    for name, meaning in meanings.items():
        scale = compute_si_factor(meaning.show)
        limits = f"{meaning.low / scale:g} to {meaning.high / scale:g}"
        lines.append(f"| `{name}` | {meaning.show} | {limits} | {meaning.about.replace('|', '∣')} |")
    return [*lines, ""]


def mark_example(app, what, name, object, options, lines):
    """Turn the example of a docstring into a block of code; a doctest is one already."""
    if "Example:" in lines:
        start = lines.index("Example:")
        if not any(line.lstrip().startswith(">>>") for line in lines[start:]):
            lines[start : start + 1] = [".. rubric:: Example", "", ".. code-block:: python", ""]


def setup(app):
    app.connect("builder-inited", write_pages)
    app.connect("builder-inited", draw_gallery)
    app.connect("autodoc-process-docstring", mark_example, priority=100)  # before napoleon

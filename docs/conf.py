"""The documentation site: pages in Markdown, and three that the code itself writes.

pip install -e '.[docs]'
sphinx-build -W -b html docs out/site
"""

from pathlib import Path

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
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "pamjax"
html_show_sourcelink = False
copybutton_prompt_text = "$ "
autodoc_typehints = "none"
autodoc_member_order = "bysource"
#: Attributes stand in the docstrings, in words.
napoleon_use_ivar = True


def written(_=None):
    """Commands, mechanisms and numbers as pages: what `pamjax --help` and `pamjax explain` say."""
    folder = HERE / "_generated"
    folder.mkdir(exist_ok=True)
    for name, text in {"commands": commands(), "mechanisms": mechanisms(), "numbers": numbers()}.items():
        page = folder / f"{name}.md"
        if not page.exists() or page.read_text("utf-8") != text:
            page.write_text(text, "utf-8")


def commands():
    import inspect

    from pamjax.cli.main import app

    lines = ["# Commands", "", "What `pamjax COMMAND --help` says, of every command.", ""]
    for word in (name for name in app if not name.startswith("-")):
        about = app[word]
        said = inspect.getdoc(about.default_command) or about.help
        lines += [f"## pamjax {word}", "", *said.split("Args:")[0].strip().splitlines(), ""]
        for argument in about.assemble_argument_collection(parse_docstring=True):
            if argument.name == "*":  # several options told one by one below
                continue
            help = " ".join((argument.parameter.help or "").split())
            lines += [f"- `{argument.name}`: {help}"]
        lines += [""]
    return "\n".join(lines) + "\n"


def mechanisms():
    from pamjax.model.parameters import catalogue
    from pamjax.model.registry import MECHANISMS

    lines = [
        "# Mechanisms",
        "",
        "What a model may leave out: the library of `pamjax diagnose`, `fit --with` and `simulate --with`.",
        "Written by the code that computes it; `pamjax explain ID` prints the same, `--figure` draws it.",
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
            f"- **Shows:** {about.signature}",
            f"- **Leaves out:** {about.leaves_out}",
            f"- **Mistaken for:** {mistaken or 'nothing in the library'}",
            f"- **Told apart by:** {about.experiment}",
            f"- **Source:** {about.source}",
            "",
        ]
        lines += table({n: m for n, m in catalogue().items() if n.startswith(f"{kind.id}.")})
    return "\n".join(lines) + "\n"


def numbers():
    from pamjax.model.parameters import catalogue

    own = {n: m for n, m in sorted(catalogue().items()) if n.startswith(("muscle.", "thread."))}
    intro = "What a muscle is made of, by the names in `muscle.toml`, in reports and in `pamjax explain`."
    return "\n".join(["# Numbers of a muscle", "", intro, "", *table(own)]) + "\n"


def table(meanings):
    from pamjax.units import in_unit

    if not meanings:
        return []
    lines = ["| number | unit | limits | meaning |", "|---|---|---|---|"]
    for name, meaning in meanings.items():
        scale = in_unit(meaning.show)
        limits = f"{meaning.low / scale:g} to {meaning.high / scale:g}"
        lines.append(f"| `{name}` | {meaning.show} | {limits} | {meaning.about.replace('|', '∣')} |")
    return [*lines, ""]


def setup(app):
    app.connect("builder-inited", written)

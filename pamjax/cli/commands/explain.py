"""`pamjax explain`: describe a parameter or a mechanism."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.options import Json
from pamjax.cli.screen import check_writable, print_json, print_text, print_written_files
from pamjax.errors import BadInput


def explain(
    name: str | None = None,
    /,
    *,
    figure: Path | None = None,
    json: Json = False,
) -> None:
    """Describe a parameter or a mechanism; without a name, list all of them.

    For a parameter the command prints meaning, unit, limits and source. For a mechanism it prints the
    equation, its effect on a recording, what it neglects, similar mechanisms, and its parameters.

    Args:
        name: a parameter as in reports, for instance thread.modulus, or a mechanism, for instance
            braid_friction.
        figure: PNG file to write, with the effect of the mechanism on force and diameter.
        json: print one JSON document.
    """
    from pamjax.explanation import explain

    if figure is not None:
        _write_figure(name, figure)
    explanation = explain(name)
    print_json(explanation.as_dict()) if json else print_text(str(explanation))


def _write_figure(name: str | None, file: Path) -> None:
    """Write the figure of a mechanism."""
    from pamjax.model.registry import find_mechanism, list_mechanisms

    if name is None or "." in name:
        remedy = f"Name one of {', '.join(list_mechanisms())}."
        raise BadInput.from_rule("`--figure` needs the name of a mechanism", name or "no name", remedy=remedy)
    if file.suffix != ".png":
        raise BadInput.from_rule(
            "`--figure` must be a PNG file", str(file), remedy=f"Write {file.with_suffix('.png')}."
        )
    kind = find_mechanism(name)
    check_writable(file.parent, "the folder of `--figure`")
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.view.figures.mechanism import plot_mechanism
    from pamjax.view.theme import save_png

    keep_compiled()
    print_written_files([save_png(plot_mechanism(kind), file.with_suffix(""))])

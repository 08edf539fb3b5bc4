"""Figures of results: `plot` of a result calls the function `pamjax.plot`.

The figure functions are in `view`, which imports the results. The package's table of public names connects
the two, so that neither a result nor its computation loads matplotlib before the first figure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class DrawableResult:
    """A result with figures."""

    def plot(self, name: str | None = None, *, narrow: bool = False) -> Figure:
        """Return a figure of this result, as `pamjax.plot` does.

        Args:
            name: name of the figure; the first one of `list_figures` if omitted.
            narrow: draw for one column of a journal, with stacked panels.

        Returns:
            a matplotlib figure, which a notebook shows.

        Raises:
            BadInput: for an unknown name; the message lists the names.

        Example:
            figure = fit.plot("residual")
            figure.savefig("residual.pdf")
        """
        import pamjax

        return pamjax.plot(self, name, narrow=narrow)

    def list_figures(self) -> list[str]:
        """Return the names of the figures of this result, the most important one first."""
        import pamjax

        return pamjax.list_figures(self)

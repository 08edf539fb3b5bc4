"""Command line of pamjax. JAX is loaded only when a command needs it."""

from pamjax.cli.main import main, run

__all__ = ["main", "run"]

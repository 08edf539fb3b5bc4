"""The words: what a person types. Nothing here loads JAX before it is needed."""

from pamjax.cli.main import main, run

__all__ = ["main", "run"]

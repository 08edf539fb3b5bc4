"""The words: what a person types. Nothing here loads JAX before it is needed."""

from pamjax.cli.main import main

__all__ = ["main"]

"""What the muscle is: geometry, threads, balance, and the muscle that joins them."""

# Importing any part of the model turns on 64-bit numbers.
import pamjax.parameter  # noqa: F401

"""The model of a muscle: geometry, threads, balance of forces, mechanisms and test bench."""

# This import turns on 64-bit numbers.
import pamjax.parameter  # noqa: F401

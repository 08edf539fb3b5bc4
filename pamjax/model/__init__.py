"""The model of a muscle: geometry, threads, balance of forces, mechanisms and test bench."""

# This import selects 64-bit floating point numbers in JAX.
import pamjax.parameter  # noqa: F401

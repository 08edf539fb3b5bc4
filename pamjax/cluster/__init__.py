"""Tasks of a fleet on Dask distributed."""
